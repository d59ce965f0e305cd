"""The settings of a line."""

from dataclasses import dataclass, field
from typing import Final

from gateway.ports.port import Wire
from gateway.timing.characters import LineTiming

#: The usual answer time of devices, in seconds.
_ANSWER: Final = 0.05


@dataclass(frozen=True, slots=True)
class LineSettings:
    """The settings of one line; all times in seconds.

    `idle_chars` is the silence that ends an RTU frame, in characters. `gap` is the silence before each request, None
    for that same silence. `turnaround` is the silence after a broadcast. `late_window` is how long a late response may
    come, None for the device's answer times. A read and its repeats take at most `retry_within`; None for
    `time_for_repeats`. `rest` is the longest rest of a unit, None for the default, 0 for none. A
    connection is closed after `idle` seconds without a request, 0 for never; `after_connect` is the silence after
    connecting.
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
    idle: float = 0.0
    after_connect: float = 0.0
    echo: bool = False
    wire: Wire = "auto"
    coalesce: bool = True
    broadcast: bool = True
    source: str = field(default="", compare=False)

    def time_for_repeats(self, request: float, limit: float, window: float) -> float:
        """Return how long a read and its repeats may take. `request` is on the wire, `limit` and late `window` follow.

        By default twice the limit and the window. If that is too short for a repeat after silence, it is longer by a
        short request of another client that the repeat may have to wait for.
        """
        if self.retry_within is not None:
            return self.retry_within
        others = 2 * request + _ANSWER
        return max(2 * (limit + window), 2 * (request + limit) + window + others)

    @property
    def frame_end(self) -> float:
        """The silence that ends a frame, in seconds."""
        return self.timing.frame_end(self.idle_chars)

    @property
    def silence_before_request(self) -> float:
        """The silence before each request, in seconds."""
        return self.frame_end if self.gap is None else self.gap
