"""The state machine of an upstream: requests to units behind another Modbus TCP server, several at a time.

    waiting ──a place is free──▶ under way ──response──▶ answered
                                     └──limit──▶ outstanding ──late response──▶ dropped

Every request gets a transaction identifier (T 4.2.2), which is not used again while a late response to it may come. So
a response always belongs to its own request. Nothing is repeated.

There is no I/O here: frames, time and requests are arguments, and `deadline` is when to call `tick`. An upstream
finishes its own state before it answers requests, because an answer may cause the next request at once.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Final, Literal

from gateway import errors
from gateway.errors import RequestError
from gateway.events import Emit
from gateway.lines.queue import WaitingQueue
from gateway.lines.reopening import Reopening
from gateway.lines.telling import Telling
from gateway.lines.transaction import Destination, Transaction
from gateway.modbus.frame import Frame
from gateway.modbus.mbap import NO_UNIT, TcpFrame, encode
from gateway.ports.port import OpenAgain
from gateway.timing.budget import limit_behind_server
from gateway.trace.ring import Ring

#: After this many requests without a response, a new connection is opened: late responses cannot come on it.
MAX_OUTSTANDING: Final = 4096

#: Sends a request with its transaction identifier.
Send = Callable[[int, Transaction], None]

_IDENTIFIERS: Final = 0x10000


@dataclass(frozen=True, slots=True)
class UpstreamSettings:
    """The settings of one upstream; times in seconds.

    At most `in_flight` requests are under way and `queue` more wait, each for at most `max_wait`. `gap` is the silence
    between a response and the next request. The connection is closed after `idle` seconds without a request, 0 for
    never. `rest` is the longest rest of a unit, None for the default, 0 for none. With `transaction_id` "zero", the
    server may answer with identifier 0.
    """

    name: str
    in_flight: int = 16
    gap: float = 0.0
    idle: float = 0.0
    coalesce: bool = True
    retries: int = 0
    rest: float | None = None
    queue: int = 64
    max_wait: float = 2.0
    transaction_id: Literal["checked", "zero"] = "checked"
    source: str = field(default="", compare=False)


class Upstream:
    """One connection to another server and its transactions.

    A client's requests to one unit are sent one at a time, so that they keep their order. So are all requests to a unit
    that has failed, until it responds.
    """

    def __init__(self, settings: UpstreamSettings, emit: Emit, ring: Ring | None = None) -> None:
        self.settings = settings
        #: Number of responses without a request on their connection.
        self.unasked_frames = 0
        self._telling = Telling(settings.name, settings.source, emit, "tcp", ring)
        self._queue = WaitingQueue(settings.queue, settings.max_wait, coalesce=False)
        self._reopening = Reopening(self._queue, settings.max_wait, _limit_of)
        self._send_request: Send | None = None
        #: By identifier: requests under way, oldest first; bytes received instead of responses; requests past their
        #: limits.
        self._under_way: dict[int, Transaction] = {}
        self._instead: dict[int, bytes] = {}
        self._outstanding: dict[int, Transaction] = {}
        #: The clients and devices of the requests under way.
        self._asking: set[tuple[str, Destination]] = set()
        self._failed_at: dict[Destination, float] = {}
        self._last_identifier = 0

    def port_up(self, send: Send) -> None:
        """Use `send` from now on: the connection is open. The next `tick` sends waiting requests."""
        self._send_request = send
        if not self.is_closed:
            for device in self._failed_at:
                device.breaker.record_success()
            self._failed_at.clear()
        self._reopening.end()

    def port_down(self, now: float) -> None:
        """End the lost connection: requests under way fail with 0B, as units may have acted on them, others with 0A."""
        waiting = self._disconnect()
        self._lose_under_way(now)
        self._refuse(waiting, errors.LineDown(), now)

    def finish(self, now: float) -> None:
        """Accept no more requests: waiting ones fail with 0A, those under way may still be answered."""
        self._refuse(self._disconnect(), errors.LineDown(), now)

    def renew(self, now: float) -> None:
        """Keep waiting requests for a new connection: this one is being closed. Requests under way fail with 0B."""
        self._send_request = None
        self._reopening.begin(now)
        self.tick(now)
        self._lose_under_way(now)

    def port_ended(self, open_again: OpenAgain, now: float, *, at_once: bool = False) -> None:
        """End a connection that its server has closed in order; `at_once` after it was opened, or later.

        If nothing is under way, that is no loss: it is opened again for waiting requests, or for the next one. But a
        connection that ends at once while requests wait is a loss: they would wait in vain.
        """
        is_empty = not len(self._queue)
        if self._send_request is not None and not self._under_way and (is_empty or not at_once):
            self.renew(now)
        if self.is_closed:
            self._reopening.ended(open_again, is_needed=not is_empty)

    @property
    def is_closed(self) -> bool:
        """Whether there is no connection because none is needed."""
        return self._reopening.is_on

    def submit(self, transaction: Transaction, now: float) -> None:
        """Take over a transaction: it is sent in its turn, or fails."""
        if self._send_request is None and not self.is_closed:
            self._refuse([transaction], errors.LineDown(), now)
        elif transaction.device.breaker.is_resting(now):
            self._refuse([transaction], errors.UnitResting(), now)
        else:
            lost = self._queue.put(transaction, now)
            if lost is not None:
                self._telling.queue_full(lost)
                self._refuse([lost], errors.QueueFull(), now)
            if lost is transaction:
                return
            if self._send_request is None:
                self._reopening.need(transaction)
            else:
                self._go_on(now)

    def received(self, frames: Iterable[TcpFrame], now: float) -> None:
        """Take frames.

        Raises:
            NotModbus: the server does not speak Modbus TCP, so the connection is unusable. Responses before that count.
        """
        answers: list[tuple[Transaction, bytes]] = []
        try:
            for frame in frames:
                answer = self._answer_in(frame, now)
                if answer is not None:
                    answers.append(answer)
            self._go_on(now)
        finally:
            for transaction, pdu in answers:
                transaction.respond(pdu, now)

    def unsent(self, identifier: int, now: float) -> None:
        """Fail the request with this identifier, which was not delivered, with 0A; do nothing if it has ended."""
        transaction = self._under_way.get(identifier)
        if transaction is not None:
            self._finish(identifier, transaction)
            try:
                self._go_on(now)
            finally:
                self._refuse([transaction], errors.LineDown(), now)

    def forget_late(self) -> None:
        """Forget all late responses: none can come any more."""
        self._outstanding.clear()

    def deadline(self) -> float | None:
        """Return when to call `tick`, or None."""
        oldest = next(iter(self._under_way.values()), None)
        deadlines = (
            None if oldest is None else oldest.fails_at,
            self._queue.next_expiry(),
            self._reopening.until,
        )
        return min((one for one in deadlines if one is not None), default=None)

    def tick(self, now: float) -> None:
        """Let time pass: time limits may have ended."""
        failed: list[tuple[Transaction, RequestError]] = []
        for identifier, transaction in list(self._under_way.items()):
            if now < transaction.fails_at:
                break
            failed.append((transaction, self._give_up(identifier, transaction, now)))
        unconnected = self._reopening.given_up(now)
        try:
            self._refuse(unconnected, errors.LineDown(), now)
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
        return len(self._under_way)

    def awaited(self, now: float) -> list[bytes]:
        """Return the identifiers, in two bytes, of requests within their limits."""
        waiting = (identifier for identifier, each in self._under_way.items() if now < each.fails_at)
        return [identifier.to_bytes(2, "big") for identifier in waiting]

    @property
    def overdue(self) -> int:
        """Number of late responses that may come."""
        return len(self._outstanding)

    @property
    def is_spent(self) -> bool:
        """Whether a new connection is needed: too many late responses may come on this one."""
        return len(self._outstanding) >= MAX_OUTSTANDING and not self._under_way

    def _answer_in(self, frame: TcpFrame, now: float) -> tuple[Transaction, bytes] | None:
        """Find the transaction that `frame` answers in time, with its response; None if the frame is dropped."""
        asked = self._under_way.get(frame.transaction)
        late = self._outstanding.get(frame.transaction)
        if asked is not None and _answers(frame, asked):
            self._finish(frame.transaction, asked)
            asked.count_response(now)
            self._telling.record_sent(asked, frame.pdu, now)
            self._recover(asked.device)
            return asked, frame.pdu
        if late is not None and _answers(frame, late):
            del self._outstanding[frame.transaction]
            self._telling.late_response(late, now)
            self._recover(late.device)
            return None
        expected = asked or late
        identifier: int | None = frame.transaction
        if expected is None:
            self.unasked_frames += 1
            identifier = next((each for each, one in self._under_way.items() if _answers(frame, one)), None)
        else:
            self._telling.foreign(Frame(frame.unit, frame.pdu), expected)
        if identifier in self._under_way:
            self._instead.setdefault(identifier, encode(*frame))
        return None

    def _give_up(self, identifier: int, transaction: Transaction, now: float) -> RequestError:
        """End a request at its limit. Failures of requests that were under way together count as one."""
        instead = self._finish(identifier, transaction)
        self._outstanding[identifier] = transaction
        self._telling.given_up(transaction, now, received=instead, is_echo=False)
        device = transaction.device
        if transaction.ends_at >= self._failed_at.get(device, 0.0):
            self._failed_at[device] = now
            if device.breaker.record_failure(transaction.limit, now):
                self._telling.resting(device, now)
        error: RequestError = errors.BrokenResponse() if instead else errors.ResponseTimeout()
        self._telling.record_failed(transaction, error, now, instead)
        return error

    def _lose_under_way(self, now: float) -> None:
        """Fail all requests under way: no response to any request can come any more."""
        lost = list(self._under_way.values())
        for kept in (self._under_way, self._instead, self._outstanding, self._asking):
            kept.clear()
        for transaction in lost:
            self._telling.record_failed(transaction, errors.LineLost(), now)
            transaction.fail_sent(errors.LineLost(), now)

    def _disconnect(self) -> list[Transaction]:
        """Stop sending: there is no connection. Return the requests that waited for one."""
        self._send_request = None
        self._reopening.end()
        return self._queue.clear()

    def _refuse(self, transactions: list[Transaction], error: RequestError, now: float) -> None:
        """Fail requests that were not sent, and record why."""
        for transaction in transactions:
            self._telling.record_refused(transaction, error, now, waiting=self.waiting)
            transaction.fail(error)

    def _go_on(self, now: float) -> None:
        """Send requests while less than `in_flight` are under way, and fail those that have waited too long."""
        late = self._queue.expired(now)
        try:
            while self._send_request is not None and len(self._under_way) < self.settings.in_flight:
                transaction = None if len(self._outstanding) >= MAX_OUTSTANDING else self._queue.take(self._must_wait)
                if transaction is None:
                    break
                self._send(transaction, self._send_request, now)
        finally:
            for request, name in late:
                self._telling.record_expired(request, name, errors.WaitedTooLong(), now)
                request.fail(errors.WaitedTooLong())

    def _must_wait(self, transaction: Transaction) -> bool:
        device = transaction.device
        if (transaction.client, device) in self._asking:
            return True
        return device.breaker.failures > 0 and any(one.device is device for one in self._under_way.values())

    def _send(self, transaction: Transaction, send: Send, now: float) -> None:
        if not transaction.is_wanted:
            self._refuse([transaction], errors.Unwanted(), now)
            return
        if transaction.device.breaker.is_resting(now):
            self._refuse([transaction], errors.UnitResting(), now)
            return
        transaction.sent_at = transaction.ends_at = now
        transaction.limit = _limit_of(transaction)
        identifier = self._free_identifier()
        transaction.count_sent(now)
        if transaction.expects_answer:
            self._under_way[identifier] = transaction
            self._asking.add((transaction.client, transaction.device))
        else:  # the server may respond nevertheless
            self._outstanding[identifier] = transaction
        send(identifier, transaction)
        if not transaction.expects_answer:
            self._telling.record_sent(transaction, None, now)
            transaction.end()

    def _free_identifier(self) -> int:
        """Choose the next identifier for which no response may come."""
        identifier = self._last_identifier
        while True:
            identifier = (identifier + 1) % _IDENTIFIERS
            if identifier not in self._under_way and identifier not in self._outstanding:
                self._last_identifier = identifier
                return identifier

    def _finish(self, identifier: int, transaction: Transaction) -> bytes:
        """Remove a request under way. Return the bytes received instead of its response."""
        del self._under_way[identifier]
        self._asking.remove((transaction.client, transaction.device))
        return self._instead.pop(identifier, b"")

    def _recover(self, device: Destination) -> None:
        self._failed_at.pop(device, None)
        if device.breaker.failures and device.breaker.record_success():
            self._telling.recovered(device)

    def __repr__(self) -> str:
        state = f"under way={self.under_way}"
        if self._send_request is None:
            state = "closed" if self.is_closed else "down"
        return f"<Upstream {self.settings.name} {state} waiting={self.waiting}>"


def _limit_of(transaction: Transaction) -> float:
    return limit_behind_server(transaction.asked, transaction.device.answer_time)


def _answers(frame: TcpFrame, asked: Transaction) -> bool:
    """Tell whether `frame`, which has the identifier of `asked`, is its response."""
    return (frame.unit == asked.unit or frame.unit in NO_UNIT) and asked.asked.accepts(frame.pdu)
