"""What can send on a simulated line."""

from typing import Protocol

from gateway.simulator.pace import Transmission


class Speaker(Protocol):
    """A device, or a fault that sends."""

    def receive(self, sent: Transmission) -> None:
        """Somebody else sends."""

    def deadline(self) -> float | None:
        """When it needs `tick`, or None."""

    def listen(self, now: float) -> None:
        """Take the frames that have ended by `now`."""

    def begin(self, now: float) -> Transmission | None:
        """What it begins to send now, or None."""

    def sends_at(self, time: float) -> bool:
        """Whether it occupies the line at `time`."""

    def take(self, now: float) -> bytes:
        """The characters that have arrived since the last call."""

    def disturb(self) -> None:
        """Two send at once."""
