"""Finds the request that each received frame belongs to: every frame has one owner, decided only here.

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
unless it looks like the response to our request and no other client was ever heard.

Some frames can be read both ways: `01 03 10 00 18` is a read of 24 coils, and a response with 24 coils. For five
minutes after another client was heard, such a frame is not believed: it counts as a request, and answers none. It is
no evidence of another client.
"""

from collections.abc import Callable
from functools import partial
from math import inf
from typing import Literal

from gateway.errors import RequestError
from gateway.lines.counts import Overheard
from gateway.lines.exchange import Exchange, foreign_request
from gateway.lines.ledger import Ledger
from gateway.lines.transaction import Transaction
from gateway.modbus.codes import BROADCAST_UNIT
from gateway.modbus.explain import explain_pdu
from gateway.modbus.frame import Frame
from gateway.modbus.functions import KNOWN_FUNCTIONS
from gateway.modbus.pdu import RequestPdu, can_be_read_both_ways, parse_request, parse_sent
from gateway.modbus.scan import Token
from gateway.timing.budget import AnswerTime

#: See the table above.
Owner = Literal["the request", "another client", "a late response", "an echo", "another's request", "nobody"]


class Attribution:
    """Finds the owner of each frame on a line among the exchanges of its ledger.

    `patience(asked, answer_time)` returns for how many seconds a response to another client's request may come from the
    unit that our request goes to.
    """

    def __init__(self, ledger: Ledger, patience: Callable[[RequestPdu, AnswerTime], float]) -> None:
        #: Counters of frames that are not responses to our requests.
        self.overheard = Overheard()
        #: Whether another client, or a copy of our requests, was ever heard.
        self.is_shared = False
        #: Called when another client's request was heard.
        self.heard_other: Callable[[], None] | None = None
        #: Another client's request that the response to ours may belong to.
        self.doubt: Exchange | None = None
        #: Our exchange to which the last late response belongs.
        self.late: Exchange
        #: Consecutive requests of ours that were also received as copies.
        self.echoes_in_a_row = 0
        self._ledger = ledger
        self._patience = patience
        #: Number of copies of our last request, besides its response; the time before which one is an echo; whether
        #: that has come.
        self._copies = 0
        self._echo_until = 0.0
        self._had_echo = False

    def begin(self, ours: Exchange, position: int, echo_until: float) -> None:
        """Note that our request is sent at this place. A copy of it before `echo_until` is an echo."""
        self.echoes_in_a_row = self.echoes_in_a_row + 1 if self._copies else 0
        self._copies = 0
        self._echo_until = echo_until
        self._had_echo = False
        self.overheard.count_sent()
        self.doubt = None
        if self._ledger.heard:
            self._forget(ours.sender)
        self._ledger.begin(ours, position)

    def owner(self, token: Token) -> Owner:
        """Return the owner of a frame. Call it once for each frame, in order."""
        is_twofold = self._is_twofold(token)
        if self._answers_request(token, is_twofold=is_twofold):
            return "the request"
        if self._is_damaged_response(token):
            return "nobody"
        return self._other_owner(token, is_twofold=is_twofold)

    def is_alone(self, now: float) -> bool:
        """Tell whether no other client was heard for so long that there is probably none any more."""
        other = self._ledger.other_client
        return other is None or now >= other.ends_at

    def may_be_others(self, exchange: Exchange) -> bool:
        """Tell whether another client awaits a response of the same unit."""
        return bool(self._ledger.heard) if exchange.answers_from is None else exchange.unit in self._ledger.heard

    def _other_owner(self, token: Token, *, is_twofold: bool) -> Owner:
        """Find the owner of a frame that is not the response to our request."""
        self._count_copy(token)
        if not (is_twofold or self._is_stripped(token)):
            if self._answers_other_client(token):
                return "another client"
            if self._is_late(token):
                return "a late response"
        if not (is_twofold and self._was_refused(token)) and self._is_echo(token):
            return "an echo"
        if self._is_request(token, is_sure=not can_be_read_both_ways(token.frame.pdu)):
            return "another's request"
        self._count_stray_response(token)
        return "nobody"

    def _is_twofold(self, token: Token) -> bool:
        """Tell whether it may be a response or a request: another client is there, and it can be read both ways."""
        other = self._ledger.other_client
        return other is not None and token.at < other.ends_at and can_be_read_both_ways(token.frame.pdu)

    def _answers_request(self, token: Token, *, is_twofold: bool) -> bool:
        ours = self._ledger.last
        if ours is None or not ours.is_awaited or token.is_damaged:
            return False
        if token.start < ours.since or not ours.accepts(token.frame):
            return False
        ours.finish(token.end)
        ours.is_answered = True
        if self._echo_until == inf and ours.since > ours.place:
            self._had_echo = True  # the scanner has removed it
        if is_twofold:
            self.doubt = foreign_request(token.frame, parse_request(token.frame.pdu), token.at, token.end)
        if self._ledger.heard:
            self.doubt = self._doubt_about(token.frame, ours) or self.doubt
        return self.doubt is None

    def _doubt_about(self, frame: Frame, ours: Exchange) -> Exchange | None:
        """Find another client's request that `frame` may answer, except one that equals ours and came later."""
        transaction = ours.sender
        same_unit = self._ledger.foreign(frame.unit)
        for each in same_unit if frame.unit == ours.unit else [*same_unit, *self._ledger.foreign(ours.unit)]:
            if not each.may_get(frame.pdu):
                continue
            may_come = each.asked_at + self._patience(each.asked, transaction.device.answer_time)
            is_same = not each.is_any and each.unit == ours.unit and each.asked.data == ours.asked.data
            if may_come >= transaction.sent_at and not (is_same and each.place > ours.place):
                return each
        return None

    def _is_damaged_response(self, token: Token) -> bool:
        """Tell whether it is the response to our request with a damaged byte, and no other client was ever heard."""
        ours = self._ledger.last
        if not token.is_damaged or ours is None or not ours.is_awaited or self.is_shared or self._echo_until == inf:
            return False
        return token.start >= ours.since and ours.accepts(token.frame)

    def _is_stripped(self, token: Token) -> bool:
        """Tell whether it is our echo, which comes before any response: then it answers nobody."""
        ours = self._ledger.last
        if ours is None or not ours.is_copy(token.frame):
            return False
        if not ours.sender.expects_answer:
            return self._echo_until == inf and not self._had_echo
        return ours.place <= token.start and token.end <= ours.since

    def _answers_other_client(self, token: Token) -> bool:
        """Close the other client's request that a frame answers. Return False if there is none.

        If one of our late responses looks the same, the frame may have been that one: its window is extended. If the
        frame may also answer an earlier sending of the request on the line, the other client's request stays open.
        """
        if token.is_damaged or token.frame.unit not in self._ledger.heard:
            return False
        frame, ours = token.frame, self._ledger.last
        is_ours_too = ours is not None and ours.is_awaited and ours.owed > 1 and ours.accepts(frame)
        for each in self._ledger.foreign(frame.unit):
            asked = each.asked
            is_repeated = frame.pdu == asked.data != asked.response_head
            is_over = token.at > each.ends_at
            if is_repeated or is_over or not each.gets(frame.pdu):
                continue
            if not is_ours_too:
                self._ledger.extend(token, each, partial(self._patience, asked))
                if not (each.is_any and self._is_request(token, is_sure=False)):
                    self._ledger.answered(each)
            return True
        return False

    def _is_late(self, token: Token) -> bool:
        late = self._ledger.take_late(token) if self._ledger.late else None
        if late is not None:
            self.late = late
        return late is not None

    def _was_refused(self, token: Token) -> bool:
        """Tell whether it has ended our request, but may answer another client's."""
        return self.doubt is not None and self._ledger.last is not None and token.end == self._ledger.last.end_place

    def _is_echo(self, token: Token) -> bool:
        """Tell whether it is a copy of our request from the adapter, or a response to a broadcast.

        A request has one echo: a copy that comes so soon that nobody else can have sent it. Any other copy is another
        client's request, unless the adapter is known to echo. That includes a second copy of a response that equals its
        request (05, 06): if another client has sent it, one more follows.
        """
        ours = self._ledger.last
        if ours is None or token.start < ours.place or not _is_repeated(ours, token.frame):
            return False
        may_be_response = ours.asked.accepts(token.frame.pdu)
        is_first, self._had_echo = not self._had_echo, True
        is_over = token.start >= ours.end_place
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
        ours = self._ledger.last
        if ours is None or token.start < ours.place or not _is_repeated(ours, token.frame):
            return
        if self._was_refused(token):
            return  # it may be the response
        if ours.is_awaited or ours.asked.accepts(token.frame.pdu):
            self._copies += 1
            self.is_shared = True

    def _is_request(self, token: Token, *, is_sure: bool) -> bool:
        """Keep a frame that can be read as a request; False for others. If not `is_sure`, it proves no other client."""
        frame = token.frame
        try:
            asked = parse_sent(frame.pdu)
        except RequestError:
            return False
        if asked.function not in KNOWN_FUNCTIONS:
            return False
        at, ours = token.at, self._ledger.last
        is_copy = ours is not None and ours.is_copy(frame)
        if ours is not None and is_copy:
            self.overheard.count_copy(token.at)
            at = max(at, ours.asked_at)  # the response that follows may be ours
        elif is_sure and not self._may_be_response(frame):
            self.overheard.count_request(token.at)
        self.is_shared = True
        self._ledger.hear(foreign_request(frame, asked, at, token.end))
        may_be_response = is_copy and asked.accepts(frame.pdu)
        if is_sure and not may_be_response:
            self._ledger.other_client = foreign_request(frame, asked, token.at, token.end)
            if self.heard_other is not None:
                self.heard_other()
        return True

    def _may_be_response(self, frame: Frame) -> bool:
        """Tell whether it may be the response to ours with another value: devices may limit written values."""
        ours = self._ledger.last
        if ours is None or not ours.is_awaited or frame.unit != ours.unit:
            return False
        return explain_pdu(ours.asked, frame.pdu) != ""

    def _count_stray_response(self, token: Token) -> None:
        """Count a frame without an owner: a second response to our last request, or one after its late window."""
        ours = self._ledger.last
        if ours is None or token.start < ours.end_place or token.is_damaged or not ours.accepts(token.frame):
            return
        counts = ours.sender.device.counts
        if ours.is_answered:
            self.overheard.count_second_response(token.frame.unit)
            counts.record("twice", token.at)
        else:
            self.overheard.count_belated(token.frame.unit, token.at - ours.asked_at, ours.sender.limit)
            counts.record("late", token.at)

    def _forget(self, asked: Transaction) -> None:
        """Forget requests that nothing can answer any more. The answer times of other units are not known here."""
        answer_time, now = asked.device.answer_time, asked.sent_at
        for unit, requests in list(self._ledger.heard.items()):
            is_same = unit == asked.unit
            if is_same or requests[0].ends_at < now:
                for each in list(requests):
                    may_come = each.asked_at + self._patience(each.asked, answer_time) if is_same else each.ends_at
                    if may_come < now:
                        self._ledger.close(each)


def _is_repeated(ours: Exchange, frame: Frame) -> bool:
    """Tell whether `frame` is a copy of the request; of a broadcast, from any unit."""
    return frame.pdu == ours.asked.data and ours.unit in (frame.unit, BROADCAST_UNIT)
