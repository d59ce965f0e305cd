"""The state machine of an upstream: requests to units behind another Modbus TCP server, several at a time.

    waiting ──a place is free──▶ under way ──response──▶ answered
       ▲                             ├──limit──▶ 0B
       └──────a read's repeat────────┘

`in_flight` knows whose a response is. What differs from a line: several requests are under way; a response names its
request, so that late ones forbid nothing; a read is repeated at once, and a late response to it answers it still.

The connection is closed while nobody needs it (`idle`), and made anew before the next request if it cannot be used for
that one (`must_renew`).

There is no I/O here: frames, time and requests are arguments, and `deadline` is when to call `tick`. An upstream
finishes its own state before it answers requests, because an answer may cause the next request at once.
"""

from collections.abc import Callable, Iterable
from math import inf
from typing import Final

from gateway import errors
from gateway.errors import RequestError
from gateway.events import Emit
from gateway.lines.queue import WaitingQueue
from gateway.lines.reopening import Reopening
from gateway.lines.telling import Telling
from gateway.lines.transaction import Destination, Transaction
from gateway.lines.waiting import Waiting
from gateway.modbus.frame import Frame
from gateway.modbus.mbap import TcpFrame
from gateway.ports.port import OpenAgain
from gateway.timing.budget import limit_behind_server
from gateway.trace.ring import Ring
from gateway.upstreams.in_flight import InFlight, answers
from gateway.upstreams.settings import UpstreamSettings

#: After this many requests without a response, a new connection is opened: late responses cannot come on it.
MAX_OUTSTANDING: Final = 4096

#: Sends a request with its transaction identifier.
Send = Callable[[int, Transaction], None]
#: Reads what has arrived, before a request is sent: see `port_up`.
Look = Callable[[], None]


def _see_nothing() -> None:
    """Do nothing: there is no connection to read from."""


class Upstream:
    """One connection to another server and its transactions.

    A client's requests to one unit are sent one at a time, so that they keep their order. So are all requests to a unit
    that has failed, until it responds.
    """

    def __init__(self, settings: UpstreamSettings, emit: Emit, ring: Ring | None = None) -> None:
        self.settings = settings
        #: Number of responses without a request on their connection.
        self.unasked_frames = 0
        #: Number of time-outs, one after the other, since anything was received.
        self.silences = 0
        self._telling = Telling(settings.name, settings.source, emit, "tcp", ring)
        self._queue = WaitingQueue(settings.queue, settings.max_wait, coalesce=settings.coalesce)
        self._reopening = Reopening(self._queue, settings.max_wait, _limit_of, settings.after_connect)
        self._waiting = Waiting(self._queue, self._reopening, self._telling, settings.rest)
        self._sent = InFlight()
        self._send_request: Send | None = None
        self._look: Look = _see_nothing
        self._is_zero = settings.transaction_id == "zero"
        #: Whether a response on this connection could be taken for that to the next request.
        self._is_spoilt = False
        #: When the last request was over, and when the next one may be sent.
        self._used_at = 0.0
        self._free_at = 0.0
        self._silent_at = 0.0
        self._failed_at: dict[Destination, float] = {}

    def port_up(self, send: Send, now: float, look: Look = _see_nothing) -> None:
        """Use `send` from now on: the connection is open. The next `tick` sends waiting requests.

        `look` is called before a request is sent while none is under way: it delivers what has arrived, and may tell
        that the connection has ended.
        """
        self._send_request = send
        self._look = look
        self._used_at = now
        self._is_spoilt = False
        if not self.is_closed:
            self._failed_at.clear()
            self._waiting.end_rests()
        self._reopening.end()

    def port_down(self, now: float) -> None:
        """End the lost connection: requests under way fail with 0B, as units may have acted on them, others with 0A."""
        waiting = self._disconnect()
        self._lose_under_way(now)
        self._waiting.fail_unsent(waiting, now)

    def finish(self, now: float) -> None:
        """Accept no more requests: waiting ones fail with 0A, those under way may still be answered."""
        self._waiting.fail_unsent(self._disconnect(), now)

    def renew(self, now: float) -> None:
        """Keep waiting requests for a new connection: this one is being closed. Requests under way fail with 0B."""
        self._send_request = None
        self._look = _see_nothing
        self._reopening.begin(now)
        self.tick(now)
        self._lose_under_way(now)

    def port_ended(self, open_again: OpenAgain, now: float, *, at_once: bool = False) -> None:
        """End a connection that its server has closed in order; `at_once` after it was opened, or later.

        If nothing is under way, that is no loss: it is opened again for waiting requests, or for the next one. But a
        connection that ends at once while requests wait is a loss: they would wait in vain.
        """
        is_empty = not len(self._queue)
        if self._send_request is not None and not self._sent.under_way and (is_empty or not at_once):
            self.renew(now)
        if self.is_closed:
            self._reopening.ended(open_again, is_needed=not is_empty)

    @property
    def is_closed(self) -> bool:
        """Whether there is no connection because none is needed."""
        return self._reopening.is_on

    def submit(self, transaction: Transaction, now: float) -> None:
        """Take over a transaction: it is sent in its turn, or fails."""
        if not self._sent.under_way:
            self._look()
        if self._send_request is None and not self.is_closed:
            self._waiting.refuse(transaction, errors.LineDown(), now)
        elif transaction.device.breaker.is_resting(now):
            self._waiting.refuse(transaction, errors.UnitResting(), now)
        elif self._send_request is not None and not len(self._queue) and self._may_send(transaction, now):
            self._send(transaction, self._send_request, now)
        else:
            self._put(transaction, now)

    def received(self, frames: Iterable[TcpFrame], now: float) -> None:
        """Take frames.

        Raises:
            NotModbus: the server does not speak Modbus TCP, so the connection is unusable. Responses before that count.
        """
        self.silences = 0
        taken: list[tuple[Transaction, bytes]] = []
        try:
            for frame in frames:
                answered = self._take(frame, now)
                if answered is not None:
                    taken.append((answered, frame.pdu))
            self._go_on(now)
        finally:
            for transaction, pdu in taken:
                transaction.respond(pdu, now)

    def unsent(self, identifier: int, now: float) -> None:
        """Fail the request with this identifier, which was not delivered, with 0A; do nothing if it has ended."""
        transaction = self._sent.under_way.get(identifier)
        if transaction is not None:
            self._sent.finish(identifier)
            try:
                self._go_on(now)
            finally:
                self._waiting.fail_unsent([transaction], now)

    def forget_late(self) -> None:
        """Forget all late responses: none can come any more."""
        self._sent.outstanding.clear()

    def spoil(self) -> None:
        """Note that more came than responses, where identifiers do not tell whose it is."""
        self._is_spoilt = self._is_zero

    def deadline(self) -> float | None:
        """Return when to call `tick`, or None."""
        deadline = self._sent.next_limit()
        if len(self._queue):
            deadline = min(deadline, self._queue.next_expiry() or inf)
            if self._free_at > self._used_at and not self._sent.under_way and self._send_request is not None:
                deadline = min(deadline, self._free_at)
        if self._reopening.until is not None:
            deadline = min(deadline, self._reopening.until)
        elif self.settings.idle:
            deadline = min(deadline, self._leaves_at())
        return None if deadline == inf else deadline

    def tick(self, now: float) -> None:
        """Let time pass: time limits may have ended."""
        failed: list[tuple[Transaction, RequestError]] = []
        for identifier in self._sent.expired(now):
            transaction = self._sent.under_way[identifier]
            error = self._give_up(identifier, transaction, now)
            if error is not None:
                failed.append((transaction, error))
        unconnected = self._reopening.given_up(now)
        try:
            self._waiting.fail_unsent(unconnected, now)
            self._go_on(now)
        finally:
            for transaction, error in failed:
                transaction.fail_sent(error, now)

    @property
    def waiting(self) -> int:
        """Number of requests that wait to be sent."""
        return len(self._queue)

    @property
    def under_way(self) -> int:
        """Number of requests that were sent and are within their limits."""
        return len(self._sent.under_way)

    def awaited(self, now: float) -> list[bytes]:
        """Return the identifiers, in two bytes, of requests within their limits."""
        return self._sent.awaited(now)

    @property
    def overdue(self) -> int:
        """Number of late responses that may come."""
        return len(self._sent.outstanding)

    @property
    def is_spent(self) -> bool:
        """Whether too many late responses may come on this connection."""
        return len(self._sent.outstanding) >= MAX_OUTSTANDING

    @property
    def must_renew(self) -> bool:
        """Whether a new connection is needed before the next request."""
        return not self._sent.under_way and (self._is_spoilt or self.is_spent) and self._send_request is not None

    def may_leave(self, now: float) -> bool:
        """Tell whether the connection may be closed until the next request, because nobody has asked for so long."""
        return self._leaves_at() <= now

    def _leaves_at(self) -> float:
        is_idle = self._send_request is not None and not self._sent.under_way and not len(self._queue)
        return self._used_at + self.settings.idle if is_idle and self.settings.idle else inf

    def _put(self, transaction: Transaction, now: float) -> None:
        """Keep a transaction until its turn."""
        refusal = self._waiting.keep(transaction, now)
        if refusal is not None:
            self._waiting.refuse(transaction, refusal, now)
        elif self._send_request is None:
            self._reopening.need(transaction)
        else:
            self._go_on(now)

    def _take(self, frame: TcpFrame, now: float) -> Transaction | None:
        """Find the transaction that `frame` answers; None if the frame is dropped."""
        sent, identifier = self._sent, frame.transaction
        if self._is_zero and identifier == 0 and sent.under_way:
            identifier = next(iter(sent.under_way))  # there is only one
        asked = sent.under_way.get(identifier)
        if asked is not None and answers(frame, asked):
            sent.finish(identifier)
            self._rest_connection(now)
            asked.count_response(now)
            self._telling.record_sent(asked, frame.pdu, now)
            self._recover(asked.device)
            return asked
        self.spoil()
        late = sent.outstanding.get(identifier)
        if late is not None and answers(frame, late):
            return self._take_late(frame, late, now)
        expected = asked or late
        meant: int | None = identifier
        if expected is None:
            self.unasked_frames += 1
            meant = sent.is_meant(frame)
        else:
            self._telling.foreign(Frame(frame.unit, frame.pdu), expected)
        if meant in sent.under_way:
            sent.heard_instead(meant, frame)
        return None

    def _take_late(self, frame: TcpFrame, late: Transaction, now: float) -> Transaction | None:
        """Take a late response. Return its transaction if it is repeated: its clients still wait for this response."""
        sent = self._sent
        del sent.outstanding[frame.transaction]
        self._recover(late.device)
        repeat = sent.repeat_of(late)
        if repeat is not None:
            sent.give_up(repeat)
            self._rest_connection(now)
        is_awaited = repeat is not None or self._queue.drop(lambda waiting: waiting.requests is late.requests)
        if not (is_awaited and late.wakes):
            self._telling.late_response(late, now)
        if not is_awaited:
            return None
        self._telling.record_sent(late, frame.pdu, now)
        return late

    def _give_up(self, identifier: int, transaction: Transaction, now: float) -> RequestError | None:
        """End a request at its limit. Return the error for its clients; None if it is sent again."""
        instead = self._sent.give_up(identifier)
        self._rest_connection(now)
        self.spoil()
        if transaction.ends_at >= self._silent_at:
            self.silences += 1
            self._silent_at = now
        may_repeat = self._send_request is not None and transaction.asked.only_reads and transaction.is_wanted
        if may_repeat and transaction.wakes:
            again = transaction.part(transaction.requests)
            again.wakes = True
        else:
            self._record_failure(transaction, now)
            if not may_repeat or transaction.retries >= self.settings.retries:
                return self._fail(transaction, instead, now)
            again = transaction.again()
        self._telling.record_failed(transaction, None, now, instead)
        again.gives_up_at = inf  # it is sent at once, or its connection has a limit of its own
        self._queue.put_back(again)
        return None

    def _record_failure(self, transaction: Transaction, now: float) -> None:
        """Count a failure of the unit. Those of requests that were under way together count as one."""
        device = transaction.device
        if transaction.ends_at >= self._failed_at.get(device, 0.0):
            self._failed_at[device] = now
            self._waiting.count_failure(transaction, now, now)

    def _fail(self, transaction: Transaction, instead: bytes, now: float) -> RequestError:
        self._telling.given_up(transaction, now, received=instead, is_echo=False)
        error: RequestError = errors.BrokenResponse() if instead else errors.ResponseTimeout()
        self._telling.record_failed(transaction, error, now, instead)
        return error

    def _lose_under_way(self, now: float) -> None:
        """Fail all requests under way: no response to any request can come any more."""
        for transaction in self._sent.lose():
            self._telling.record_failed(transaction, errors.LineLost(), now)
            transaction.fail_sent(errors.LineLost(), now)

    def _disconnect(self) -> list[Transaction]:
        """Stop sending: there is no connection. Return the requests that waited for one."""
        self._send_request = None
        self._look = _see_nothing
        self._reopening.end()
        return self._queue.clear()

    def _rest_connection(self, now: float) -> None:
        """Note that a request is over: the silence before the next one begins."""
        self._used_at = now
        self._free_at = now + self.settings.gap

    def _has_place(self, now: float) -> bool:
        """Tell whether one more request may be sent now."""
        return (
            len(self._sent.under_way) < self.settings.in_flight
            and now >= self._free_at
            and not self._is_spoilt
            and not self.is_spent
        )

    def _may_send(self, transaction: Transaction, now: float) -> bool:
        return self._has_place(now) and transaction.is_wanted and not self._must_wait(transaction)

    def _must_wait(self, transaction: Transaction) -> bool:
        if self._sent.is_asking(transaction):
            return True
        device = transaction.device
        return device.breaker.failures > 0 and self._sent.is_asked(device)

    def _go_on(self, now: float) -> None:
        """Send waiting requests while there is place, and fail those that have waited too long."""
        queue = self._queue
        if not len(queue):
            return
        late = queue.expired(now)
        try:
            if not self._sent.under_way:
                self._look()
            while self._send_request is not None and self._has_place(now):
                transaction = queue.take_repeat() or queue.take(self._must_wait)
                if transaction is None:
                    break
                self._send_or_refuse(transaction, self._send_request, now)
        finally:
            self._waiting.fail_expired(late, now)

    def _send_or_refuse(self, transaction: Transaction, send: Send, now: float) -> None:
        """Send a request that has waited, unless something has changed since. A rest stops no repeat."""
        if not transaction.is_wanted:
            self._waiting.refuse(transaction, transaction.unwanted, now)
        elif transaction.device.breaker.is_resting(now) and not transaction.is_repeat:
            self._waiting.refuse(transaction, errors.UnitResting(), now)
        else:
            self._send(transaction, send, now)

    def _send(self, transaction: Transaction, send: Send, now: float) -> None:
        transaction.sent_at = transaction.ends_at = now
        transaction.limit = _limit_of(transaction)
        identifier = self._sent.add(transaction)
        transaction.count_sent(now)
        if transaction.expects_answer:
            send(identifier, transaction)
            return
        self._rest_connection(now)
        self.spoil()
        send(identifier, transaction)
        self._telling.record_sent(transaction, None, now)
        transaction.end()

    def _recover(self, device: Destination) -> None:
        self._failed_at.pop(device, None)
        self._waiting.recover(device)

    def __repr__(self) -> str:
        state = f"under way={self.under_way}"
        if self._send_request is None:
            state = "closed" if self.is_closed else "down"
        return f"<Upstream {self.settings.name} {state} waiting={self.waiting}>"


def _limit_of(transaction: Transaction) -> float:
    return limit_behind_server(transaction.asked, transaction.device.answer_time)
