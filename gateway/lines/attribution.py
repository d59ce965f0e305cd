"""Which request each received frame belongs to: every frame has one owner, and nothing else decides that.

A response does not say which request it answers, nor whose. So the first of these rules that fits counts (ADR 5):

| owner            | rule                                                                                           |
|------------------|------------------------------------------------------------------------------------------------|
| the request      | it is the first that fits the request on the line and began after it; the request ends there.  |
|                  | If it may answer another client's request, it is ambiguous: it is not believed, and the next   |
|                  | rules find its owner                                                                           |
| another client   | it fits a request of another client: the oldest, and one response for each request             |
| a late response  | it fits a request of ours whose response is overdue, the oldest, and began after it            |
| an echo          | it is a copy of our request that may come from the adapter; see `_is_echo`                     |
| another's request| it can be read as a request: another client has sent it                                        |
| nobody           | everything else                                                                                |

A frame with a damaged byte is no response. It counts as a request, because the device may have received it undamaged,
unless it looks like the response to our request and nobody else was ever heard.

Some frames can be read both ways: `01 03 10 00 18` is a read of 24 coils, and a response with 24 coils. For five
minutes after another client was heard, such a frame is not believed: it counts as a request, and answers none. It is
no evidence of another client.
"""

from collections import deque
from collections.abc import Callable
from functools import partial
from math import inf
from typing import Final, Literal, NamedTuple

from gateway.errors import RequestError
from gateway.lines.late import LateWindows, Overdue, SentRequest
from gateway.lines.overheard import Overheard
from gateway.lines.transaction import Transaction
from gateway.modbus.codes import BROADCAST_UNIT, EXCEPTION_BIT, FunctionCode
from gateway.modbus.explain import explain_pdu
from gateway.modbus.frame import Frame
from gateway.modbus.functions import KNOWN_FUNCTIONS, request_size, response_size
from gateway.modbus.pdu import RequestPdu, parse_request, parse_sent
from gateway.modbus.scan import NEVER, Token
from gateway.timing.budget import AnswerTime

#: At most this many requests of other clients to one unit are kept.
_PER_UNIT: Final = 16
#: A request to a unit that we send none to is kept for this many seconds. For as long after any request, another client
#: may be there.
_LONGEST: Final = 300.0

#: Functions with frames that can be read both ways, unless the response repeats its request. A response to others has
#: another size than any request, an even byte count (03, 04), or an odd length in place of the reference type 6 (20).
_TWOFOLD: Final = frozenset(
    {
        FunctionCode.READ_COILS,
        FunctionCode.READ_DISCRETE_INPUTS,
        FunctionCode.DIAGNOSTICS,
        FunctionCode.READ_WRITE_MULTIPLE_REGISTERS,
    }
)

#: See the table above.
Owner = Literal["the request", "another client", "a late response", "an echo", "another's request", "nobody"]


class ForeignRequest(NamedTuple):
    """Another client's request, when it was received, and the place of its end."""

    at: float
    end: int
    frame: Frame
    asked: RequestPdu


class Attribution:
    """Knows the requests on a line, ours and other clients', and finds the owner of each frame.

    `windows` are our late windows. `patience(asked, answer_time)` is for how many seconds a response to another
    client's request may come from the unit that we ask. `foreign` are other clients' requests without a response, by
    unit, `doubts` those that the response to our request may belong to. `overheard` has the counters of other frames.
    """

    def __init__(self, windows: LateWindows, patience: Callable[[RequestPdu, AnswerTime], float]) -> None:
        self.foreign: dict[int, deque[ForeignRequest]] = {}
        self.doubts: list[ForeignRequest] = []
        self.overheard = Overheard()
        #: Whether another client, or a copy of our requests, was ever heard.
        self.is_shared = False
        #: The latest request that shows another client, and until when that may be there.
        self.other_client: Overdue | None = None
        #: Called when another client's request was heard.
        self.heard_asker: Callable[[], None] | None = None
        #: Where our last request ended; NEVER while it is on the line.
        self.ended_at: int
        #: Of how many requests in a row a copy was received besides the response.
        self.echoes_in_a_row = 0
        self._windows = windows
        self._patience = patience
        #: The request of the last late response.
        self.late: SentRequest
        #: Our last request; where it was sent; whether it is on the line; whether its response has come.
        self._asked: Transaction | None = None
        self._place: int
        self._is_on_line: bool
        self._is_answered: bool
        #: Copies of it that were received besides the response; until when one is an echo; whether that has come.
        self._copies = 0
        self._echo_until: float
        self._had_echo: bool

    def begin(self, transaction: Transaction, position: int, echo_until: float) -> None:
        """The request is sent at this place. A copy of it before `echo_until` is an echo."""
        self.echoes_in_a_row = self.echoes_in_a_row + 1 if self._copies else 0
        self._copies = 0
        self._echo_until = echo_until
        self._had_echo = False
        self._asked = transaction
        self.overheard.count_sent()
        self._place = position
        self._is_on_line = transaction.expects_answer
        self.ended_at = NEVER
        self._is_answered = False
        if self.doubts:
            self.doubts = []
        if self.foreign:
            self._forget(transaction)

    def end(self, position: int) -> None:
        """The request is over at this place. Frames from before it may still follow."""
        self._is_on_line = False
        self.ended_at = min(self.ended_at, position)

    def owner(self, token: Token) -> Owner:
        """The owner of a frame. To be called once for each, in order."""
        is_twofold = self._is_twofold(token)
        if self._answers_request(token, is_twofold=is_twofold):
            return "the request"
        if self._is_damaged_response(token):
            return "nobody"
        return self._other_owner(token, is_twofold=is_twofold)

    def expect_client(self, request: Overdue) -> None:
        """An earlier line has heard this request of another client."""
        if self.other_client is None or self.other_client.ends_at < request.ends_at:
            self.other_client = request

    def is_alone(self, now: float) -> bool:
        """Whether no other client was heard for so long that none is there any more."""
        return self.other_client is None or now >= self.other_client.ends_at

    def foreign_requests(self) -> list[ForeignRequest]:
        """Other clients' requests without a response."""
        return [request for requests in self.foreign.values() for request in requests]

    def may_be_others(self, transaction: Transaction) -> bool:
        """Whether another client waits for a response of the same unit."""
        if transaction.answers_from is None:
            return bool(self.foreign)
        return transaction.unit in self.foreign

    def _other_owner(self, token: Token, *, is_twofold: bool) -> Owner:
        """The owner of a frame that is not the response to our request."""
        self._count_copy(token)
        if not (is_twofold or self._is_stripped(token)):
            if self._answers_other_client(token):
                return "another client"
            if self._is_late(token):
                return "a late response"
        if not (is_twofold and self._was_refused(token)) and self._is_echo(token):
            return "an echo"
        if self._is_request(token, is_sure=not _is_request_and_response(token.frame.pdu)):
            return "another's request"
        self._count_stray_response(token)
        return "nobody"

    def _is_twofold(self, token: Token) -> bool:
        """Whether it may be a response or a request: another client asks here, and the frame can be read both ways."""
        other = self.other_client
        return other is not None and token.at < other.ends_at and _is_request_and_response(token.frame.pdu)

    def _answers_request(self, token: Token, *, is_twofold: bool) -> bool:
        asked = self._asked
        if asked is None or not self._is_on_line or token.is_damaged:
            return False
        if token.start < asked.expected.since or not asked.accepts(token.frame):
            return False
        self.end(token.end)
        self._is_answered = True
        if self._echo_until == inf and asked.expected.since > self._place:
            self._had_echo = True  # the scanner has removed it
        if self.foreign or self.doubts:
            self.doubts = self._doubts_about(token.frame, asked)
        if is_twofold:
            self.doubts.append(ForeignRequest(token.at, token.end, token.frame, parse_request(token.frame.pdu)))
        return not self.doubts

    def _doubts_about(self, frame: Frame, asked: Transaction) -> list[ForeignRequest]:
        """Other clients' requests that `frame` may answer: not one that equals ours and came later."""
        return [
            request
            for unit in {frame.unit, asked.unit}
            for request in self.foreign.get(unit, ())
            if _may_answer(frame.pdu, request.asked)
            and request.at + self._patience(request.asked, asked.device.answer_time) >= asked.sent_at
            and (request.end <= self._place or not asked.is_copy(request.frame))
        ]

    def _is_damaged_response(self, token: Token) -> bool:
        """Whether it is the response to our request with a damaged byte, and nobody else was ever heard."""
        asked = self._asked
        if not token.is_damaged or asked is None or not self._is_on_line or self.is_shared or self._echo_until == inf:
            return False
        return token.start >= asked.expected.since and asked.accepts(token.frame)

    def _is_stripped(self, token: Token) -> bool:
        """Whether it is our echo, which comes before the response, if there is one: it answers nobody."""
        asked = self._asked
        if asked is None or not asked.is_copy(token.frame):
            return False
        if not asked.expects_answer:
            return self._echo_until == inf and not self._had_echo
        return self._place <= token.start and token.end <= asked.expected.since

    def _answers_other_client(self, token: Token) -> bool:
        """If one of our late responses looks the same, this may have been that one: its window is extended.

        It may answer an earlier sending of the request on the line, too: then another client's is still awaited.
        """
        frame, ours = token.frame, self._asked
        is_ours_too = ours is not None and self._is_on_line and ours.outstanding > 1 and ours.accepts(frame)
        for request in self.foreign.get(frame.unit, ()):
            asked = request.asked
            is_repeated = frame.pdu == asked.data != asked.response_head
            is_over = token.at > request.at + _LONGEST
            if not (is_repeated or is_over or token.is_damaged) and asked.accepts(frame.pdu):
                if is_ours_too:
                    return True
                self.foreign[frame.unit].remove(request)
                self._drop_empty(frame.unit)
                self._windows.extend(token, request.at, partial(self._patience, asked))
                return True
        return False

    def _is_late(self, token: Token) -> bool:
        request = self._windows.take(token) if self._windows.windows else None
        if request is not None:
            self.late = request
        return request is not None

    def _was_refused(self, token: Token) -> bool:
        """Whether it has ended our request, but may be another client's, or for another client."""
        return bool(self.doubts) and token.end == self.ended_at

    def _is_echo(self, token: Token) -> bool:
        """Whether it is a copy of our request that came from the adapter, or a response to a broadcast.

        A request has one echo: a copy that comes so soon that nobody else can have sent it. Any other copy is another
        client's request, unless the adapter is known to echo. That includes a second copy of a response that is equal
        to its request (05, 06): if another client has sent it, one more follows.
        """
        asked = self._asked
        if asked is None or token.start < self._place or not _is_repeated(asked, token.frame):
            return False
        may_be_response = asked.asked.accepts(token.frame.pdu)
        is_first, self._had_echo = not self._had_echo, True
        is_over = token.start >= self.ended_at
        if may_be_response and not is_over:
            return True  # it came too early for the response
        if is_over and not may_be_response:
            return False
        is_echo = is_first and token.at < self._echo_until
        if is_echo:
            self.overheard.count_copy(token.at)
        return is_echo

    def _count_copy(self, token: Token) -> None:
        """Count a frame that is a copy of our request and not the response to it."""
        asked = self._asked
        if asked is None or token.start < self._place or not _is_repeated(asked, token.frame):
            return
        if self._was_refused(token):
            return  # it may be the response
        if self._is_on_line or asked.asked.accepts(token.frame.pdu):
            self._copies += 1
            self.is_shared = True

    def _is_request(self, token: Token, *, is_sure: bool) -> bool:
        """Whether it can be read as a request. One that is not sure proves no other client."""
        frame = token.frame
        try:
            asked = parse_sent(frame.pdu)
        except RequestError:
            return False
        if asked.function not in KNOWN_FUNCTIONS:
            return False
        at, ours = token.at, self._asked
        is_copy = ours is not None and ours.is_copy(frame)
        if ours is not None and is_copy:
            self.overheard.count_copy(token.at)
            at = max(at, ours.ends_at)  # the response that follows may be ours
        elif is_sure and not self._may_be_response(frame):
            self.overheard.count_request(token.at)
        self.is_shared = True
        self._await_response(ForeignRequest(at, token.end, frame, asked))
        may_be_response = is_copy and asked.accepts(frame.pdu)
        if is_sure and not may_be_response:
            self.other_client = Overdue(frame.unit, frame.unit, frame.pdu, 0, token.at + _LONGEST)
            if self.heard_asker is not None:
                self.heard_asker()
        return True

    def _may_be_response(self, frame: Frame) -> bool:
        """Whether it may as well be the response to ours with another value: a device limits what is written."""
        ours = self._asked
        if ours is None or not self._is_on_line or frame.unit != ours.unit:
            return False
        return explain_pdu(ours.asked, frame.pdu) != ""

    def _await_response(self, request: ForeignRequest) -> None:
        """Remember another client's request. If there are too many, one that may be a response goes first."""
        requests = self.foreign.setdefault(request.frame.unit, deque())
        if len(requests) >= _PER_UNIT:
            requests.remove(next((each for each in requests if _is_request_and_response(each.frame.pdu)), requests[0]))
        requests.append(request)

    def _count_stray_response(self, token: Token) -> None:
        """A frame without an owner may be a second response to our last request, or come after its late window."""
        asked = self._asked
        if asked is None or token.start < self.ended_at or token.is_damaged or not asked.accepts(token.frame):
            return
        if self._is_answered:
            self.overheard.count_second_response(token.frame.unit)
            asked.device.counts.record("twice", token.at)
        else:
            self.overheard.count_belated(token.frame.unit, token.at - asked.ends_at, asked.limit)
            asked.device.counts.record("late", token.at)

    def _forget(self, asked: Transaction) -> None:
        """Forget requests that nothing can answer any more. The answer times of other units are not known here."""
        for unit, requests in list(self.foreign.items()):
            while requests:
                answer_time = asked.device.answer_time
                patience = self._patience(requests[0].asked, answer_time) if unit == asked.unit else _LONGEST
                if requests[0].at + patience >= asked.sent_at:
                    break
                requests.popleft()
            self._drop_empty(unit)

    def _drop_empty(self, unit: int) -> None:
        if not self.foreign[unit]:
            del self.foreign[unit]


def _is_repeated(asked: Transaction, frame: Frame) -> bool:
    """Whether `frame` is a copy of the request; of a broadcast, from any unit."""
    return frame.pdu == asked.asked.data and asked.unit in (frame.unit, BROADCAST_UNIT)


def _is_request_and_response(pdu: bytes) -> bool:
    """Whether a PDU is a valid request, and may be a response that does not repeat its request.

    That is so for 17 to 24 coils or discrete inputs (01, 02), a counter that is 0 (08), and five or more registers of
    function 23.
    """
    if pdu[0] not in _TWOFOLD or not len(pdu) == request_size(pdu) == response_size(pdu):
        return False
    try:
        asked = parse_request(pdu)
    except RequestError:
        return False
    return asked.data != asked.response_head


def _may_answer(response: bytes, asked: RequestPdu) -> bool:
    """Whether another client may get this response.

    Mostly its function alone counts: an exception fits any quantity, and another client may repeat its request with
    another one. But where the response repeats the request (05, 06), it fits no other.
    """
    if response[0] != asked.function:
        return response[0] == asked.function | EXCEPTION_BIT
    return asked.data != asked.response_head or response == asked.data
