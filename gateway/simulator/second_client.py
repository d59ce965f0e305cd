"""Another client on a simulated line, which polls a device."""

from random import Random
from typing import Final

from gateway.modbus import ascii as ascii_framing
from gateway.modbus import rtu
from gateway.simulator.device import Mode
from gateway.simulator.pace import Transmission
from gateway.timing.characters import LineTiming

#: Seconds between its requests, and of silence before each.
EVERY: Final = 0.4
SILENCE: Final = 0.05
#: One holding register at address 2.
_READ: Final = bytes.fromhex("03 0002 0001")


class SecondClient:
    """A client that polls `unit`, at the rate of the last frame that it received, when the line is silent."""

    def __init__(self, unit: int, mode: Mode, dice: Random) -> None:
        self._request = (rtu.encode if mode == "rtu" else ascii_framing.encode)(unit, _READ)
        self._dice = dice
        self._timing: LineTiming | None = None
        self._asks_at: float | None = None
        self._free_at = 0.0
        self._sent: Transmission | None = None

    def receive(self, sent: Transmission) -> None:
        """Wait for the end of a transmission; the first one starts the polling."""
        self._timing = sent.timing
        self._free_at = max(self._free_at, sent.end + SILENCE)
        if self._asks_at is None:
            self._asks_at = sent.start + EVERY

    def deadline(self) -> float | None:
        """Return when it sends next, or when the next characters of its request arrive; None before the first frame."""
        if self._sent is not None:
            return self._sent.next_arrival()
        return None if self._asks_at is None else max(self._asks_at, self._free_at)

    def listen(self, now: float) -> None:
        """Do nothing: responses are ignored."""

    def begin(self, now: float) -> Transmission | None:
        """Return the next request if it is due, else None."""
        if self._timing is None or self._asks_at is None or self._sent is not None:
            return None
        if now < max(self._asks_at, self._free_at):
            return None
        self._sent = Transmission(self._request, now, self._timing)
        self._asks_at = now + EVERY
        return self._sent

    def sends_at(self, time: float) -> bool:
        """Tell whether its request is on the line at `time`."""
        return self._sent is not None and time < self._sent.end

    def take(self, now: float) -> bytes:
        """Return the characters of its request that have arrived since the last call."""
        if self._sent is None:
            return b""
        data = self._sent.take(now)
        if self._sent.is_over:
            self._sent = None
        return data

    def disturb(self) -> None:
        """Damage the request being sent."""
        if self._sent is not None:
            self._sent.garble(self._dice)
