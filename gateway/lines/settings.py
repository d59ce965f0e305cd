"""The settings of a line."""

from dataclasses import dataclass, field

from gateway.ports.wire import Wire
from gateway.timing.characters import LineTiming


@dataclass(frozen=True, slots=True)
class LineSettings:
    """The settings of one line; all times in seconds.

    `idle_chars` is the silence that ends an RTU frame, in characters. `gap` is the silence before each request, None
    for that same silence. `turnaround` is the silence after a broadcast. `late_window` is how long a late response may
    come, None for what the device's answer times say. A read and its repeats take at most `retry_within`; None for
    twice the sum of its limit and late window. `rest` is the longest rest of a unit, None for the default, 0 for none.
    """

    name: str
    timing: LineTiming
    turnaround: float
    idle_chars: float = 3.5
    gap: float | None = None
    late_window: float | None = None
    queue: int = 64
    max_wait: float = 2.0
    retries: int = 0
    retry_within: float | None = None
    rest: float | None = None
    echo: bool = False
    wire: Wire = "auto"
    coalesce: bool = True
    broadcast: bool = True
    source: str = field(default="", compare=False)

    @property
    def frame_end(self) -> float:
        """The silence that ends a frame."""
        return self.timing.frame_end(self.idle_chars)

    @property
    def silence_before_request(self) -> float:
        """The silence before each request."""
        return self.frame_end if self.gap is None else self.gap
