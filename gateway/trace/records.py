"""What a ring keeps: one record for each thing that has happened, with the bytes that are in memory anyway.

Nothing is written as text here: a record is made for every transaction, and read for few. Times are those of the event
loop, in seconds. `size` is how many bytes a record takes, with all that it alone holds, rounded up: see `test_ring`.
"""

from typing import Final

from gateway.compiler import mypyc_attr
from gateway.errors import RequestError
from gateway.modbus.codes import EXCEPTION_BIT

#: What a record takes without its PDUs, and what a PDU takes beside its bytes. Not compiled it is more than compiled.
RECORD: Final = 280
BYTES: Final = 48
#: What an incident takes beyond that, and each client that shares its transaction.
INCIDENT: Final = 112
SHARER: Final = 128
#: At most this many bytes are kept of what came instead of an answer, or of noise.
MOST_HEARD: Final = 256
#: The most incidents that are told at once, as stories.
MOST_STORIES: Final = 50

#: What can have become of a request; `failed` are all but the first two.
RESULTS: Final = (
    *("ok", "exception", "failed", "timeout", "bad_frame", "ambiguous", "line_lost", "sent_again", "not_answered"),
    *("resting", "overdue", "queue_full", "expired", "line_down", "no_route", "denied", "unwanted", "refused"),
    *("echo_suspected", "stale", "only_heard"),
)
#: Those of which the ring keeps all records among its failures.
FAILURES: Final = frozenset(RESULTS) - {"ok", "exception", "failed", "sent_again", "not_answered"}

#: A client that shares a transaction: who it is, the unit that it asked for, and when.
Sharer = tuple[str, int, float]


@mypyc_attr(acyclic=True)
class Record:
    """What has happened on `line` (empty: on none), known `at` this time."""

    __slots__ = ("at", "line", "size")

    def __init__(self, at: float, line: str, size: int) -> None:
        self.at = at
        self.line = line
        self.size = size

    @property
    def result(self) -> str:
        """What became of a request, one of RESULTS; empty for what is none."""
        return ""

    @property
    def function(self) -> int | None:
        """The function of a request, or of a frame that was heard; None for what has none."""
        return None

    def has_result(self, result: str) -> bool:
        """Tell whether a request has come to this, one of RESULTS."""
        found = self.result
        return found == result or (result == "failed" and found not in ("", "ok", "exception"))


@mypyc_attr(free_list_len=1, acyclic=True)
class Sent(Record):
    """A request that was sent, and its `response`; None if nobody answers it.

    `unit` is the client's number for the device called `name`, which is asked at `address`. The limit counts from
    `ends_at`, when the request had left.
    """

    __slots__ = (
        "address", "client", "ends_at", "limit", "name", "received_at", "request", "response", "sent_at", "unit",
    )  # fmt: skip

    def __init__(
        self,
        at: float,
        line: str,
        name: str,
        client: str,
        unit: int,
        address: int,
        request: bytes,
        response: bytes | None,
        received_at: float,
        sent_at: float,
        ends_at: float,
        limit: float,
    ) -> None:
        super().__init__(at, line, RECORD + 2 * BYTES + len(request) + (0 if response is None else len(response)))
        self.name = name
        self.client = client
        self.unit = unit
        self.address = address
        self.request = request
        self.response = response
        self.received_at = received_at
        self.sent_at = sent_at
        self.ends_at = ends_at
        self.limit = limit

    @property
    def result(self) -> str:
        """See Record."""
        return _result_of(self.response)

    @property
    def function(self) -> int | None:
        """See Record."""
        return self.request[0]


class Incident(Sent):
    """One with more to tell: that failed with `error`, or is sent again for want of an answer, or has been before.

    `heard` is what came instead of the answer, and until `late_until` that may still come. `answered_by` is the unit
    identifier of the response where it is another than that of the request. `others` are clients with the same request.
    """

    __slots__ = ("answered_by", "error", "heard", "late_until", "others", "retries")

    def __init__(
        self,
        at: float,
        line: str,
        name: str,
        client: str,
        unit: int,
        address: int,
        request: bytes,
        response: bytes | None,
        received_at: float,
        sent_at: float,
        ends_at: float,
        limit: float,
    ) -> None:
        super().__init__(at, line, name, client, unit, address, request, response, received_at, sent_at, ends_at, limit)
        self.error: RequestError | None = None
        self.heard = b""
        self.answered_by: int | None = None
        self.late_until = 0.0
        self.others: tuple[Sharer, ...] = ()
        self.retries = 0

    @property
    def result(self) -> str:
        """See Record."""
        if self.error is not None:
            return self.error.result
        return "sent_again" if self.response is None else _result_of(self.response)

    @property
    def sent_again(self) -> bool:
        """Whether the request is sent once more."""
        return self.error is None and self.response is None


class Refused(Record):
    """A client's request for the unit called `name` that was not sent to anybody, and why. No name: there is no unit.

    `until` is when a rest or a late window ends, 0 without one; `count` is of how many things there were too many:
    requests that waited, failures in a row.
    """

    __slots__ = ("client", "count", "error", "name", "received_at", "request", "unit", "until")

    def __init__(
        self,
        at: float,
        line: str,
        name: str,
        client: str,
        unit: int,
        request: bytes,
        error: RequestError,
        received_at: float,
        until: float = 0.0,
        count: int = 0,
    ) -> None:
        super().__init__(at, line, RECORD + BYTES + len(request))
        self.name = name
        self.client = client
        self.unit = unit
        self.request = request
        self.error = error.with_traceback(None)  # whose frames would keep the parts of an earlier gateway
        self.received_at = received_at
        self.until = until
        self.count = count

    @property
    def result(self) -> str:
        """See Record."""
        return self.error.result

    @property
    def function(self) -> int | None:
        """See Record."""
        return self.request[0]


class Heard(Record):
    """Bytes on a line that were not the answer to what was asked; `kind` says whose they are, as far as it is known.

    `frame` is its unit identifier and PDU, or for noise the bytes as they came: the first ones of `count`.
    """

    __slots__ = ("count", "frame", "kind")

    def __init__(self, at: float, line: str, kind: str, frame: bytes, count: int) -> None:
        super().__init__(at, line, RECORD + BYTES + len(frame))
        self.kind = kind
        self.frame = frame
        self.count = count

    @property
    def function(self) -> int | None:
        """See Record."""
        is_frame = self.kind != "noise" and len(self.frame) > 1
        return self.frame[1] & ~EXCEPTION_BIT if is_frame else None


@mypyc_attr(free_list_len=1, acyclic=True)
class Answered(Record):
    """A request that the gateway answers itself, from an image or a mirror called `name`; or on a server `line`.

    Without a `response` the client on the line has got none, for this `reason`.
    """

    __slots__ = ("client", "name", "reason", "received_at", "request", "response", "unit")

    def __init__(
        self,
        at: float,
        line: str,
        name: str,
        client: str,
        unit: int,
        request: bytes,
        response: bytes | None,
        received_at: float,
        reason: str = "",
    ) -> None:
        super().__init__(at, line, RECORD + 2 * BYTES + len(request) + len(response or b""))
        self.name = name
        self.client = client
        self.unit = unit
        self.request = request
        self.response = response
        self.received_at = received_at
        self.reason = reason

    @property
    def result(self) -> str:
        """See Record."""
        return _result_of(self.response)

    @property
    def function(self) -> int | None:
        """See Record."""
        return self.request[0]


class PortChanged(Record):
    """The port of a line was lost for a `reason`, or without one opened."""

    __slots__ = ("reason",)

    def __init__(self, at: float, line: str, reason: str) -> None:
        super().__init__(at, line, RECORD + BYTES + 4 * len(reason))
        self.reason = reason


def _result_of(response: bytes | None) -> str:
    if response is None:
        return "not_answered"
    return "exception" if response[0] & EXCEPTION_BIT else "ok"
