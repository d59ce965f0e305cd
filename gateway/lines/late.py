"""Late windows: after a time-out, the time in which the answer may still come and must not be taken for another one.

RTU and ASCII frames carry no transaction identifier. A response that comes after its limit looks exactly like the
response to the next request of the same shape. So until it has come, or can hardly come any more, no request with the
same function goes to that unit. Other functions and other units go on.
"""

from typing import Final, NamedTuple

from gateway.lines.overheard import has_begun
from gateway.lines.transaction import Transaction
from gateway.modbus.chartime import Mode
from gateway.modbus.codes import BROADCAST_UNIT, EXCEPTION_BIT
from gateway.modbus.frame import Frame, ResponseFramer

#: A request that a window forbids waits if the window ends within so many seconds. Otherwise it fails at once, so that
#: a client that polls one unit after the other does not freeze.
WORTH_WAITING: Final = 0.250


class LateResponse(NamedTuple):
    """A response that came after its limit."""

    transaction: Transaction
    frame: Frame


class _Window:
    """The time in which `owed` answers may still come; `framer` has received what came of them so far."""

    def __init__(self, transaction: Transaction, framer: ResponseFramer, ends_at: float, owed: int) -> None:
        self.transaction = transaction
        self.framer = framer
        self.ends_at = ends_at
        self.owed = owed

    def forbids(self, other: Transaction) -> bool:
        """Whether an answer that is late for this one could be taken for the answer to `other`.

        A late exception fits any quantity, so only unit and function count. Nobody answers a broadcast; who is asked at
        address 0 must be the only one that may speak.
        """
        mine = self.transaction
        if not other.expects_answer:
            return False
        if other.unit == BROADCAST_UNIT:
            return True
        if mine.asked.function != other.asked.function:
            return False
        return mine.answers_from is None or other.answers_from is None or mine.unit == other.device.unit


class LateWindows:
    """The late windows of a line."""

    def __init__(self, mode: Mode) -> None:
        self.windows: list[_Window] = []
        self._mode = mode

    def open(self, transaction: Transaction, framer: ResponseFramer, ends_at: float, owed: int = 1) -> None:
        """Until `ends_at` so many answers to `transaction` may come; `framer` is looking for them."""
        self.windows.append(_Window(transaction, framer, ends_at, owed))

    def take_over(self, others: "LateWindows") -> None:
        """Await what `others` have awaited."""
        self.windows += others.windows

    def count(self, now: float) -> int:
        """How many windows are open."""
        self._close_ended(now)
        return len(self.windows)

    def forbid_until(self, transaction: Transaction, now: float) -> float | None:
        """When `transaction` may be sent, if a window forbids it now."""
        self._close_ended(now)
        return max((window.ends_at for window in self.windows if window.forbids(transaction)), default=None)

    def has_begun_in(self, heard: bytes, unit: int, now: float) -> bool:
        """Whether a late answer of a unit other than `unit` begins somewhere in `heard`."""
        self._close_ended(now)
        return any(
            has_begun(self._mode, heard, bytes((window.transaction.unit, function)))
            for window in self.windows
            if window.transaction.unit != unit
            for function in (window.transaction.asked.function, window.transaction.asked.function | EXCEPTION_BIT)
        )

    def awaits(self, frame: Frame) -> bool:
        """Whether `frame` is one of the late answers."""
        return any(window.transaction.accepts(frame) for window in self.windows)

    def received(self, data: bytes, now: float, others: list[Frame]) -> list[LateResponse]:
        """Take bytes that the line delivers; responses that are complete with them. The last one closes its window.

        `others` are frames among them that answer other clients' requests.
        """
        self._close_ended(now)
        return [
            late
            for window in self.windows.copy()
            for late in self._take(window, window.framer.received(data, now), others)
        ]

    def tick(self, now: float) -> list[LateResponse]:
        """Let time pass; responses that silence has ended."""
        self._close_ended(now)
        return [late for window in self.windows.copy() for late in self._take(window, window.framer.tick(now), [])]

    def deadline(self) -> float | None:
        """When `tick` wants to be called, or None."""
        deadlines = (window.framer.deadline() for window in self.windows)
        return min((deadline for deadline in deadlines if deadline is not None), default=None)

    def next_end(self) -> float | None:
        """When the next window ends."""
        return min((window.ends_at for window in self.windows), default=None)

    def _take(self, window: _Window, frames: list[Frame], others: list[Frame]) -> list[LateResponse]:
        late = []
        for frame in frames:
            if frame in others:
                others.remove(frame)
            elif window.owed and window.transaction.accepts(frame):
                window.owed -= 1
                late.append(LateResponse(window.transaction, frame))
        if not window.owed:
            self.windows.remove(window)
        return late

    def _close_ended(self, now: float) -> None:
        self.windows = [window for window in self.windows if window.ends_at > now]
