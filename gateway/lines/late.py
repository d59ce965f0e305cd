"""Late windows: the time after a time-out in which the response may still come.

RTU and ASCII frames have no transaction identifier, so a late response looks like the response to the next request of
the same shape. Until it has come, or the window ends, no request with the same function is sent to that unit. Requests
with other functions and to other units are.
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Final, NamedTuple

from gateway.lines.transaction import Transaction
from gateway.modbus.codes import BROADCAST_UNIT, EXCEPTION_BIT
from gateway.modbus.frame import Frame
from gateway.modbus.pdu import RequestPdu, parse_sent
from gateway.modbus.scan import Expected, Token
from gateway.timing.budget import AnswerTime

#: A request that a window forbids waits if the window ends within this many seconds. Otherwise it fails at once, so
#: that a client that polls one unit after the other is not blocked.
WORTH_WAITING: Final = 0.250


class Overdue(NamedTuple):
    """A request that was sent or heard on the port by an earlier line: up to `owed` responses may come until `ends_at`.

    `answers_from` is the unit that responds; None if it is unknown. If `owed` is 0, no response is awaited: another
    client has sent the request, and may be there until `ends_at`.
    """

    unit: int
    answers_from: int | None
    pdu: bytes
    owed: int
    ends_at: float

    @property
    def asked(self) -> RequestPdu:
        """The request."""
        return parse_sent(self.pdu)

    def accepts(self, frame: Frame) -> bool:
        """Whether `frame` is a response: see Transaction."""
        return self.answers_from in (None, frame.unit) and self.asked.accepts(frame.pdu)


#: A request that was sent, by this line or by an earlier one.
SentRequest = Transaction | Overdue


class LateResponse(NamedTuple):
    """A response after its time limit."""

    request: SentRequest
    frame: Frame


@dataclass
class _Window:
    """Until `ends_at`, `owed` late responses to `request` may come. See LateWindows.open for `patience`."""

    request: SentRequest
    expected: Expected
    ends_at: float
    owed: int
    patience: float

    def forbids(self, other: Transaction) -> bool:
        """Whether a late response could be taken for the response to `other`.

        A late exception response fits any quantity, so only unit and function count. Before and after the change of an
        address nothing may be owed by its unit: it would come from the new address. A request to address 0 that
        expects a response must be the only one on the line.
        """
        request = self.request
        if not other.expects_answer:
            return False
        if other.unit == BROADCAST_UNIT:
            return True
        is_same_unit = request.unit == other.device.unit
        is_same_function = request.asked.function == other.asked.function
        if request.answers_from is None or other.answers_from is None:
            return is_same_unit or is_same_function
        return is_same_unit and is_same_function


class LateWindows:
    """The late windows of a line, each of this many seconds; None: as long as the device's answer times say."""

    def __init__(self, seconds: float | None) -> None:
        self.windows: list[_Window] = []
        self._seconds = seconds

    def length(self, limit: float, answer_time: AnswerTime) -> float:
        """How long after its limit a response may come: by default twice the limit, or the device's longest time."""
        return max(2 * limit, answer_time.slowest) if self._seconds is None else self._seconds

    def end_of(self, transaction: Transaction, now: float) -> float:
        """When the window of a transaction ends that fails at `now`; it begins at its limit at the earliest."""
        ends_at = max(now, transaction.fails_at) + self.length(transaction.limit, transaction.device.answer_time)
        return max(ends_at, transaction.ends_at + transaction.patience)

    def open(
        self, request: SentRequest, expected: Expected, ends_at: float, owed: int = 1, patience: float = 0.0
    ) -> None:
        """Until `ends_at`, `owed` responses to `request` may come that look like `expected`.

        An `Overdue` request does not tell its device: `patience` is for how many seconds any response may come from it.
        """
        self.windows.append(_Window(request, expected, ends_at, owed, patience))

    def overdue(self, now: float) -> list[Overdue]:
        """The open windows, for the next line on the same port."""
        self._close_ended(now)
        return [
            Overdue(each.request.unit, each.request.answers_from, each.request.asked.data, each.owed, each.ends_at)
            for each in self.windows
        ]

    def count(self, now: float) -> int:
        """How many windows are open."""
        self._close_ended(now)
        return len(self.windows)

    def forbid_until(self, transaction: Transaction, now: float) -> float | None:
        """When `transaction` may be sent, if a window forbids it now."""
        self._close_ended(now)
        return max((window.ends_at for window in self.windows if window.forbids(transaction)), default=None)

    def changes_until(self, units: Collection[int], now: float) -> float:
        """Return until when a device with one of the `units` may still change its address; 0 if none may."""
        self._close_ended(now)
        changes = [each for each in self.windows if each.request.answers_from is None and each.request.unit in units]
        return max((each.ends_at for each in changes), default=0.0)

    def expected(self) -> list[Expected]:
        """The late responses that may come."""
        return [window.expected for window in self.windows]

    def heads_of_others(self, unit: int) -> list[bytes]:
        """The first bytes of late responses from units other than `unit`."""
        requests = [window.request for window in self.windows if window.request.unit != unit]
        return [bytes((each.unit, each.asked.function | bit)) for each in requests for bit in (0, EXCEPTION_BIT)]

    def extend(self, token: Token, asked_at: float, patience: Callable[[AnswerTime], float]) -> None:
        """Extend the windows that this response fits: another client, too, awaits one that looks the same.

        It asked at `asked_at`; its response may come for as long after that as `patience` tells of a device.
        """
        for window in self.windows:
            request = window.request
            if request.accepts(token.frame):
                lasts = window.patience if isinstance(request, Overdue) else patience(request.device.answer_time)
                window.ends_at = max(window.ends_at, asked_at + lasts)

    def take(self, token: Token) -> SentRequest | None:
        """The oldest request that this is a late response to, or None. The last response closes its window."""
        self._close_ended(token.at)
        for window in self.windows:
            is_later = token.start >= window.expected.since and not token.is_damaged
            if is_later and window.request.accepts(token.frame):
                window.owed -= 1
                if not window.owed:
                    self.windows.remove(window)
                return window.request
        return None

    def next_end(self) -> float | None:
        """When the next window ends."""
        return min((window.ends_at for window in self.windows), default=None)

    def _close_ended(self, now: float) -> None:
        self.windows = [window for window in self.windows if window.ends_at > now]
