"""Counters of the requests to one unit: plain integers, because they are on the request path."""

from collections.abc import Iterable
from dataclasses import dataclass, field, fields
from operator import attrgetter
from typing import Final, NamedTuple

from gateway.errors import RequestError
from gateway.modbus.functions import KNOWN_FUNCTIONS
from gateway.timing.measured import NEVER, Times

#: The key of all functions that the gateway does not know; clients may send any of them.
OTHER_FUNCTIONS: Final = 0
#: The number of wrong responses that are kept.
_KEPT: Final = 8


@dataclass(slots=True)
class Counts:
    """Requests by result, then numbers of frames.

    Each request of a client is counted in exactly one of the first group. Reads that shared a transaction count one
    each, but the transaction is `sent` once.
    """

    #: Answered by the unit, or sent without a response to expect: 08/04 (`ok`), broadcasts.
    ok: int = 0
    exception: int = 0
    broadcast: int = 0
    #: Sent and failed: no response, no valid response, perhaps another client's response, the port was lost.
    timeout: int = 0
    bad_frame: int = 0
    ambiguous: int = 0
    line_lost: int = 0
    #: Not sent: rejected by the profile; or because of the state of the line, the unit or the queue.
    refused: int = 0
    line_down: int = 0
    resting: int = 0
    overdue: int = 0
    echo_suspected: int = 0
    queue_full: int = 0
    expired: int = 0
    #: Not sent: its client had disconnected.
    unwanted: int = 0

    #: Bad frames with a known reason.
    explained: int = 0
    #: Frames sent, including broadcasts and repeated reads, and valid responses within their limits.
    sent: int = 0
    responses: int = 0
    retries: int = 0
    #: Reads that shared the transaction of an equal one.
    coalesced: int = 0
    #: Responses after their requests had failed; responses before these can have been sent; valid frames that were not
    #: the response; transactions with other bytes before the response; copies of the request.
    late_responses: int = 0
    early_responses: int = 0
    foreign_frames: int = 0
    noise: int = 0
    echoes: int = 0

    def count_error(self, error: RequestError, requests: int) -> None:
        """Count `requests` requests that failed with `error`."""
        setattr(self, error.result, getattr(self, error.result) + requests)


class LastTime(NamedTuple):
    """The last time of an event, and how many responses the unit had given in time by then."""

    at: float
    responses: int


class UnitCounts(dict[int, Counts]):
    """The Counts of one unit by function; unknown functions share one. `times` has the same keys.

    `codes` counts the unit's exception responses by code. `last_error` is the result of the last request that was sent
    and not `ok`: `timeout`, `exception 02`; `last_error_at` is its time. `received_instead` holds the last bytes that
    came in place of responses without a known reason. `why` explains the last failure, if possible. `last_times` are
    the last times of faults that may be repaired: of failed requests by their result, of `late` responses, and of
    responses that came `twice`.
    """

    __slots__ = ("codes", "last_error", "last_error_at", "last_times", "received_instead", "times", "why")

    def __init__(self) -> None:
        super().__init__()
        self.times: dict[int, Times] = {}
        self.codes: dict[int, int] = {}
        self.received_instead: tuple[bytes, ...] = ()
        self.why = ""
        self.last_error = ""
        self.last_error_at = NEVER
        self.last_times: dict[str, LastTime] = {}

    @property
    def responses(self) -> int:
        """Number of valid responses in time."""
        return sum(counts.responses for counts in self.values())

    def __missing__(self, function: int) -> Counts:
        if function not in KNOWN_FUNCTIONS and function != OTHER_FUNCTIONS:
            counts = self[OTHER_FUNCTIONS]
            self.times[function] = self.times[OTHER_FUNCTIONS]
            return counts
        counts = self[function] = Counts()
        self.times[function] = Times()
        return counts

    def count_exception(self, code: int, requests: int, now: float) -> None:
        """Count `requests` requests that got the exception `code` from the unit."""
        self.codes[code] = self.codes.get(code, 0) + requests
        self.record_error(f"exception {code:02X}", now)

    def record(self, what: str, now: float) -> None:
        """Record the time of a fault: see `last_times`."""
        self.last_times[what] = LastTime(now, self.responses)

    def record_instead(self, received: bytes, why: str) -> None:
        """Record the bytes that came in place of a response, and `why` they are none, empty if unknown."""
        self.why = why
        if received and not why:
            self.received_instead = (*self.received_instead, received)[-_KEPT:]

    def record_error(self, error: str, now: float) -> None:
        """Record the result of a request that was sent and failed."""
        self.last_error = error
        self.last_error_at = now


_NAMES: Final = tuple(field.name for field in fields(Counts))
_VALUES: Final = attrgetter(*_NAMES)
#: The names of the first group: the possible results of a request.
RESULTS: Final = _NAMES[: _NAMES.index("explained")]
#: The results of requests that were not sent because of the state of the line, the unit or the queue.
UNSENT: Final = ("line_down", "resting", "overdue", "echo_suspected", "queue_full", "expired")


def total(counts: Iterable[Counts]) -> Counts:
    """Return the sum of `counts`."""
    return Counts(*map(sum, zip(*map(_VALUES, counts), strict=True)))


def total_of_units(units: Iterable[UnitCounts]) -> Counts:
    """Return the sum over units and functions."""
    return total(counts for unit in units for counts in unit.values())


@dataclass(slots=True)
class Belated:
    """Responses that came after the late window of their request; the longest time from a request to one.

    `limit` is the time limit of that request.
    """

    count: int = 0
    longest: float = 0.0
    limit: float = 0.0


@dataclass(slots=True)
class Overheard:
    """Frames of others, or of unclear origin, since the start.

    `copies` equal the line's own last request: an adapter echoes, or another client sends the same. `requests` are
    other requests, so another client sent them. `copied_at` and `requested_at` are the times of the last ones;
    `sent_since_copy` and `sent_since_request` count the line's requests since then. By unit, `second_responses` counts
    responses that followed a valid one to the same request, `belated` those that came after its late window.
    """

    copies: int = 0
    requests: int = 0
    copied_at: float = NEVER
    requested_at: float = NEVER
    sent_since_copy: int = 0
    sent_since_request: int = 0
    second_responses: dict[int, int] = field(default_factory=dict)
    belated: dict[int, Belated] = field(default_factory=dict)

    def count_sent(self) -> None:
        """Count a request that the line sends."""
        self.sent_since_copy += 1
        self.sent_since_request += 1

    def count_copy(self, now: float) -> None:
        """Count a copy of the line's own request."""
        self.copies += 1
        self.copied_at = now
        self.sent_since_copy = 0

    def count_request(self, now: float) -> None:
        """Count a request of another client."""
        self.requests += 1
        self.requested_at = now
        self.sent_since_request = 0

    def count_second_response(self, unit: int) -> None:
        """Count a second response of `unit` to a request."""
        self.second_responses[unit] = self.second_responses.get(unit, 0) + 1

    def count_belated(self, unit: int, seconds: float, limit: float) -> None:
        """Count a response of `unit` that came this long after its request, which had this limit."""
        belated = self.belated.setdefault(unit, Belated())
        belated.count += 1
        if seconds > belated.longest:
            belated.longest, belated.limit = seconds, limit
