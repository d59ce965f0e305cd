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
from gateway.simulator.echo import Echo
from gateway.simulator.faults import NO_LINE_FAULTS, LineFaults
from gateway.simulator.pace import Transmission
from gateway.simulator.second_client import SecondClient
from gateway.simulator.speaker import Speaker
from gateway.simulator.station import Station
from gateway.timing.characters import CharacterFormat, LineTiming

#: Characters that may wait for the line; more are lost.
BACKLOG: Final = 4096

Sender = Literal["port", "device"]
#: Called when a frame begins on the line: who sends it, and the bytes.
Tell = Callable[[Sender, bytes], None]


def ignore_frame(sender: Sender, data: bytes) -> None:
    """Do nothing: the default `tell`."""


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
        faults: LineFaults = NO_LINE_FAULTS,
    ) -> None:
        dice = Random(seed)  # noqa: S311 - noise is not a secret, and repeatable
        self._mode = mode
        self._format = format_
        self._speakers: list[Speaker] = [Station(device, mode, dice) for device in devices]
        if faults.second_client:
            self._speakers.append(SecondClient(devices[0].unit, mode, dice))
        self._echo = Echo(dice) if faults.echo else None
        if self._echo is not None:
            self._speakers.append(self._echo)
        self._tell = tell
        self._port_is_free_at = 0.0

    def written(self, data: bytes, now: float, baud: int) -> None:
        """Send `data` from the port, at `baud`. Call `tick(now)` before."""
        timing = LineTiming(self._mode, baud, self._format)
        start = max(now, self._port_is_free_at)
        waiting = round((start - now) / timing.character)
        data = data[: max(0, BACKLOG - waiting)]
        if data:
            sent = Transmission(data, start, timing)
            self._port_is_free_at = sent.end
            self._begin("port", sent, self._speakers, disturbed=self._any_sends(start, self._speakers))

    def deadline(self) -> float | None:
        """Return when `tick` must be called, or None."""
        deadlines = [speaker.deadline() for speaker in self._speakers]
        return min((deadline for deadline in deadlines if deadline is not None), default=None)

    def tick(self, now: float) -> bytes:
        """Let time pass; return the bytes that the port has received."""
        readable = b""
        while (at := self.deadline()) is not None and at <= now:
            readable += b"".join(self._step(speaker, at) for speaker in self._speakers)
        return readable

    def _step(self, speaker: Speaker, now: float) -> bytes:
        """Let a speaker do what is due; return the characters that it sent and that have arrived."""
        speaker.listen(now)
        sent = speaker.begin(now)
        if sent is not None:
            others = [other for other in self._speakers if other is not speaker and other is not self._echo]
            port_sends = now < self._port_is_free_at
            self._begin("device", sent, others, disturbed=port_sends or self._any_sends(now, others))
        return speaker.take(now)

    def _begin(self, sender: Sender, sent: Transmission, receivers: Sequence[Speaker], *, disturbed: bool) -> None:
        self._tell(sender, sent.data)
        for receiver in receivers:
            receiver.receive(sent)
        if disturbed:
            for speaker in self._speakers:
                speaker.disturb()

    @staticmethod
    def _any_sends(time: float, speakers: Iterable[Speaker]) -> bool:
        return any(speaker.sends_at(time) for speaker in speakers)
