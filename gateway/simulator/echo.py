"""An adapter that echoes: the port receives what it sends."""

from random import Random

from gateway.simulator.pace import Transmission


class Echo:
    """Returns what the port sends, as it goes along the line."""

    def __init__(self, dice: Random) -> None:
        self._dice = dice
        self._returned: list[Transmission] = []

    def receive(self, sent: Transmission) -> None:
        """The port sends."""
        self._returned.append(Transmission(sent.data, sent.start, sent.timing))

    def deadline(self) -> float | None:
        """When the next characters have left the port."""
        return self._returned[0].next_arrival() if self._returned else None

    def listen(self, now: float) -> None:
        """It takes nothing in."""

    def begin(self, now: float) -> Transmission | None:  # noqa: ARG002 - a speaker
        """It sends nothing of its own."""
        return None

    def sends_at(self, time: float) -> bool:  # noqa: ARG002 - a speaker
        """A copy is not on the line."""
        return False

    def take(self, now: float) -> bytes:
        """The characters that have left the port."""
        data = b""
        while self._returned:
            data += self._returned[0].take(now)
            if not self._returned[0].is_over:
                break
            del self._returned[0]
        return data

    def disturb(self) -> None:
        """The copy is damaged too."""
        for each in self._returned:
            each.garble(self._dice)
