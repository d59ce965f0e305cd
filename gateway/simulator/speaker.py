"""Whoever can be heard at the port of a simulated line."""

from typing import Protocol

from gateway.simulator.pace import Transmission


class Speaker(Protocol):
    """A device, or a fault that speaks."""

    def receive(self, sent: Transmission) -> None:
        """Somebody else sends."""

    def deadline(self) -> float | None:
        """When something happens here by itself, or None."""

    def listen(self, now: float) -> None:
        """Take what was heard to its end by `now`."""

    def begin(self, now: float) -> Transmission | None:
        """What it sends, if this is the moment at which that begins."""

    def sends_at(self, time: float) -> bool:
        """Whether it occupies the line at `time`."""

    def take(self, now: float) -> bytes:
        """The characters of it that are there by `now` and were not taken before."""

    def disturb(self) -> None:
        """Two send at once."""
