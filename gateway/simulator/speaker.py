"""The protocol of everything that sends on a simulated line."""

from typing import Protocol

from gateway.simulator.pace import Transmission


class Speaker(Protocol):
    """A device, or a fault that sends."""

    def receive(self, sent: Transmission) -> None:
        """Take a transmission of another speaker or of the port."""

    def deadline(self) -> float | None:
        """Return when `listen`, `begin` and `take` are due, or None."""

    def listen(self, now: float) -> None:
        """Process the frames that have ended by `now`."""

    def begin(self, now: float) -> Transmission | None:
        """Return what it begins to send now, or None."""

    def sends_at(self, time: float) -> bool:
        """Tell whether it occupies the line at `time`."""

    def take(self, now: float) -> bytes:
        """Return the characters that have arrived since the last call."""

    def disturb(self) -> None:
        """Damage what is being sent or received: two send at once."""
