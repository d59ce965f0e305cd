"""Births: what is published first in a connection to a broker, and again whenever a host asks for it."""

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
        #: Whether some of its messages were not taken yet.
        self.is_under_way = False
        #: When the next one begins, if one was put off.
        self.next_at: float | None = None
        #: How many there have been, ever.
        self.number = 0
        self._begun_at = -math.inf
        self._messages: Iterator[Message] = iter(())

    def begin(self, messages: Iterable[Message], now: float) -> None:
        """Begin a birth with these messages; the rest of an earlier one is dropped."""
        self.has_begun = self.is_under_way = True
        self._begun_at, self.next_at = now, None
        self.number += 1
        self._messages = iter(messages)

    def may_begin(self, now: float) -> bool:
        """Tell whether a birth may begin now; if not, put it off until `next_at`."""
        if now - self._begun_at >= REBIRTH_PAUSE:
            return True
        self.next_at = self._begun_at + REBIRTH_PAUSE
        return False

    def take(self) -> Message | None:
        """Return the next message of the birth; None if there are no more."""
        message = next(self._messages, None)
        self.is_under_way = message is not None
        return message

    def forget(self) -> None:
        """Forget the birth: the connection is lost."""
        self.has_begun = self.is_under_way = False
        self._begun_at, self.next_at = -math.inf, None
        self._messages = iter(())
