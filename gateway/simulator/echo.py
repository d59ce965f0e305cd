"""An adapter that echoes: the port receives what it sends."""

from random import Random

from gateway.simulator.pace import Transmission


class Echo:
    """A speaker that returns what the port sends, at the speed of the line."""

    def __init__(self, dice: Random) -> None:
        self._dice = dice
        self._returned: list[Transmission] = []

    def receive(self, sent: Transmission) -> None:
        """Take what the port sends."""
        self._returned.append(Transmission(sent.data, sent.start, sent.timing))

    def deadline(self) -> float | None:
        """Return when the next characters have left the port; None if there are none."""
        return self._returned[0].next_arrival() if self._returned else None

    def listen(self, now: float) -> None:
        """Do nothing: an adapter reads no frames."""

    def begin(self, now: float) -> Transmission | None:  # noqa: ARG002 - a speaker
        """Return None: it sends nothing of its own."""
        return None

    def sends_at(self, time: float) -> bool:  # noqa: ARG002 - a speaker
        """Return False: a copy is not on the line."""
        return False

    def take(self, now: float) -> bytes:
        """Return the characters that have left the port since the last call."""
        data = b""
        while self._returned:
            data += self._returned[0].take(now)
            if not self._returned[0].is_over:
                break
            del self._returned[0]
        return data

    def disturb(self) -> None:
        """Damage the copies too."""
        for each in self._returned:
            each.garble(self._dice)
