"""The polls of one line: few at once. More would only fill its queue."""

from collections import deque
from collections.abc import Callable
from typing import Final

#: The most polls in progress, or waiting at the line.
MOST_POLLS: Final = 16


class PollTurns:
    """Lets polls go to a line, in the order in which they came."""

    def __init__(self) -> None:
        self._in_progress = 0
        self._is_passing = False
        self._waiting: deque[Callable[[float], None]] = deque()

    def enter(self, send: Callable[[float], None], now: float, *, at_once: bool = False) -> None:
        """Call `send` with the time, when others are over or `at_once`; `leave` follows when what it sends is over."""
        if at_once:
            self._in_progress += 1
            send(now)
            return
        self._waiting.append(send)
        self._go_on(now)

    def leave(self, now: float) -> None:
        """Note that a poll is over."""
        self._in_progress -= 1
        self._go_on(now)

    def _go_on(self, now: float) -> None:
        """Send those that may go. An answer may come before `send` returns; then this loop goes on."""
        if self._is_passing:
            return
        self._is_passing = True
        try:
            while self._waiting and self._in_progress < MOST_POLLS:
                self._in_progress += 1
                self._waiting.popleft()(now)
        finally:
            self._is_passing = False
