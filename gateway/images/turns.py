"""The polls of one line: few at once. More would only fill its queue."""

from collections import deque
from collections.abc import Callable
from typing import Final

#: The most polls in progress, or waiting at the line.
MOST_POLLS: Final = 16
#: How long reads wait for a poll that has no turn yet, in seconds; they get no answer when the next poll is over then.
LONGEST_WAIT: Final = 2.0

#: Takes the time.
Step = Callable[[float], None]


class PollTurns:
    """Lets polls go to a line, in the order in which they came."""

    def __init__(self) -> None:
        self._in_progress = 0
        self._is_passing = False
        self._waiting: deque[Step] = deque()
        self._overdue: deque[tuple[float, Step]] = deque()

    def enter(self, send: Step, overdue: Step, now: float, *, at_once: bool = False) -> None:
        """Call `send` when others are over or `at_once`; `leave` follows when what it sends is over.

        Before that, `overdue` is called after LONGEST_WAIT.
        """
        if at_once:
            self._in_progress += 1
            send(now)
            return
        self._waiting.append(send)
        self._go_on(now)
        if self._waiting and self._waiting[-1] is send:
            self._overdue.append((now + LONGEST_WAIT, overdue))

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
            while self._overdue and self._overdue[0][0] <= now:
                self._overdue.popleft()[1](now)
            while self._waiting and self._in_progress < MOST_POLLS:
                self._in_progress += 1
                self._waiting.popleft()(now)
        finally:
            self._is_passing = False
