"""The state machine of an upstream: requests to units behind another Modbus TCP server, several at a time.

    waiting ──a place is free──▶ under way ──response──▶ answered
       ▲                             ├──limit──▶ 0B
       └──────a read's repeat────────┘

`in_flight` knows whose a response is, `connection` when a request may be sent on it. `lines/waiting` says what differs
from a line.

There is no I/O here: frames, time and requests are arguments, and `deadline` is when to call `tick`. An upstream
finishes its own state before it answers requests, because an answer may cause the next request at once.
"""

from collections.abc import Iterable
from math import inf
from typing import Final

from gateway import errors
from gateway.errors import RequestError
from gateway.events import Emit
from gateway.lines.queue import WaitingQueue
from gateway.lines.reopening import Reopening
from gateway.lines.telling import Telling
from gateway.lines.transaction import Destination, TakesTransactions, Transaction
from gateway.lines.waiting import Waiting
from gateway.modbus.mbap import TcpFrame
from gateway.ports.port import OpenAgain
from gateway.timing.budget import limit_behind_server
from gateway.trace.ring import Ring
from gateway.upstreams.connection import Connection, Look, Send, see_nothing
from gateway.upstreams.in_flight import InFlight
from gateway.upstreams.settings import UpstreamSettings

#: After this many requests without a response, a new connection is opened: late responses cannot come on it.
MAX_OUTSTANDING: Final = 4096


class Upstream(TakesTransactions):
    """One connection to another server and its transactions.

    A client's requests to one unit are sent one at a time, so that they keep their order. So are all requests to a unit
    that has failed, until it responds, or while bits are written there by a read and a write.
    """

    def __init__(self, settings: UpstreamSettings, emit: Emit, ring: Ring | None = None) -> None:
        self.settings = settings
        #: Number of time-outs, one after the other, since anything was received.
        self.silences = 0
        self._telling = Telling(settings.name, settings.source, emit, "tcp", ring)
        self._queue = WaitingQueue(settings.queue, settings.max_wait, coalesce=settings.coalesce)
        self._reopening = Reopening(self._queue, settings.max_wait, _limit_of, settings.after_connect)
        self._waiting = Waiting(self._queue, self._reopening, self._telling, settings.rest)
        is_zero = settings.transaction_id == "zero"
        self._sent = InFlight(self._queue, self._telling, self._recover, is_zero=is_zero)
        self._connection = Connection(settings)
        self._is_looking = False
        self._silent_at = 0.0
        self._failed_at: dict[Destination, float] = {}
        #: Writes that should have followed reads, and have no connection.
        self._cut_off: list[Transaction] = []

    def port_up(self, send: Send, now: float, look: Look = see_nothing) -> None:
        """Use `send` from now on: the connection is open. The next `tick` sends waiting requests.

        `look` is called before a request is sent while none is under way: it delivers what has arrived, and may tell
        that the connection has ended.
        """
        self._connection.open(send, look, now)
        if not self.is_closed:
            self._end_rests()
        self._reopening.end(now)

    def leave_address(self) -> None:
        """Forget the time-outs of the address that was used: another one is tried from now on."""
        self.silences = 0
        for device in self._failed_at:
            device.breaker.record_success()
        self._end_rests()

    def port_down(self, now: float) -> None:
        """End the lost connection: requests under way fail with 0B, as units may have acted on them, others with 0A."""
        waiting = self._disconnect(now)
        self._lose_under_way(now)
        self._waiting.fail_unsent(waiting, now)

    def finish(self, now: float) -> None:
        """Accept no more requests: waiting ones fail with 0A, those under way may still be answered."""
        self._waiting.refusals.tell(inf)
        self._waiting.fail_unsent(self._disconnect(now), now)

    def renew(self, now: float) -> None:
        """Keep waiting requests for a new connection: this one is being closed. Requests under way fail with 0B."""
        self._connection.close()
        self._reopening.begin(now)
        self.tick(now)
        self._lose_under_way(now)

    def port_ended(self, open_again: OpenAgain, now: float, *, at_once: bool = False) -> None:
        """End a connection that its server has closed in order; `at_once` after it was opened, or later.

        If nothing is under way, that is no loss: it is opened again for waiting requests, or for the next one. But a
        connection that ends at once while requests wait is a loss: they would wait in vain.
        """
        is_empty = not len(self._queue)
        if self._connection.send is not None and not self._sent.under_way and (is_empty or not at_once):
            self.renew(now)
        if self.is_closed:
            self._reopening.ended(open_again, is_needed=not is_empty)

    @property
    def is_closed(self) -> bool:
        """Whether there is no connection because none is needed."""
        return self._reopening.is_on

    def submit(self, transaction: Transaction, now: float) -> None:
        """Take over a transaction: it is sent in its turn, or fails."""
        connection = self._connection
        if not self._sent.under_way:
            connection.look()
        if connection.send is None and not self.is_closed:
            self._waiting.refuse(transaction, errors.LineDown(), now)
        elif transaction.device.breaker.is_resting(now):
            self._waiting.refuse(transaction, errors.UnitResting(), now)
        elif connection.send is not None and self._may_send_at_once(transaction, now):
            self._send(transaction, connection.send, now)
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
                answered = self._sent.take(frame, now)
                if answered is None:
                    self._connection.spoil()
                    self._connection.be_silent(now)
                else:
                    self._connection.rest(now)
                    taken.append((answered, frame.pdu))
                    following = answered.following(frame.pdu)
                    if following is not None:
                        self._follow(following)
            self._go_on(now)
        finally:
            for transaction, pdu in taken:
                transaction.respond(pdu, now)
            if self._cut_off:
                cut_off, self._cut_off = self._cut_off, []
                self._waiting.fail_unsent(cut_off, now)

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
        """Note that more came than responses: see `Connection.spoil`."""
        self._connection.spoil()

    def deadline(self) -> float | None:
        """Return when to call `tick`, or None."""
        deadline = self._sent.next_limit()
        if len(self._queue):
            deadline = min(deadline, self._queue.next_expiry() or inf)
            if deadline > self._connection.free_at() and not self._sent.under_way:
                deadline = self._connection.free_at()
        until = self._reopening.until
        deadline = min(deadline, self._waiting.refusals.tells_at, self._leaves_at() if until is None else until)
        return None if deadline == inf else deadline

    def tick(self, now: float) -> None:
        """Let time pass: time limits may have ended."""
        if now >= self._waiting.refusals.tells_at:
            self._waiting.refusals.tell(now)
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

    @property
    def unasked_frames(self) -> int:
        """Number of responses without a request on their connection."""
        return self._sent.unasked

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
        connection = self._connection
        return not self._sent.under_way and (connection.is_spoilt or self.is_spent) and connection.send is not None

    @property
    def is_unused(self) -> bool:
        """Whether no request is over yet on this connection."""
        return self._connection.is_unused

    def may_leave(self, now: float) -> bool:
        """Tell whether the connection may be closed until the next request, because nobody has asked for so long."""
        return self._leaves_at() <= now

    def _leaves_at(self) -> float:
        return inf if self._sent.under_way or len(self._queue) else self._connection.leaves_at()

    def _put(self, transaction: Transaction, now: float) -> None:
        """Keep a transaction until its turn."""
        refusal = self._waiting.keep(transaction, now)
        if refusal is not None:
            self._waiting.refuse(transaction, refusal, now)
        elif self._connection.send is None:
            self._reopening.need(transaction)
        else:
            self._go_on(now)

    def _follow(self, following: Transaction) -> None:
        """Have the write sent that follows a read, before all that waits; without a connection it fails."""
        if self._connection.send is None and not self.is_closed:
            self._cut_off.append(following)
            return
        following.gives_up_at = inf  # as in `_give_up`
        self._queue.put_back(following)

    def _give_up(self, identifier: int, transaction: Transaction, now: float) -> RequestError | None:
        """End a request at its limit. Return the error for its clients; None if it is sent again."""
        instead = self._sent.give_up(identifier)
        self._connection.rest(now)
        self._connection.spoil()
        if transaction.ends_at >= self._silent_at:
            self.silences += 1
            self._silent_at = now
        may_send = self.is_closed or self._connection.send is not None
        may_repeat = may_send and transaction.asked.only_reads and transaction.is_wanted
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

    def _disconnect(self, now: float) -> list[Transaction]:
        """Stop sending: there is no connection. Return the requests that waited for one."""
        self._connection.close()
        self._reopening.end(now)
        return self._queue.clear()

    def _has_place(self, now: float) -> bool:
        """Tell whether one more request may be sent now."""
        is_free = len(self._sent.under_way) < self.settings.in_flight and self._connection.is_free(now)
        return is_free and not self.is_spent

    def _may_send_at_once(self, transaction: Transaction, now: float) -> bool:
        """Tell whether a new request need not wait, not even for its turn."""
        return (
            not len(self._queue) and self._has_place(now) and transaction.is_wanted and not self._must_wait(transaction)
        )

    def _must_wait(self, transaction: Transaction) -> bool:
        if self._sent.is_asking(transaction):
            return True
        unit = transaction.unit
        if self._sent.in_turn and unit in self._sent.in_turn:
            return True
        has_failed = transaction.device.breaker.failures > 0
        return (has_failed or transaction.is_of_bits) and self._sent.is_asked(unit)

    def _go_on(self, now: float) -> None:
        """Send waiting requests while there is place, and fail those that have waited too long."""
        queue = self._queue
        if not len(queue) or self._is_looking:
            return
        late = queue.expired(now)
        try:
            if not self._sent.under_way and self._has_place(now):
                self._look()
            while (send := self._connection.send) is not None and self._has_place(now):
                transaction = queue.take_repeat() or queue.take(self._must_wait)
                if transaction is None:
                    break
                self._send_or_refuse(transaction, send, now)
        finally:
            if late:
                self._waiting.fail_expired(late, now)

    def _look(self) -> None:
        """Read what has arrived, once: a server may send without end."""
        self._is_looking = True
        try:
            self._connection.look()
        finally:
            self._is_looking = False

    def _send_or_refuse(self, transaction: Transaction, send: Send, now: float) -> None:
        """Send a request that has waited, unless something has changed since. A rest stops no repeat."""
        if not transaction.is_wanted:
            self._waiting.refuse(transaction, transaction.unwanted, now)
        elif transaction.device.breaker.is_resting(now) and not transaction.is_repeat:
            self._waiting.refuse(transaction, errors.UnitResting(), now)
        else:
            self._send(transaction, send, now)

    def _send(self, transaction: Transaction, send: Send, now: float) -> None:
        transaction = transaction.opening()
        transaction.sent_at = transaction.ends_at = now
        transaction.asked_at = transaction.asked_at or now
        transaction.limit = _limit_of(transaction)
        identifier = self._sent.add(transaction)
        transaction.count_sent(now)
        if transaction.expects_answer:
            send(identifier, transaction)
            return
        self._connection.rest(now)
        self._connection.spoil()
        send(identifier, transaction)
        self._telling.record_sent(transaction, None, now)
        transaction.end()

    def _end_rests(self) -> None:
        self._failed_at.clear()
        self._waiting.end_rests()

    def _recover(self, device: Destination) -> None:
        self._failed_at.pop(device, None)
        self._waiting.recover(device)

    def __repr__(self) -> str:
        state = f"under way={self.under_way}"
        if self._connection.send is None:
            state = "closed" if self.is_closed else "down"
        return f"<Upstream {self.settings.name} {state} waiting={self.waiting}>"


def _limit_of(transaction: Transaction) -> float:
    return limit_behind_server(transaction.asked, transaction.device.answer_time)
