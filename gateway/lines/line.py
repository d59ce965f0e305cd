from dataclasses import dataclass
from gateway.modbus.chartime import LineTiming


@dataclass(frozen=True, slots=True)
class LineSettings:
    """How one line behaves; all times in seconds.

    `gap` is the silence before each request, `silence` the one that ends a frame of unknown size, `turnaround` the one
    after a broadcast. `latency` is what a port whose own latency is not known may add to an answer.
    """

    name: str
    timing: LineTiming
    gap: float
    silence: float
    turnaround: float
    queue: int = 64
    max_wait: float = 2.0
    broadcast: bool = True
    source: str = ""
