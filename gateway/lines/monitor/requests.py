"""Requests of others whose answers may still come, and what else may have been one: when an answer can be believed.

An answer next to a request is told as its answer. But if an earlier one was owed an answer that looks the same, this
may have been that, and the next ones may be late as well, each next to the request after its own. So the request stays
owed one, until its window has ended, or an answer comes that can only be to a later request: units answer in order.
A unit that owes an answer sends it when it is not asked for a while. So after a few such pauses in which nothing came,
it owes none.
"""

from math import inf
from typing import Final

from gateway.modbus.pdu import RequestPdu
from gateway.modbus.scan import Expected

#: The most requests without an answer, and units and functions with doubts of their own, that are told apart.
_MOST_OPEN: Final = 256
_MOST_DOUBTS: Final = 256

#: How long a pause is, as a share of the window, and how many there must be, each behind the answer to a request.
_PAUSE: Final = 1 / 8
_PAUSES: Final = 3

#: Unit and function.
Key = tuple[int, int]


class HeardRequest(Expected):
    """A request to `unit` that ended at the place `since` and was read `came_at`. An answer may come until `ends_at`.

    If it `is_told`, it has got the answer next to it; but while it `is_owed` one, that may have been an earlier one's.
    It may have ended as early as `asked_at`, and its first character was read at `begun_at`. If it `is_twofold`, it may
    be no request, but a response.
    """

    __slots__ = ("asked_at", "begun_at", "came_at", "ends_at", "is_owed", "is_told", "is_twofold", "unit")

    def __init__(self, unit: int, asked: RequestPdu, since: int, came_at: float) -> None:
        super().__init__(unit, asked, since)
        self.unit = unit
        self.came_at = came_at
        self.asked_at = came_at
        self.begun_at = came_at
        self.ends_at = inf
        self.is_owed = True
        self.is_told = False
        self.is_twofold = False

    @property
    def key(self) -> Key:
        """Unit and function."""
        return self.unit, self.asked.function


class HeardRequests:
    """The requests on one bus that are without an answer, or owed one. The next window ends at `next_end`."""

    def __init__(self) -> None:
        self.next_end = inf
        self._open: dict[Key, list[HeardRequest]] = {}
        self._count = 0
        #: By unit: when it gave the answer next to its last request; how many pauses there were since one had none.
        self._answered_at: dict[int, float] = {}
        self._pauses: dict[int, int] = {}

    def add(self, request: HeardRequest) -> HeardRequest | None:
        """Add a request. If there are too many, take the oldest out and return it."""
        answered_at = self._answered_at.pop(request.unit, None)
        if answered_at is None:
            self._pauses[request.unit] = 0
        elif request.begun_at - answered_at >= _PAUSE * (request.ends_at - request.came_at):
            self._paused(request.unit)
        self.next_end = min(self.next_end, request.ends_at)
        self._open.setdefault(request.key, []).append(request)
        self._count += 1
        if self._count <= _MOST_OPEN:
            return None
        oldest = min((requests[0] for requests in self._open.values()), key=_place)
        self._keep(oldest.key, self._open[oldest.key][1:])
        return oldest

    def fitting(self, key: Key, pdu: bytes) -> list[HeardRequest]:
        """Return those that a response may answer, in order."""
        return [each for each in self._open.get(key, ()) if each.is_owed and each.asked.accepts(pdu)]

    def is_alone(self, request: HeardRequest) -> bool:
        """Tell whether no other request of the same unit and function is open, but the same one once more."""
        data = request.asked.data
        return all(each.asked.data == data and not each.is_twofold for each in self._open[request.key])

    def settle(self, answered: HeardRequest) -> None:
        """Note that a unit has answered this request or a later one: what it was asked before is not answered any more.

        Those that are not told stay until their windows have ended.
        """
        for key in [key for key in self._open if key[0] == answered.unit]:
            for each in self._open[key]:
                each.is_owed = each.is_owed and each.since > answered.since
            self._keep(key, [each for each in self._open[key] if each.is_owed or not each.is_told])

    def note_answer(self, unit: int, at: float, *, is_next: bool) -> None:
        """Note that a unit has answered: its last request, and nothing is between, if it `is_next`."""
        if is_next:
            self._answered_at[unit] = at
        else:
            self._answered_at.pop(unit, None)

    def _paused(self, unit: int) -> None:
        """Count a pause in which the unit has sent nothing; after enough of them it owes nothing."""
        pauses = self._pauses[unit] = self._pauses.get(unit, 0) + 1
        if pauses >= _PAUSES:
            for key in [key for key in self._open if key[0] == unit]:
                self._keep(key, [each for each in self._open[key] if not each.is_told])

    def take_ended(self, until: float) -> list[HeardRequest]:
        """Take out those whose windows end up to `until`: no answer can come to them any more. They are in order."""
        ended = [each for requests in self._open.values() for each in requests if each.ends_at <= until]
        for key in {each.key for each in ended}:
            self._keep(key, [each for each in self._open[key] if each.ends_at > until])
        self.next_end = min((each.ends_at for requests in self._open.values() for each in requests), default=inf)
        return sorted(ended, key=_place)

    def _keep(self, key: Key, requests: list[HeardRequest]) -> None:
        self._count += len(requests) - len(self._open[key])
        if requests:
            self._open[key] = requests
        else:
            del self._open[key]


class Doubt:
    """Since when all that was heard is known: an answer to anything that was asked before may still come.

    A doubt lasts as long as the longest window of the unit, and then until the port is found empty: a gateway that
    stood still does not know when bytes came. `empty_at` is when that was so for the last time.
    """

    def __init__(self) -> None:
        self.empty_at = -inf
        self._since = -inf
        self._of: dict[Key, float] = {}
        self._windows: dict[int, float] = {}

    def note_window(self, unit: int, window: float) -> None:
        """Note how long an answer of this unit may take."""
        self._windows[unit] = max(window, self._windows.get(unit, 0.0))

    def add(self, at: float) -> None:
        """Note that anything may have been asked at this time."""
        self._since = max(self._since, at)

    def add_to(self, key: Key, at: float) -> None:
        """Note that this unit may have been asked with this function at this time."""
        if len(self._of) >= _MOST_DOUBTS:
            self._of.clear()
            self.add(at)
        self._of[key] = at

    def is_about(self, key: Key) -> bool:
        """Tell whether an answer of this unit with this function may belong to a request that is not known."""
        return max(self._since, self._of.get(key, -inf)) + self._windows[key[0]] > self.empty_at


def _place(request: HeardRequest) -> int:
    return request.since
