"""The requests that were sent on one connection, by transaction identifier, and which of them a response answers.

    under way ──response──▶ answered
        └──limit──▶ outstanding ──late response──▶ dropped, or the answer to a read that is sent again

An identifier (T 4.2.2) is not used again while a response with it may come. So a response always belongs to its own
request (ADR 6). Where the server answers with identifier 0, only one request is under way, and no other response can
come on its connection (`connection`).
"""

from collections.abc import Callable
from math import inf
from typing import Final

from gateway.lines.queue import WaitingQueue
from gateway.lines.telling import Telling
from gateway.lines.transaction import Destination, Transaction
from gateway.modbus.frame import Frame
from gateway.modbus.mbap import NO_UNIT, TcpFrame, encode

_IDENTIFIERS: Final = 0x10000


class InFlight:
    """Requests `under_way`, and those that are `outstanding`: past their limits, or without an expected response.

    Reads that are sent again may wait in `queue`. `recovered` is called with each device that has responded.
    """

    def __init__(
        self, queue: WaitingQueue, telling: Telling, recovered: Callable[[Destination], None], *, is_zero: bool
    ) -> None:
        self.under_way: dict[int, Transaction] = {}
        self.outstanding: dict[int, Transaction] = {}
        #: The units to which a part of a write to bits is under way.
        self.in_turn: set[int] = set()
        #: Number of responses without a request on their connection.
        self.unasked = 0
        self._queue = queue
        self._telling = telling
        self._recovered = recovered
        self._is_zero = is_zero
        #: Bytes received in place of responses, by identifier.
        self._instead: dict[int, bytes] = {}
        #: The clients and devices of the requests under way.
        self._asking: set[tuple[str, Destination]] = set()
        #: No request under way fails before that: they have limits of their own, and are not in their order.
        self._next_limit = inf
        self._last = 0

    def add(self, transaction: Transaction) -> int:
        """Add a request that is about to be sent, with its times set. Return its identifier."""
        identifier = self._free_identifier()
        if not transaction.expects_answer:  # the server may respond nevertheless
            self.outstanding[identifier] = transaction
            return identifier
        fails_at = transaction.fails_at
        if fails_at < self._next_limit or not self.under_way:
            self._next_limit = fails_at
        self.under_way[identifier] = transaction
        if transaction.is_of_bits:
            self.in_turn.add(transaction.unit)
        for request in transaction.requests:
            self._asking.add((request.caller.client, transaction.device))
        return identifier

    def take(self, frame: TcpFrame, now: float) -> Transaction | None:
        """Return the transaction that `frame` answers; None if the frame is dropped."""
        identifier = frame.transaction
        if self._is_zero and identifier == 0 and self.under_way:
            identifier = next(iter(self.under_way))  # there is only one
        asked = self.under_way.get(identifier)
        if asked is not None and answers(frame, asked):
            self.finish(identifier)
            asked.count_response(now)
            self._telling.record_sent(asked, frame.pdu, now)
            self._recovered(asked.device)
            return asked
        late = self.outstanding.get(identifier)
        if late is not None and answers(frame, late):
            del self.outstanding[identifier]
            self._recovered(late.device)
            return self._take_late(frame, late, now)
        self._drop(frame, identifier, asked or late, now)
        return None

    def _take_late(self, frame: TcpFrame, late: Transaction, now: float) -> Transaction | None:
        """Take a late response. Return its transaction if it is sent again: its clients still wait for this response.

        Responses to the other sendings of a read that was answered are expected, unless they show that a limit is too
        short. A device that sleeps is late each time.
        """
        repeat = next((each for each, one in self.under_way.items() if one.requests is late.requests), None)
        if repeat is not None:
            self.give_up(repeat)
        is_awaited = repeat is not None or bool(self._queue.drop(lambda waiting: waiting.requests is late.requests))
        is_answered = is_awaited or late.requests[0].error is None
        if late.expects_answer and now >= late.fails_at and not (late.wakes and is_answered):
            self._telling.late_response(late, now)
            self._telling.record_frame(frame.unit, frame.pdu, "a late response", now)
        if not is_awaited:
            return None
        late.counts.responses += 1
        late.times.answered_at = now
        self._telling.record_sent(late, frame.pdu, now)
        return late

    def _drop(self, frame: TcpFrame, identifier: int, expected: Transaction | None, now: float) -> None:
        """Count a frame that is no response. It may have come in place of the response to a request under way."""
        meant: int | None = identifier
        if expected is None:
            self.unasked += 1
            meant = next((each for each, one in self.under_way.items() if answers(frame, one)), None)
        else:
            self._telling.foreign(Frame(frame.unit, frame.pdu), expected)
        if meant in self.under_way:
            self._instead.setdefault(meant, encode(*frame))
        else:
            self._telling.record_frame(frame.unit, frame.pdu, "nobody", now)

    def finish(self, identifier: int) -> bytes:
        """Remove a request under way. Return the bytes received instead of its response."""
        transaction = self.under_way.pop(identifier)
        if transaction.is_of_bits:
            self.in_turn.discard(transaction.unit)
        for request in transaction.requests:
            self._asking.discard((request.caller.client, transaction.device))
        return self._instead.pop(identifier, b"") if self._instead else b""

    def give_up(self, identifier: int) -> bytes:
        """Let a request under way become outstanding. Return the bytes received instead of its response."""
        self.outstanding[identifier] = self.under_way[identifier]
        return self.finish(identifier)

    def is_asking(self, transaction: Transaction) -> bool:
        """Tell whether another request of one of its clients to its device is under way."""
        if not self._asking:
            return False
        for request in transaction.requests:  # noqa: SIM110 - request path: a generator costs more than the rest
            if (request.caller.client, transaction.device) in self._asking:
                return True
        return False

    def is_asked(self, unit: int) -> bool:
        """Tell whether a request to this unit is under way, by whichever of its devices in the config."""
        return any(each.unit == unit for each in self.under_way.values())

    def next_limit(self) -> float:
        """Return when the next request under way fails, or an earlier time; infinity if there is none."""
        return self._next_limit if self.under_way else inf

    def expired(self, now: float) -> list[int]:
        """Return the identifiers of the requests under way whose limits have ended, in the order of sending."""
        if now < self._next_limit:
            return []
        late = [identifier for identifier, each in self.under_way.items() if each.fails_at <= now]
        self._next_limit = min((each.fails_at for each in self.under_way.values() if each.fails_at > now), default=inf)
        return late

    def awaited(self, now: float) -> list[bytes]:
        """Return the identifiers, in two bytes, of requests within their limits."""
        return [identifier.to_bytes(2, "big") for identifier, each in self.under_way.items() if now < each.fails_at]

    def lose(self) -> list[Transaction]:
        """Forget everything: no response can come any more. Return the requests that were under way."""
        lost = list(self.under_way.values())
        for kept in (self.under_way, self._instead, self.outstanding, self._asking, self.in_turn):
            kept.clear()
        return lost

    def _free_identifier(self) -> int:
        """Choose the next identifier for which no response may come."""
        identifier = self._last
        while True:
            identifier = (identifier + 1) % _IDENTIFIERS
            if identifier not in self.under_way and identifier not in self.outstanding:
                self._last = identifier
                return identifier


def answers(frame: TcpFrame, asked: Transaction) -> bool:
    """Tell whether `frame`, which has the identifier of `asked`, is its response."""
    return (frame.unit == asked.unit or frame.unit in NO_UNIT) and asked.asked.accepts(frame.pdu)
