"""One request on a line: what is sent to which unit, and for how long its response is awaited."""

from gateway.modbus.codes import BROADCAST_UNIT
from gateway.modbus.pdu import RequestPdu
from gateway.request import Request
from gateway.timing.budget import Budget


class Transaction:
    """A request that has passed its device's checks. `unit` is the unit identifier on the wire, 0 for a broadcast."""

    __slots__ = ("asked", "budget", "device", "ends_at", "limit", "request", "source", "unit", "waits_until")

    def __init__(
        self, request: Request, asked: RequestPdu, unit: int, budget: Budget, *, device: str, source: str
    ) -> None:
        """`device` and `source` name the device and where it is configured, for events."""
        self.request = request
        self.asked = asked
        self.unit = unit
        self.budget = budget
        self.device = device
        self.source = source
        #: When the request has waited too long to be sent; set by the queue.
        self.waits_until = 0.0
        #: When the last character of the request leaves, and how long after that it has failed; set when it is sent.
        self.ends_at = 0.0
        self.limit = 0.0

    @property
    def is_broadcast(self) -> bool:
        """Every device acts and none responds (S 2.1)."""
        return self.unit == BROADCAST_UNIT

    def sent(self, now: float, latency: float) -> None:
        """The request has been written at `now`: its last character leaves, and its limit begins, a wire time later."""
        self.ends_at = now + self.budget.request_wire_time(self.asked)
        self.limit = self.budget.limit(self.asked, latency)

    @property
    def fails_at(self) -> float:
        """When the response must be there."""
        return self.ends_at + self.limit

    def __repr__(self) -> str:
        return f"<Transaction {self.device} unit={self.unit} {self.asked.data.hex(' ').upper()}>"
