"""Whose a frame is that was heard on a line: every frame has one owner, and nothing else decides what is believed.

A response does not say which request it answers, nor who asked. So what stands on a line is read by these rules, in
this order; the first that fits says whose the frame is (ADR 5):

| owner            | rule                                                                                           |
|------------------|------------------------------------------------------------------------------------------------|
| the request      | it fits the request under way, began behind it, and is the first that does. If another         |
|                  | client's request may have got it, it is doubted: the answer is not believed, and the next      |
|                  | rules say whose it is                                                                          |
| another client   | it answers the oldest request of another client that it fits: one response for each request    |
| a late answer    | it fits the oldest of our requests whose answer is overdue, and began behind it                |
| an echo          | it is what we have sent, and may have been returned by the adapter; see `_is_echo`             |
| another's request| it reads as a request: another client has asked                                                |
| nobody           | everything else                                                                                |

A frame with a damaged byte in it answers nothing. As a request it counts: the device may have got it undamaged.
"""

from collections import deque
from collections.abc import Callable, Iterator
from typing import Final, Literal, NamedTuple

from gateway.errors import RequestError
from gateway.lines.late import LateWindows, Question
from gateway.lines.transaction import Transaction
from gateway.modbus.codes import BROADCAST_UNIT, EXCEPTION_BIT
from gateway.modbus.frame import Frame
from gateway.modbus.functions import KNOWN_FUNCTIONS
from gateway.modbus.pdu import RequestPdu, parse_request
from gateway.modbus.scan import NEVER, Token
from gateway.timing.budget import AnswerTime

#: So many requests of other clients to one unit are remembered.
_PER_UNIT: Final = 16
#: One to a unit that is never asked by us is forgotten after so many seconds.
_LONGEST: Final = 300.0


#: Whose a frame is.
Owner = Literal["the request", "another client", "a late answer", "an echo", "another's request", "nobody"]


class ForeignRequest(NamedTuple):
    """Another client's request, when it was heard, and the place of its end."""

    at: float
    end: int
    frame: Frame
    asked: RequestPdu


class Attribution:
    """Knows what was asked on a line, by us and by others, and says whose each frame is.

    `windows` are those of our own late answers. `patience(asked, answer_time)` is after how many seconds nothing can
    answer another client's `asked` any more, if its unit is the one that we ask. `foreign` are the unanswered
    requests of other clients by unit, `doubts` those that the answer to the request under way may belong to.
    """

    def __init__(self, windows: LateWindows, patience: Callable[[RequestPdu, AnswerTime], float]) -> None:
        self.foreign: dict[int, deque[ForeignRequest]] = {}
        self.doubts: list[ForeignRequest] = []
        #: Of how many requests in a row a copy was heard beside the answer.
        self.echoes_in_a_row = 0
        self._windows = windows
        self._patience = patience
        #: The late answer that was attributed last.
        self.late: Question
        #: What was asked last, where and when; whether its answer is awaited, or where that ended; whether it has come.
        self._asked: Transaction | None = None
        self._began = 0.0
        self._began_at = 0
        self._is_asking = False
        self._ended_at = 0
        self._is_answered = False
        #: Copies of it that were heard beside its answer; whether one that comes late is an echo, and until when one is
        #: that comes soon; whether the one that an adapter makes has come.
        self._copies = 0
        self._echoes = False
        self._echo_until = 0.0
        self._had_echo = False

    def begin(self, transaction: Transaction, now: float, position: int, echo_until: float, *, echoes: bool) -> None:
        """The request goes on the line, where so many bytes have come.

        A copy of it that comes before `echo_until` is an echo, and so is a later one where the adapter is known to make
        them (`echoes`).
        """
        self.echoes_in_a_row = self.echoes_in_a_row + 1 if self._copies else 0
        self._copies = 0
        self._echoes = echoes
        self._echo_until = echo_until
        self._had_echo = False
        self._asked = transaction
        self._began, self._began_at = now, position
        self._is_asking = transaction.expects_answer
        self._ended_at = NEVER
        self._is_answered = False
        if self.doubts:
            self.doubts = []
        if self.foreign:
            self._forget(transaction, now)

    def end(self, position: int) -> None:
        """The request is not awaited any more, where so many bytes have come. Some of them may still be shown."""
        self._is_asking = False
        self._ended_at = min(self._ended_at, position)

    def owner(self, token: Token) -> Owner:
        """Whose the frame is. Each one is shown once, in the order in which they came."""
        if self._answers_request(token):
            return "the request"
        if self._answers_other_client(token):
            return "another client"
        if self._is_late(token):
            return "a late answer"
        if self._is_echo(token):
            return "an echo"
        return "another's request" if self._is_request(token) else "nobody"

    def unanswered(self) -> Iterator[ForeignRequest]:
        """What other clients have asked and nobody has answered yet."""
        return (request for requests in self.foreign.values() for request in requests)

    def may_be_others(self, transaction: Transaction) -> bool:
        """Whether another client waits for an answer of the unit that this one asks."""
        if self.doubts or not self.foreign:
            return bool(self.doubts)
        return transaction.answers_from is None or transaction.unit in self.foreign

    def _answers_request(self, token: Token) -> bool:
        asked = self._asked
        if asked is None or not self._is_asking or token.is_damaged:
            return False
        if token.start < asked.expected.since or not asked.accepts(token.frame):
            return False
        doubts = self._doubts_about(token.frame, asked) if self.foreign else []
        is_answer, self._is_answered = not (doubts or self._is_answered), True
        self.doubts += doubts
        return is_answer

    def _doubts_about(self, frame: Frame, asked: Transaction) -> list[ForeignRequest]:
        """Others' requests that `frame` may answer. One for the same as ours, heard since, has the same answer.

        Only the function counts: an exception fits any quantity, and another client may ask again for another one.
        """
        sent = asked.unit, asked.asked.data
        function = frame.pdu[0] & ~EXCEPTION_BIT
        return [
            request
            for unit in {frame.unit, asked.unit}
            for request in self.foreign.get(unit, ())
            if request.asked.function == function
            and request.at + self._patience(request.asked, asked.device.answer_time) >= self._began
            and (request.frame != sent or request.end <= self._began_at)
        ]

    def _answers_other_client(self, token: Token) -> bool:
        """Where one of our own late answers may look the same, it may have been that one.

        Then the other is still to come, and the window lasts until it cannot come any more.
        """
        frame = token.frame
        for request in self.foreign.get(frame.unit, ()):
            asked = request.asked
            is_repeated = frame.pdu == asked.data != asked.response_head
            if not is_repeated and not token.is_damaged and asked.accepts(frame.pdu):
                self.foreign[frame.unit].remove(request)
                self._drop_empty(frame.unit)
                if self._asked is not None and self._windows.windows:
                    patience = self._patience(asked, self._asked.device.answer_time)
                    self._windows.extend(token, request.at + patience)
                return True
        return False

    def _is_late(self, token: Token) -> bool:
        question = self._windows.take(token) if self._windows.windows else None
        if question is not None:
            self.late = question
        return question is not None

    def _is_echo(self, token: Token) -> bool:
        """Whether it is what we have sent, a second copy of its answer, or an answer to a broadcast.

        Each request has one echo. What can be its response too is taken for one, and so is what comes so soon that
        nobody else can have sent it; else another client asks the same, unless the adapter is known to echo.
        """
        frame, asked = token.frame, self._asked
        if asked is None or frame.pdu != asked.asked.data or asked.unit not in (frame.unit, BROADCAST_UNIT):
            return False
        is_echo_shaped = asked.asked.accepts(frame.pdu)
        self._copies += self._is_asking or is_echo_shaped
        if is_echo_shaped:
            return True
        if asked.expects_answer and token.start >= self._ended_at:
            return False  # it comes too late to be told from another client's request
        is_first, self._had_echo = not self._had_echo, True
        return is_first and (self._echoes or token.at < self._echo_until)

    def _is_request(self, token: Token) -> bool:
        frame = token.frame
        try:
            asked = parse_request(frame.pdu)
        except RequestError:
            return False
        if asked.function not in KNOWN_FUNCTIONS:
            return False
        request = ForeignRequest(token.at, token.end, frame, asked)
        self.foreign.setdefault(frame.unit, deque(maxlen=_PER_UNIT)).append(request)
        return True

    def _forget(self, asked: Transaction, now: float) -> None:
        """Forget what can be answered no more. How long units may take that we do not ask now is not known."""
        for unit, requests in list(self.foreign.items()):
            while requests:
                answer_time = asked.device.answer_time
                patience = self._patience(requests[0].asked, answer_time) if unit == asked.unit else _LONGEST
                if requests[0].at + patience >= now:
                    break
                requests.popleft()
            self._drop_empty(unit)

    def _drop_empty(self, unit: int) -> None:
        if not self.foreign[unit]:
            del self.foreign[unit]
