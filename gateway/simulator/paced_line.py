"""A line with devices, at its real speed: carries requests to the devices and their responses back.

The gateway writes a frame at once. Here it is transmitted one character after the other, at the rate of the port. Each
device detects the end of the frame (`framer`), waits for its answer time, and sends. A device with another rate
receives only noise. All devices receive one another, as on a real line. A collision damages both frames.

Without I/O: time is an argument, as in `lines.line`.
"""

from collections.abc import Callable, Iterable, Sequence
from random import Random
from typing import Final, Literal

from gateway.simulator.device import Device, Mode
from gateway.simulator.pace import Transmission
from gateway.simulator.station import Station
from gateway.timing.characters import CharacterFormat, LineTiming

#: Characters that may wait for the line; more are lost.
BACKLOG: Final = 4096

Sender = Literal["port", "device"]
#: Called when a frame begins on the line: who sends it, and the bytes.
Tell = Callable[[Sender, bytes], None]


def ignore_frame(sender: Sender, data: bytes) -> None:
    """The default `tell`: does nothing."""


class PacedLine:
    """Devices on a line. `seed` is for noise and collisions."""

    def __init__(
        self,
        mode: Mode,
        format_: CharacterFormat,
        devices: Sequence[Device],
        *,
        seed: int = 0,
        tell: Tell = ignore_frame,
    ) -> None:
        dice = Random(seed)  # noqa: S311 - noise is not a secret, and repeatable
        self._mode = mode
        self._format = format_
        self._stations = [Station(device, mode, dice) for device in devices]
        self._tell = tell
        self._port_is_free_at = 0.0

    def written(self, data: bytes, now: float, baud: int) -> None:
        """The port sends `data` at `baud`. Call `tick(now)` before."""
        timing = LineTiming(self._mode, baud, self._format)
        start = max(now, self._port_is_free_at)
        waiting = round((start - now) / timing.character)
        data = data[: max(0, BACKLOG - waiting)]
        if data:
            sent = Transmission(data, start, timing)
            self._port_is_free_at = sent.end
            self._begin("port", sent, self._stations, disturbed=self._any_sends(start, self._stations))

    def deadline(self) -> float | None:
        """When `tick` must be called, or None."""
        deadlines = [station.deadline() for station in self._stations]
        return min((deadline for deadline in deadlines if deadline is not None), default=None)

    def tick(self, now: float) -> bytes:
        """Let time pass; the bytes that the port has received."""
        readable = b""
        while (at := self.deadline()) is not None and at <= now:
            readable += b"".join(self._step(station, at) for station in self._stations)
        return readable

    def _step(self, station: Station, now: float) -> bytes:
        """Let a station do what is due; the characters of its response that have arrived."""
        station.listen(now)
        answer = station.begin(now)
        if answer is not None:
            others = [other for other in self._stations if other is not station]
            port_sends = now < self._port_is_free_at
            self._begin("device", answer, others, disturbed=port_sends or self._any_sends(now, others))
        return station.take(now)

    def _begin(self, sender: Sender, sent: Transmission, receivers: Sequence[Station], *, disturbed: bool) -> None:
        self._tell(sender, sent.data)
        for station in receivers:
            station.receive(sent)
        if disturbed:
            for station in self._stations:
                station.disturb()

    @staticmethod
    def _any_sends(time: float, stations: Iterable[Station]) -> bool:
        return any(station.sends_at(time) for station in stations)
