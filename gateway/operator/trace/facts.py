"""Records of the trace as facts, which every door tells.

A fact is a JSON object with `kind` and `time` (seconds since 1970) and what `_FACTS` adds. PDUs and bytes are
hexadecimal. They are decoded by the reader, not here beside the lines.
"""

import asyncio
import time
from collections.abc import Callable, Iterable
from typing import Any, Final

from gateway.errors import RequestError
from gateway.operator.operations.answers.trace import Fact
from gateway.operator.trace.unit_names import UnitNames
from gateway.trace.records import Answered, Heard, Incident, PortChanged, Record, Refused, Sent

Clock = tuple[float, float]
"""The time of the event loop, and that of the day, at the same moment."""


def clocks() -> Clock:
    """Read both clocks."""
    return asyncio.get_running_loop().time(), time.time()


def fact(record: Record, clock: Clock, names: UnitNames) -> Fact:
    """Convert a record to a fact."""
    kind, tell = next((kind, tell) for each, kind, tell in _FACTS if isinstance(record, each))
    told = {"kind": kind, "time": _time(record.at, clock), "line": record.line}
    unit = getattr(record, "unit", None)
    if unit is not None:
        told["unit"] = unit
        told["name"] = names.of(record)
    device, sources = names.device_of(record), names.sources_of(record)
    beside = ({"device": device} if device else {}) | ({"sources": sources} if sources else {})
    return told | tell(record, clock) | beside


def _time(at: float, clock: Clock) -> float:
    return round(at - clock[0] + clock[1], 6)


def _hex(data: bytes | None) -> str | None:
    return None if data is None else data.hex(" ").upper()


def _milliseconds(seconds: float) -> float:
    return round(seconds * 1000, 3)


def _error(error: RequestError | None) -> Fact:
    return {} if error is None else {"result": error.result, "code": f"{error.code:02X}", "reason": str(error)}


def _exchange(record: Sent, clock: Clock) -> Fact:
    return {
        "client": record.client,
        "address": record.address,
        "request": _hex(record.request),
        "response": _hex(record.response),
        "received": _time(record.received_at, clock),
        "sent": _time(record.sent_at, clock),
        "wait_ms": _milliseconds(record.sent_at - record.received_at),
        "elapsed_ms": _milliseconds(max(0.0, record.at - record.ends_at)),
        "limit_ms": _milliseconds(record.limit),
    }


def _incident(record: Incident, clock: Clock) -> Fact:
    return {
        **_exchange(record, clock),
        **_error(record.error),
        "heard": _hex(record.heard),
        "late_until": _time(record.late_until, clock) if record.late_until else None,
        "retries": record.retries,
        "sent_again": record.sent_again,
        "answered_by": record.answered_by,
        "others": [{"client": client, "unit": unit} for client, unit, _ in record.others],
    }


def _refused(record: Refused, clock: Clock) -> Fact:
    return {
        "client": record.client,
        "request": _hex(record.request),
        "received": _time(record.received_at, clock),
        "wait_ms": _milliseconds(record.at - record.received_at),
        "until": _time(record.until, clock) if record.until else None,
        "count": record.count,
        **_error(record.error),
    }


def _answered(record: Answered, clock: Clock) -> Fact:
    return {
        "client": record.client,
        "request": _hex(record.request),
        "response": _hex(record.response),
        "received": _time(record.received_at, clock),
        "reason": record.reason,
    }


def _heard(record: Heard, _: Clock) -> Fact:
    return {"owner": record.kind, "frame": _hex(record.frame), "count": record.count}


def _port(record: PortChanged, _: Clock) -> Fact:
    return {"reason": record.reason}


#: The kinds of facts, subclasses first.
_FACTS: Final[Iterable[tuple[type[Record], str, Callable[[Any, Clock], Fact]]]] = (
    (Incident, "exchange", _incident),
    (Sent, "exchange", _exchange),
    (Refused, "refused", _refused),
    (Answered, "answered", _answered),
    (Heard, "heard", _heard),
    (PortChanged, "port", _port),
)
