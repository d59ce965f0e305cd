"""One request on a line: what is sent to which unit, who may answer, and for how long the answer is awaited."""

from typing import Protocol

from gateway.errors import RequestError
from gateway.lines.breaker import Breaker
from gateway.lines.counts import UnitCounts
from gateway.modbus.codes import EXCEPTION_BIT
from gateway.modbus.frame import Frame
from gateway.modbus.pdu import RequestPdu
from gateway.modbus.scan import Expected
from gateway.request import Request
from gateway.timing.budget import AnswerTime, Budget


class Destination(Protocol):
    """Whom a transaction is for."""

    #: Its unit identifier on the wire at the moment.
    unit: int
    #: Its name, and where it is configured, for events.
    name: str
    source: str
    #: Its requests go before others.
    is_urgent: bool
    answer_time: AnswerTime
    breaker: Breaker
    counts: UnitCounts

    def finished(self, transaction: "Transaction", response: Frame | None) -> None:
        """The transaction was on the line and is over; None when no answer came. Must not call out to requests."""


class Transaction:
    """A request that has passed its device's checks, on its way over the line.

    Equal reads of several clients share one: then there is more than one request.
    """

    __slots__ = (
        "asked", "client", "counts", "device", "ends_at", "expected", "expects_answer", "gives_up_at", "limit", "owed",
        "requests", "retries", "sent_at", "times", "unit", "yields",
    )  # fmt: skip

    #: Whether it is for all units.
    is_broadcast = False

    def __init__(self, request: Request, asked: RequestPdu, device: Destination) -> None:
        self.requests = [request]
        self.client = request.origin.client
        self.asked = asked
        self.device = device
        counts, function = device.counts, asked.function
        self.counts = counts[function]
        self.times = counts.times[function]
        self.expects_answer = asked.is_answered
        #: The unit identifier that the request is sent to.
        self.unit = device.unit
        #: It lets the requests of clients go first: a mirror's poll.
        self.yields = False
        #: When it is written, when its last character leaves, and how long after that it has failed.
        self.sent_at = 0.0
        self.ends_at = 0.0
        self.limit = 0.0
        #: How often it has been sent again, and when it is too late to do that once more.
        self.retries = 0
        self.gives_up_at = 0.0
        #: How many answers to it may still come, and what they look like.
        self.owed = 0
        self.expected: Expected

    def start(self, budget: Budget, now: float) -> None:
        """The request is written at `now`: its last character leaves, and its limit begins, a wire time later.

        Raises:
            RequestError: it must not be sent any more.
        """
        self.unit = self.device.unit
        self.sent_at = now
        self.ends_at = now + budget.request_wire_time(self.asked)
        self.limit = budget.limit(self.asked, self.device.answer_time)

    def again(self) -> "Transaction":
        """The same, to be sent once more. A late answer may still come to this one, from where it was sent to."""
        again = type(self)(self.requests[0], self.asked, self.device)
        again.requests = self.requests
        again.yields = self.yields
        again.retries = self.retries + 1
        again.gives_up_at = self.gives_up_at
        return again

    @property
    def answers_from(self) -> int | None:
        """The unit that an answer comes from; None when that is not known before."""
        return self.unit

    def accepts(self, frame: Frame) -> bool:
        """Whether `frame` is the answer: unit, function, size and echoed fields fit, or it is the unit's exception."""
        return frame.unit == self.unit and self.asked.accepts(frame.pdu)

    @property
    def is_wanted(self) -> bool:
        """Whether a client still wants the request to be sent."""
        for request in self.requests:  # noqa: SIM110 - asked for every request: a generator costs more than all the rest
            if request.origin.wants(request):
                return True
        return False

    @property
    def fails_at(self) -> float:
        """When the response must be there."""
        return self.ends_at + self.limit

    def sent(self, now: float) -> None:
        """It goes on its way, for the first time or again."""
        self.counts.sent += 1
        if self.retries:
            self.counts.retries += 1
            return
        for request in self.requests:
            self.times.wait.add(now - request.received_at)

    def answered(self, now: float) -> None:
        """A valid answer has come in time."""
        self.counts.responses += 1
        self.times.answered(now, self.ends_at, self.limit)

    def respond(self, pdu: bytes, now: float) -> None:
        """Answer all requests."""
        if pdu[0] & EXCEPTION_BIT:
            self.counts.exception += len(self.requests)
            self.device.counts.refused_by_unit(pdu[1], len(self.requests), now)
        else:
            self.counts.ok += len(self.requests)
        for request in self.requests:
            self.times.request.add(now - request.received_at)
            request.respond(pdu)

    def lose(self, error: RequestError, now: float) -> None:
        """Fail all requests, which were sent."""
        self.times.limit = self.limit
        self.device.counts.failed(error.result, now)
        for request in self.requests:
            self.times.request.add(now - request.received_at)
        self.fail(error)

    def fail(self, error: RequestError) -> None:
        """Fail all requests."""
        self.counts.failed(error, len(self.requests))
        for request in self.requests:
            request.fail(error)

    def finish_unanswered(self) -> None:
        """It has been sent, and nobody answers: finish all requests."""
        self.counts.ok += len(self.requests)
        self.end()

    def end(self) -> None:
        """Finish all requests without a response."""
        for request in self.requests:
            request.end()

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.device.name} unit={self.unit} {self.asked.data.hex(' ').upper()}>"


class BroadcastTransaction(Transaction):
    """A request to every device of the line: all act, none responds (S 2.1)."""

    __slots__ = ()

    is_broadcast = True

    def __init__(self, request: Request, asked: RequestPdu, device: Destination) -> None:
        super().__init__(request, asked, device)
        self.expects_answer = False

    def finish_unanswered(self) -> None:
        """See Transaction."""
        self.counts.broadcast += len(self.requests)
        self.end()
