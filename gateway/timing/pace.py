"""How long a transaction takes a line up: arithmetic, from what is known before anything is sent.

    time = gap + request on the wire + answer time of the device + response on the wire + latency

A device that answers in the largest form that its request allows is assumed, and one that answers every request.
"""

from dataclasses import dataclass

from gateway.modbus.pdu import RequestPdu
from gateway.timing.characters import LineTiming
from gateway.timing.table import TimingTable


@dataclass(frozen=True, slots=True)
class Pace:
    """What takes time on a line; all in seconds.

    `gap` is the silence before each request, and `frame_end` the one by which a device notices the end of its request:
    no answer comes sooner. `latency` is what the port adds to each answer. Without a wire bytes take no time.
    """

    timing: LineTiming
    gap: float
    frame_end: float
    latency: float = 0.0
    has_wire: bool = True

    def time_of(self, asked: RequestPdu, table: TimingTable) -> float:
        """From the first character of the request until the next request may be sent.

        A function without a row in `table` is answered as soon as can be, so the time is the shortest possible one.
        """
        answer = table.time(asked.function, asked.items) or 0.0
        if not self.has_wire:
            return self.gap + answer + self.latency
        frames = self._wire_time(len(asked.data)) + self._wire_time(asked.longest_response)
        return self.gap + frames + max(answer, self.frame_end) + self.latency

    def _wire_time(self, pdu_size: int) -> float:
        return self.timing.frame(pdu_size) if pdu_size else 0.0
