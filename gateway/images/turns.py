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
        #: What sends a poll, and what ends the waiting of reads for it at this time.
        self._waiting: deque[tuple[float, Step, Step]] = deque()
        #: What sends those for which no read waits any longer.
        self._overdue: deque[Step] = deque()

    def enter(self, send: Step, overdue: Step, now: float, *, at_once: bool = False) -> None:
        """Call `send` when others are over or `at_once`; `leave` follows when what it sends is over.

        Before that, `overdue` is called after LONGEST_WAIT.
        """
        if at_once:
            self._in_progress += 1
            send(now)
            return
        self._waiting.append((now + LONGEST_WAIT, send, overdue))
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
            while self._waiting and self._waiting[0][0] <= now:
                _, send, overdue = self._waiting.popleft()
                self._overdue.append(send)
                overdue(now)
            while self._in_progress < MOST_POLLS and (self._overdue or self._waiting):
                self._in_progress += 1
                send = self._overdue.popleft() if self._overdue else self._waiting.popleft()[1]
                send(now)
        finally:
            self._is_passing = False
