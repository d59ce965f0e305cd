"""The transaction machine of an upstream: units behind another Modbus TCP server, asked without waiting for each other.

    down ──port_up──▶ up: waiting ──a place is free──▶ under way ──response, limit──▶ answered
                                                          └──limit──▶ owed ──late response──▶ dropped

Every request gets a transaction identifier of ours (T 4.2.2). An identifier is not used again as long as its answer is
owed, however late that is, so an answer can only ever go to its own request. Nothing is repeated.

The machine knows no clock and no descriptor: bytes, time and requests are its arguments, and `deadline` says when it
wants to be called again. It finishes its own state before it calls a request's origin, which may submit the next
request at once.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from gateway import errors
from gateway.errors import RequestError
from gateway.events import Emit
from gateway.lines.queue import WaitingQueue
from gateway.lines.report import Report
from gateway.lines.transaction import Destination, Transaction
from gateway.modbus.codes import BROADCAST_UNIT, SERVER_UNIT
from gateway.modbus.frame import Frame
from gateway.modbus.mbap import MbapFramer, TcpFrame, encode

#: So many late answers are awaited on one connection. Then a new one is made, on which none of them can come.
MAX_OUTSTANDING: Final = 4096

_IDENTIFIERS: Final = 0x10000
#: What servers call themselves that know only one unit, whichever was asked (T 4.4.1.2).
_NO_UNIT: Final = (BROADCAST_UNIT, SERVER_UNIT)


@dataclass(frozen=True, slots=True)
class UpstreamSettings:
    """How one upstream behaves; times in seconds.

    At most `in_flight` requests are under way and `queue` more wait, each for `max_wait` at most.
    """

    name: str
    timeout: float = 1.0
    in_flight: int = 16
    queue: int = 64
    max_wait: float = 2.0
    source: str = field(default="", compare=False)


class Upstream:
    """One connection to another server and its transactions.

    One client's requests to one unit are sent one after the other, so that none overtakes another. A unit that has
    failed is asked one at a time until it answers, so that it does not take the places of others.
    """

    def __init__(self, settings: UpstreamSettings, emit: Emit) -> None:
        self.settings = settings
        #: Answers that belong to nothing that was asked on their connection.
        self.unasked_frames = 0
        self._report = Report(settings.name, settings.source, emit)
        self._queue = WaitingQueue(settings.queue, settings.max_wait, coalesce=False)
        self._write: Callable[[bytes], None] | None = None
        self._framer = MbapFramer(strict=True)
        #: By identifier: what is under way, the oldest first; what came instead of its answer; what may come late.
        self._under_way: dict[int, Transaction] = {}
        self._instead: dict[int, bytes] = {}
        self._outstanding: dict[int, Transaction] = {}
        #: Whose requests are under way to whom.
        self._asking: set[tuple[str, Destination]] = set()
        self._failed_at: dict[Destination, float] = {}
        self._last_identifier = 0

    def port_up(self, write: Callable[[bytes], None]) -> None:
        """There is a connection: requests go out through `write`."""
        self._write = write
        self._framer = MbapFramer(strict=True)
        for device in self._failed_at:
            device.breaker.record_success()
        self._failed_at.clear()

    def port_down(self, now: float) -> None:
        """The connection has gone: what was under way may have been acted on (0B), what waited was not sent (0A)."""
        self._write = None
        lost, waiting = list(self._under_way.values()), self._queue.clear()
        for kept in (self._under_way, self._instead, self._outstanding, self._asking):
            kept.clear()
        for transaction in lost:
            transaction.fail_sent(errors.LineLost(), now)
        for transaction in waiting:
            transaction.fail(errors.LineDown())

    def finish(self) -> None:
        """Take no more requests: what waits is not sent any more (0A), what is under way may be answered."""
        self._write = None
        for transaction in self._queue.clear():
            transaction.fail(errors.LineDown())

    def submit(self, transaction: Transaction, now: float) -> None:
        """Take over a transaction: it is sent when there is a place for it, or it fails."""
        if self._write is None:
            transaction.fail(errors.LineDown())
        elif transaction.device.breaker.is_resting(now):
            transaction.fail(errors.UnitResting())
        else:
            refused = self._queue.put(transaction, now)
            if refused is not None:
                self._report.queue_full(refused)
                refused.fail(errors.QueueFull())
            if refused is not transaction:
                self._go_on(now)

    def received(self, data: bytes, now: float) -> None:
        """Take bytes that came at `now`.

        Raises:
            NotModbus: the server does not speak Modbus TCP, so that the connection cannot be used any more. What was
                answered before that is answered.
        """
        answers: list[tuple[Transaction, bytes]] = []
        try:
            for frame in self._framer.cut(data):
                answer = self._answer_in(frame, now)
                if answer is not None:
                    answers.append(answer)
            self._go_on(now)
        finally:
            for transaction, pdu in answers:
                transaction.respond(pdu, now)

    def deadline(self) -> float | None:
        """When `tick` wants to be called, or None while there is nothing to wait for."""
        oldest = next(iter(self._under_way.values()), None)
        deadlines = (None if oldest is None else oldest.fails_at, self._queue.next_expiry())
        return min((one for one in deadlines if one is not None), default=None)

    def tick(self, now: float) -> None:
        """Let time pass: limits may have run out."""
        failed: list[tuple[Transaction, RequestError]] = []
        for identifier, transaction in list(self._under_way.items()):
            if now < transaction.fails_at:
                break
            failed.append((transaction, self._give_up(identifier, transaction, now)))
        try:
            self._go_on(now)
        finally:
            for transaction, error in failed:
                transaction.fail_sent(error, now)

    @property
    def waiting(self) -> int:
        """How many requests wait for a place."""
        return len(self._queue)

    @property
    def under_way(self) -> int:
        """How many requests have been sent and may still be answered in time."""
        return len(self._under_way)

    @property
    def overdue(self) -> int:
        """How many answers may still come too late."""
        return len(self._outstanding)

    @property
    def is_spent(self) -> bool:
        """Whether it waits for a new connection, because too many answers are owed on this one."""
        return len(self._outstanding) >= MAX_OUTSTANDING and not self._under_way

    def _answer_in(self, frame: TcpFrame, now: float) -> tuple[Transaction, bytes] | None:
        """The transaction that `frame` answers in time, and its response; None when it is dropped."""
        asked = self._under_way.get(frame.transaction)
        late = self._outstanding.get(frame.transaction)
        if asked is not None and _answers(frame, asked):
            self._finish(frame.transaction, asked)
            asked.count_response(now)
            self._heard_from(asked.device)
            return asked, frame.pdu
        if late is not None and _answers(frame, late):
            del self._outstanding[frame.transaction]
            self._report.late_response(late, now)
            self._heard_from(late.device)
            return None
        expected = asked or late
        if expected is None:
            self.unasked_frames += 1
        else:
            self._report.foreign(Frame(frame.unit, frame.pdu), expected)
        if asked is not None:
            self._instead.setdefault(frame.transaction, encode(*frame))
        return None

    def _give_up(self, identifier: int, transaction: Transaction, now: float) -> RequestError:
        """The limit has run out. Failures of requests that were under way together count as one."""
        instead = self._finish(identifier, transaction)
        self._outstanding[identifier] = transaction
        self._report.given_up(transaction, now, heard=instead)
        device = transaction.device
        if transaction.ends_at >= self._failed_at.get(device, 0.0):
            self._failed_at[device] = now
            if device.breaker.record_failure(transaction.limit, now):
                self._report.resting(device, now)
        return errors.BrokenResponse() if instead else errors.ResponseTimeout()

    def _go_on(self, now: float) -> None:
        """Send what there is a place for, and refuse what has waited too long."""
        late = self._queue.expired(now)
        try:
            while self._write is not None and len(self._under_way) < self.settings.in_flight:
                transaction = None if len(self._outstanding) >= MAX_OUTSTANDING else self._queue.take(self._must_wait)
                if transaction is None:
                    break
                self._send(transaction, self._write, now)
        finally:
            for request in late:
                request.fail(errors.WaitedTooLong())

    def _must_wait(self, transaction: Transaction) -> bool:
        device = transaction.device
        if (transaction.client, device) in self._asking:
            return True
        return device.breaker.failures > 0 and any(one.device is device for one in self._under_way.values())

    def _send(self, transaction: Transaction, write: Callable[[bytes], None], now: float) -> None:
        if not transaction.is_wanted:
            transaction.fail(errors.Unwanted())
            return
        if transaction.device.breaker.is_resting(now):
            transaction.fail(errors.UnitResting())
            return
        transaction.ends_at = now
        transaction.limit = self.settings.timeout
        identifier = self._free_identifier()
        transaction.count_sent(now)
        if transaction.expects_answer:
            self._under_way[identifier] = transaction
            self._asking.add((transaction.client, transaction.device))
        else:  # the server may answer all the same
            self._outstanding[identifier] = transaction
        write(encode(identifier, transaction.unit, transaction.asked.data))
        if not transaction.expects_answer:
            transaction.end()

    def _free_identifier(self) -> int:
        """The next one that no answer can be on its way with."""
        identifier = self._last_identifier
        while True:
            identifier = (identifier + 1) % _IDENTIFIERS
            if identifier not in self._under_way and identifier not in self._outstanding:
                self._last_identifier = identifier
                return identifier

    def _finish(self, identifier: int, transaction: Transaction) -> bytes:
        """It is under way no more; what came that was not its answer."""
        del self._under_way[identifier]
        self._asking.remove((transaction.client, transaction.device))
        return self._instead.pop(identifier, b"")

    def _heard_from(self, device: Destination) -> None:
        self._failed_at.pop(device, None)
        if device.breaker.failures and device.breaker.record_success():
            self._report.recovered(device)

    def __repr__(self) -> str:
        state = "down" if self._write is None else f"under way={self.under_way}"
        return f"<Upstream {self.settings.name} {state} waiting={self.waiting}>"


def _answers(frame: TcpFrame, asked: Transaction) -> bool:
    """Whether `frame`, which has the identifier of `asked`, is its answer."""
    return (frame.unit == asked.unit or frame.unit in _NO_UNIT) and asked.asked.accepts(frame.pdu)
