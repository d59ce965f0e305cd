"""The time limit of a transaction, and how long it takes a line up: arithmetic, before anything is sent.

The limit is from the last character of the request to the last one of the response.

    limit = longest expected response on the wire + margin x table(function, items) + latency

A device's own `timeout`, or that of its profile for a function without a row in the table, replaces `margin x table`.
A response of unknown size has no time on the wire; silence ends it.

    time = gap + request on the wire + answer time of the device + response on the wire + latency

For that, a device is assumed that answers every request, in the largest form that it allows.
"""

from dataclasses import dataclass
from typing import Final

from gateway.modbus.pdu import RequestPdu
from gateway.timing.characters import LineTiming
from gateway.timing.table import TimingTable

#: What network and server add to a device's answer time, in seconds.
NETWORK_LATENCY: Final = 0.1


@dataclass(frozen=True, slots=True)
class AnswerTime:
    """How long a device may take: `margin` times its table, or `timeout` for functions without a row.

    If `fixed`, the timeout is for every function.
    """

    table: TimingTable
    margin: float
    timeout: float
    fixed: bool = False

    def allowed(self, asked: RequestPdu) -> float:
        """Compute the seconds from the end of the request to the start of the response."""
        time = None if self.fixed else self.table.time(asked.function, asked.items)
        return self.timeout if time is None else self.margin * time

    @property
    def has_table(self) -> bool:
        """Whether it depends on function and items."""
        return bool(self.table.rows) and not self.fixed

    @property
    def slowest(self) -> float:
        """The longest time for any request to the device."""
        return max(self.timeout, self.margin * self.table.slowest)


def limit_behind_server(asked: RequestPdu, answer_time: AnswerTime) -> float:
    """Compute the seconds until a request to another server fails.

    A time-out is meant as it is written; to a time of a device's table, network and server add their own.
    """
    time = None if answer_time.fixed else answer_time.table.time(asked.function, asked.items)
    return answer_time.timeout if time is None else answer_time.margin * time + NETWORK_LATENCY


@dataclass(frozen=True, slots=True)
class Budget:
    """The time limits on one line. `latency` is what its port may add to a response, in seconds."""

    line: LineTiming
    latency: float

    def limit(self, asked: RequestPdu, answer_time: AnswerTime) -> float:
        """Compute the seconds from the end of the request on the wire until it fails."""
        return self.response_wire_time(asked) + answer_time.allowed(asked) + self.latency

    def response_wire_time(self, asked: RequestPdu) -> float:
        """Compute the seconds of the longest expected response on the wire; 0 for one of unknown size."""
        longest = asked.longest_response
        return self.line.frame(longest) if longest else 0.0

    def request_wire_time(self, asked: RequestPdu) -> float:
        """Compute the seconds of the request on the wire."""
        return self.line.frame(len(asked.data))


class ServerBudget:
    """The time limits of requests to another server: bytes take no time."""

    def limit(self, asked: RequestPdu, answer_time: AnswerTime) -> float:
        """Compute the seconds until the request fails."""
        return limit_behind_server(asked, answer_time)

    def response_wire_time(self, asked: RequestPdu) -> float:  # noqa: ARG002 - see Budget
        """Return 0."""
        return 0.0

    def request_wire_time(self, asked: RequestPdu) -> float:  # noqa: ARG002 - see Budget
        """Return 0."""
        return 0.0


@dataclass(frozen=True, slots=True)
class Pace:
    """What takes time on a line; all in seconds.

    `gap` is the silence before each request, and `frame_end` the one by which a device notices the end of its request:
    no answer comes sooner. `latency` is what the port adds to each answer. Without a wire (`timing` None) bytes take no
    time.
    """

    timing: LineTiming | None
    gap: float
    frame_end: float = 0.0
    latency: float = 0.0

    def time_of(self, asked: RequestPdu, table: TimingTable) -> float:
        """Compute the time from the first character of the request until the next one may be sent.

        A function without a row in `table` is answered as soon as can be, so the time is the shortest possible one.
        """
        answer = table.time(asked.function, asked.items) or 0.0
        if self.timing is None:
            return self.gap + answer + self.latency
        frames = sum(self.timing.frame(size) for size in (len(asked.data), asked.longest_response) if size)
        return self.gap + frames + max(answer, self.frame_end) + self.latency
