"""The limit of a transaction: how long after a request's last character its response must be there.

    limit = longest expected response on the wire + margin x table(function, items) + latency

A device's own `timeout`, or that of its profile for a function without a row in the table, stands in place of
`margin x table`. A function whose response may have any size has no response time on the wire; silence ends it.
"""

from dataclasses import dataclass

from gateway.modbus.pdu import RequestPdu
from gateway.timing.characters import LineTiming
from gateway.timing.table import TimingTable

#: PDU of an exception response, the other answer that every request may get.
_EXCEPTION_SIZE = 2


@dataclass(frozen=True, slots=True)
class AnswerTime:
    """How long a device may think: `margin` times its table, or `timeout` for functions the table does not name.

    With `fixed` that timeout holds for every function.
    """

    table: TimingTable
    margin: float
    timeout: float
    fixed: bool = False

    def allowed(self, asked: RequestPdu) -> float:
        """Seconds from the end of the request to the start of the response."""
        time = None if self.fixed else self.table.time(asked.function, asked.items)
        return self.timeout if time is None else self.margin * time

    @property
    def slowest(self) -> float:
        """The longest time that anything the device is asked may take, whatever time is allowed for it."""
        return max(self.timeout, self.margin * self.table.slowest)


@dataclass(frozen=True, slots=True)
class Budget:
    """What a line makes of a device's answer time. `latency` is what its port may add to an answer, in seconds."""

    line: LineTiming
    latency: float

    def limit(self, asked: RequestPdu, answer_time: AnswerTime) -> float:
        """Seconds from the end of the request on the wire until it has failed."""
        return self.response_wire_time(asked) + answer_time.allowed(asked) + self.latency

    def response_wire_time(self, asked: RequestPdu) -> float:
        """The longest expected response on the wire, 0 when it may have any size."""
        longest = asked.longest_response
        return self.line.frame(max(longest, _EXCEPTION_SIZE)) if longest else 0.0

    def request_wire_time(self, asked: RequestPdu) -> float:
        """The request on the wire."""
        return self.line.frame(len(asked.data))
