"""What became of a request that the trace has a record of."""

from typing import Final

from gateway.modbus.codes import EXCEPTION_BIT
from gateway.trace.records import Answered, Exchange, Heard, Incident, Record, Refused

#: What can have become of it; `failed` are all but the first two.
RESULTS: Final = (
    *("ok", "exception", "failed", "timeout", "bad_frame", "ambiguous", "line_lost", "sent_again", "not_answered"),
    *("resting", "overdue", "queue_full", "expired", "line_down", "no_route", "denied", "unwanted", "refused"),
    *("echo_suspected", "stale"),
)
#: Those of which the ring keeps all records among its failures.
FAILURES: Final = frozenset(RESULTS) - {"ok", "exception", "failed", "sent_again", "not_answered"}


def has_result(record: Record, result: str) -> bool:
    """Whether a request has come to this, one of RESULTS."""
    found = result_of(record)
    return found == result or (result == "failed" and found not in ("", "ok", "exception"))


def result_of(record: Record) -> str:
    """What became of a request; empty for what is none."""
    if not isinstance(record, Exchange | Refused | Answered):
        return ""
    error = getattr(record, "error", None)
    if error is not None:
        return str(error.result)
    response = getattr(record, "response", None)
    if response is None:
        return "sent_again" if isinstance(record, Incident) else "not_answered"
    return "exception" if response[0] & EXCEPTION_BIT else "ok"


def function_of(record: Record) -> int | None:
    """The function of a request, or of a frame that was heard; None for what has none."""
    if isinstance(record, Heard):
        is_frame = record.kind != "noise" and len(record.frame) > 1
        return record.frame[1] & ~EXCEPTION_BIT if is_frame else None
    pdu = getattr(record, "request", b"")
    return pdu[0] if pdu else None
