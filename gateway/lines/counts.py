"""What has happened to the requests for one unit: plain ints, all that the request path may spend on it."""

from collections.abc import Iterable
from dataclasses import dataclass, fields
from operator import attrgetter
from typing import Final

from gateway.errors import RequestError
from gateway.modbus.functions import KNOWN_FUNCTIONS
from gateway.timing.measured import NEVER, Times

#: Stands for every function that is not known here: clients may ask for any of them.
OTHER_FUNCTIONS: Final = 0


@dataclass(slots=True)
class Counts:
    """Requests by what became of them, then what was seen on the line.

    Each request of a client ends in exactly one of the first group. Reads that shared a transaction count one each,
    but the transaction is `sent` once.
    """

    #: Answered by the unit, or sent and not to be answered (08/04); or sent to all units.
    ok: int = 0
    exception: int = 0
    broadcast: int = 0
    #: Sent, and failed: silence, something broken or foreign, somebody else's answer perhaps, the port died.
    timeout: int = 0
    bad_frame: int = 0
    ambiguous: int = 0
    line_lost: int = 0
    #: Not sent: refused by the profile; or as the line was at that moment.
    refused: int = 0
    line_down: int = 0
    resting: int = 0
    overdue: int = 0
    echo_suspected: int = 0
    queue_full: int = 0
    expired: int = 0
    #: Not sent: its client had left.
    unwanted: int = 0

    #: Frames sent, broadcasts and repeated reads included, and valid answers within their limits.
    sent: int = 0
    responses: int = 0
    retries: int = 0
    #: Requests that joined another one's transaction.
    coalesced: int = 0
    #: Answers after their limits, and before their requests can have left; frames that were no answer to what was
    #: asked; other bytes; the request's own copy.
    late_responses: int = 0
    early_responses: int = 0
    foreign_frames: int = 0
    noise: int = 0
    echoes: int = 0

    def failed(self, error: RequestError, requests: int) -> None:
        """So many requests have got `error`."""
        setattr(self, error.result, getattr(self, error.result) + requests)


class UnitCounts(dict[int, Counts]):
    """The Counts of one unit by function; those that are not known here share one. `times` has an entry beside each.

    `codes` are the unit's exception responses by their code. `last_error` is what became of the last request that was
    sent and not `ok`: `timeout`, `exception 02`. That was at `last_error_at`.
    """

    __slots__ = ("codes", "last_error", "last_error_at", "times")

    def __init__(self) -> None:
        super().__init__()
        self.times: dict[int, Times] = {}
        self.codes: dict[int, int] = {}
        self.last_error = ""
        self.last_error_at = NEVER

    def __missing__(self, function: int) -> Counts:
        if function not in KNOWN_FUNCTIONS and function != OTHER_FUNCTIONS:
            counts = self[OTHER_FUNCTIONS]
            self.times[function] = self.times[OTHER_FUNCTIONS]
            return counts
        counts = self[function] = Counts()
        self.times[function] = Times()
        return counts

    def refused_by_unit(self, code: int, requests: int, now: float) -> None:
        """So many requests have got the exception `code` from the unit."""
        self.codes[code] = self.codes.get(code, 0) + requests
        self.failed(f"exception {code:02X}", now)

    def failed(self, error: str, now: float) -> None:
        """A request that was sent has come to this."""
        self.last_error = error
        self.last_error_at = now


_NAMES: Final = tuple(field.name for field in fields(Counts))
_VALUES: Final = attrgetter(*_NAMES)
#: The names of the first group: what can become of a request.
RESULTS: Final = _NAMES[: _NAMES.index("sent")]


def total(counts: Iterable[Counts]) -> Counts:
    """All of `counts` together."""
    return Counts(*map(sum, zip(*map(_VALUES, counts), strict=True)))
