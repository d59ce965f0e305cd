"""The messages that the broker has not confirmed: if it takes long, their new readings are kept until it does.

Otherwise these would be lost with the gateway, however old, and would come behind later ones after the connection is
lost.
"""

from dataclasses import dataclass
from typing import Final, Protocol

from gateway.plant.kept.records import Chunk
from gateway.plant.messages import Message, Readings

#: A broker that takes longer to confirm a message is slow, in seconds.
SLOW: Final = 0.5


class Holds(Protocol):
    """What keeps readings: see Keeper."""

    def keep(self, device: str, readings: Readings) -> None:
        """Keep readings of a device."""

    def hold(self, device: str, readings: Readings) -> Chunk:
        """Keep readings that the broker may have, until `let_go`."""

    def let_go(self, chunk: Chunk, *, must_send: bool) -> None:
        """Forget what was held; or if the connection was lost, have it sent."""


@dataclass(slots=True, eq=False)
class _Sent:
    message: Message
    at: float
    #: Where its readings are kept meanwhile; None if they are not.
    held: Chunk | None = None


class Unconfirmed:
    """The messages with new readings that were sent in this connection, in order. Times are seconds of any clock."""

    def __init__(self, keeps: Holds) -> None:
        self._keeps = keeps
        self._sent: list[_Sent] = []

    def sent(self, message: Message, now: float) -> None:
        """Note that a message is sent."""
        self._sent.append(_Sent(message, now))

    def hold(self, device: str) -> None:
        """Keep the readings of a device, before later ones of it are kept."""
        for each in self._sent:
            if each.held is None and each.message.device == device:
                self._hold(each)

    def hold_slow(self, now: float) -> None:
        """Keep the readings for which the broker takes long, before what is kept is written."""
        for each in self._sent:
            if each.held is None and now - each.at >= SLOW:
                self._hold(each)

    def answered(self, message: Message) -> bool:
        """Note that the broker has confirmed or refused a message; tell whether its readings were held."""
        each = next((each for each in self._sent if each.message is message), None)
        if each is None:
            return False
        self._sent.remove(each)
        if each.held is None:
            return False
        self._keeps.let_go(each.held, must_send=False)
        return True

    def end(self) -> None:
        """Keep all readings: the connection is lost."""
        for each in self._sent:
            if each.held is None:
                self._keeps.keep(each.message.device, each.message.told)
            else:
                self._keeps.let_go(each.held, must_send=True)
        self._sent.clear()

    def _hold(self, each: _Sent) -> None:
        each.held = self._keeps.hold(each.message.device, each.message.told)
