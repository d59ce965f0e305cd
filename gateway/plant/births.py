"""The births in a connection to a broker: what is published before all else, again whenever a host asks for it."""

import math
from collections.abc import Iterable, Iterator
from typing import Final

from gateway.plant.messages import Message

#: Births that hosts ask for are published at most this often, in seconds.
REBIRTH_PAUSE: Final = 1.0


class Births:
    """The messages of the last birth that are still to be published, and when another one may begin."""

    def __init__(self) -> None:
        #: Whether there has been one in this connection.
        self.has_begun = False
        #: Whether messages of it are still to be taken.
        self.is_under_way = False
        #: When the next one begins, if one was put off.
        self.next_at: float | None = None
        self._begun_at = -math.inf
        self._messages: Iterator[Message] = iter(())

    def begin(self, messages: Iterable[Message], now: float) -> None:
        """Begin one; what is left of another is not published."""
        self.has_begun = self.is_under_way = True
        self._begun_at, self.next_at = now, None
        self._messages = iter(messages)

    def may_begin(self, now: float) -> bool:
        """Whether another one may begin now. If not, it is put off."""
        if now - self._begun_at >= REBIRTH_PAUSE:
            return True
        self.next_at = self._begun_at + REBIRTH_PAUSE
        return False

    def take(self) -> Message | None:
        """The next message; None if that was all."""
        message = next(self._messages, None)
        self.is_under_way = message is not None
        return message

    def forget(self) -> None:
        """The connection is lost."""
        self.has_begun = self.is_under_way = False
        self._begun_at, self.next_at = -math.inf, None
        self._messages = iter(())
