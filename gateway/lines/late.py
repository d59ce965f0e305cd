"""Late windows: after a time-out, the time in which the answer may still come and must not be taken for another one.

RTU and ASCII frames carry no transaction identifier. A response that comes after its limit looks exactly like the
response to the next request of the same shape. So until it has come, or can hardly come any more, no request with the
same function goes to that unit. Other functions and other units go on.
"""

from typing import Final, NamedTuple

from gateway.lines.transaction import Transaction
from gateway.modbus.codes import BROADCAST_UNIT, EXCEPTION_BIT
from gateway.modbus.frame import Frame
from gateway.modbus.pdu import RequestPdu, parse_request
from gateway.modbus.scan import Expected, Token
from gateway.timing.budget import AnswerTime

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
    """The time in which `owed` answers may still come that look like `expected`."""

    def __init__(self, question: Question, expected: Expected, ends_at: float, owed: int) -> None:
        self.question = question
        self.expected = expected
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
    """The late windows of a line, of so many seconds; None: as the device's answer times say."""

    def __init__(self, seconds: float | None) -> None:
        self.windows: list[_Window] = []
        self._seconds = seconds

    def length(self, limit: float, answer_time: AnswerTime) -> float:
        """How long after its limit an answer may come: by default twice that, or the device's slowest answer."""
        return max(2 * limit, answer_time.slowest) if self._seconds is None else self._seconds

    def end_of(self, transaction: Transaction, now: float) -> float:
        """Until when its late answer is awaited, from the end of its limit on, also if it has failed before."""
        return max(now, transaction.fails_at) + self.length(transaction.limit, transaction.device.answer_time)

    def open(self, question: Question, expected: Expected, ends_at: float, owed: int = 1) -> None:
        """Until `ends_at` so many answers to `question` may come, which look like `expected`."""
        self.windows.append(_Window(question, expected, ends_at, owed))

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

    def expected(self) -> list[Expected]:
        """What the late answers look like."""
        return [window.expected for window in self.windows]

    def heads_of_others(self, unit: int, now: float) -> list[bytes]:
        """How the late answers of units other than `unit` begin."""
        self._close_ended(now)
        return [
            bytes((window.question.unit, function))
            for window in self.windows
            if window.question.unit != unit
            for function in (window.question.asked.function, window.question.asked.function | EXCEPTION_BIT)
        ]

    def extend(self, token: Token, until: float) -> None:
        """What this looks like may come once more, until then."""
        for window in self.windows:
            if window.question.accepts(token.frame):
                window.ends_at = max(window.ends_at, until)

    def take(self, token: Token) -> Question | None:
        """The oldest question that this answers, late; None if there is none. The last answer closes its window."""
        self._close_ended(token.at)
        for window in self.windows:
            began = token.start >= window.expected.since and not token.is_damaged
            if began and window.owed and window.question.accepts(token.frame):
                window.owed -= 1
                if not window.owed:
                    self.windows.remove(window)
                return window.question
        return None

    def next_end(self) -> float | None:
        """When the next window ends."""
        return min((window.ends_at for window in self.windows), default=None)

    def _close_ended(self, now: float) -> None:
        self.windows = [window for window in self.windows if window.ends_at > now]
