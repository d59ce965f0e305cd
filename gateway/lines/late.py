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
from gateway.modbus.pdu import RequestPdu, parse_request

#: A request that a window forbids waits if the window ends within so many seconds. Otherwise it fails at once, so that
#: a client that polls one unit after the other does not freeze.
WORTH_WAITING: Final = 0.250


class Overdue(NamedTuple):
    """What an earlier line on the same port has asked: `pdu` of `unit`. So many answers may come until `ends_at`.

    `answers_from` is who may answer; None when that is not known.
    """

    unit: int
    answers_from: int | None
    pdu: bytes
    owed: int
    ends_at: float

    @property
    def asked(self) -> RequestPdu:
        """What was asked."""
        return parse_request(self.pdu)

    def accepts(self, frame: Frame) -> bool:
        """Whether `frame` is an answer: see Transaction."""
        return self.answers_from in (None, frame.unit) and self.asked.accepts(frame.pdu)


#: What was asked, by this line or by an earlier one.
Question = Transaction | Overdue


class LateResponse(NamedTuple):
    """A response that came after its limit."""

    question: Question
    frame: Frame


class _Window:
    """The time in which `owed` answers may still come; `framer` has received what came of them so far."""

    def __init__(self, question: Question, framer: ResponseFramer, ends_at: float, owed: int) -> None:
        self.question = question
        self.framer = framer
        self.ends_at = ends_at
        self.owed = owed

    def forbids(self, other: Transaction) -> bool:
        """Whether an answer that is late for this one could be taken for the answer to `other`.

        A late exception fits any quantity, so only unit and function count. Nobody answers a broadcast; who is asked at
        address 0 must be the only one that may speak.
        """
        mine = self.question
        if not other.expects_answer:
            return False
        if other.unit == BROADCAST_UNIT:
            return True
        if mine.asked.function != other.asked.function:
            return False
        return mine.answers_from is None or other.answers_from is None or mine.unit == other.device.unit

    def overdue(self) -> Overdue:
        """What another line has to know of it."""
        asked = self.question
        return Overdue(asked.unit, asked.answers_from, asked.asked.data, self.owed, self.ends_at)


class LateWindows:
    """The late windows of a line."""

    def __init__(self, mode: Mode) -> None:
        self.windows: list[_Window] = []
        self._mode = mode

    def open(self, question: Question, framer: ResponseFramer, ends_at: float, owed: int = 1) -> None:
        """Until `ends_at` so many answers to `question` may come; `framer` is looking for them."""
        self.windows.append(_Window(question, framer, ends_at, owed))

    def overdue(self, now: float) -> list[Overdue]:
        """What is awaited, for a line that follows on the same port."""
        self._close_ended(now)
        return [window.overdue() for window in self.windows]

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
            has_begun(self._mode, heard, bytes((window.question.unit, function)))
            for window in self.windows
            if window.question.unit != unit
            for function in (window.question.asked.function, window.question.asked.function | EXCEPTION_BIT)
        )

    def awaits(self, frame: Frame) -> bool:
        """Whether `frame` is one of the late answers."""
        return any(window.question.accepts(frame) for window in self.windows)

    def extend(self, frame: Frame, until: float) -> None:
        """What `frame` looks like may come once more, until then."""
        for window in self.windows:
            if window.question.accepts(frame):
                window.ends_at = max(window.ends_at, until)

    def received(self, data: bytes, now: float, others: list[Frame], *, damaged: bool = False) -> list[LateResponse]:
        """Take bytes that the line delivers; responses that are complete with them. The last one closes its window.

        `others` are frames among them that answer other clients' requests. A frame is the answer to one question only:
        to the oldest one that it fits.
        """
        self._close_ended(now)
        taken = others.copy()
        return [
            late
            for window in self.windows.copy()
            for late in self._take(window, window.framer.received(data, now, damaged=damaged), taken)
        ]

    def tick(self, now: float) -> list[LateResponse]:
        """Let time pass; responses that silence has ended."""
        self._close_ended(now)
        taken: list[Frame] = []
        return [late for window in self.windows.copy() for late in self._take(window, window.framer.tick(now), taken)]

    def deadline(self) -> float | None:
        """When `tick` wants to be called, or None."""
        deadlines = (window.framer.deadline() for window in self.windows)
        return min((deadline for deadline in deadlines if deadline is not None), default=None)

    def next_end(self) -> float | None:
        """When the next window ends."""
        return min((window.ends_at for window in self.windows), default=None)

    def _take(self, window: _Window, frames: list[Frame], taken: list[Frame]) -> list[LateResponse]:
        """Those of `frames` that `window` awaits. Every window hears all of `taken` too, which others were given."""
        late, given = [], taken.copy()
        for frame in frames:
            if frame in given:
                given.remove(frame)
            elif window.owed and window.question.accepts(frame):
                window.owed -= 1
                taken.append(frame)
                late.append(LateResponse(window.question, frame))
        if not window.owed:
            self.windows.remove(window)
        return late

    def _close_ended(self, now: float) -> None:
        self.windows = [window for window in self.windows if window.ends_at > now]
