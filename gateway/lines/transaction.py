"""One request on a line: what is sent to which unit, who may answer, and for how long the answer is awaited."""

from typing import Protocol

from gateway.modbus.frame import Frame
from gateway.modbus.pdu import RequestPdu
from gateway.request import Request
from gateway.timing.budget import AnswerTime, Budget


class Addressee(Protocol):
    """Whom a transaction is for."""

    #: Its unit identifier on the wire at the moment.
    unit: int
    #: Its name, and where it is configured, for events.
    name: str
    source: str
    answer_time: AnswerTime

    def finished(self, transaction: "Transaction", response: Frame | None) -> None:
        """The transaction was on the line and is over; None when no answer came. Must not call out to requests."""


class Transaction:
    """A request that has passed its device's checks, on its way over the line."""

    __slots__ = ("asked", "device", "ends_at", "limit", "request", "unit", "waits_until")

    #: Whether somebody answers: not to a broadcast (S 2.1).
    expects_answer = True

    def __init__(self, request: Request, asked: RequestPdu, device: Addressee) -> None:
        self.request = request
        self.asked = asked
        self.device = device
        #: The unit identifier that the request is sent to.
        self.unit = device.unit
        #: When the request has waited too long to be sent; set by the queue.
        self.waits_until = 0.0
        #: When the last character of the request leaves, and how long after that it has failed.
        self.ends_at = 0.0
        self.limit = 0.0

    def start(self, budget: Budget, now: float) -> None:
        """The request is written at `now`: its last character leaves, and its limit begins, a wire time later.

        Raises:
            RequestError: it must not be sent any more.
        """
        self.unit = self.device.unit
        self.ends_at = now + budget.request_wire_time(self.asked)
        self.limit = budget.limit(self.asked, self.device.answer_time)

    @property
    def answers_from(self) -> int | None:
        """The unit that an answer comes from; None when that is not known before."""
        return self.unit

    def accepts(self, frame: Frame) -> bool:
        """Whether `frame` is the answer: unit, function, size and echoed fields fit, or it is the unit's exception."""
        return frame.unit == self.unit and self.asked.accepts(frame.pdu)

    @property
    def is_wanted(self) -> bool:
        """Whether the client still wants the request to be sent."""
        return self.request.origin.wants(self.request)

    @property
    def fails_at(self) -> float:
        """When the response must be there."""
        return self.ends_at + self.limit

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.device.name} unit={self.unit} {self.asked.data.hex(' ').upper()}>"


class BroadcastTransaction(Transaction):
    """A request to every device of the line: all act, none responds (S 2.1)."""

    __slots__ = ()

    expects_answer = False
