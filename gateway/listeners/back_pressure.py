"""Why no request is taken from a client for the moment, though it has sent some."""

from typing import Final

#: How long no request is taken from a client when a line had no room for one of its requests, in seconds: at first, and
#: at most. Each such refusal doubles it, any other answer shortens it to so much of it.
SHORTEST_HOLD: Final = 0.002
LONGEST_HOLD: Final = 0.128
HOLD_RECOVERS: Final = 0.8


class BackPressure:
    """The client does not take its responses, or a line has just had no room for one of its requests.

    Clients that ask again at once after such a refusal would leave the lines no time. `blocked_at` is since when it
    takes no responses, None while it does; `is_held` whether it waits after a refusal.
    """

    __slots__ = ("_hold", "blocked_at", "is_held")

    def __init__(self) -> None:
        self.blocked_at: float | None = None
        self.is_held = False
        self._hold = SHORTEST_HOLD

    @property
    def is_on(self) -> bool:
        """Whether it waits for either."""
        return self.is_held or self.blocked_at is not None

    def hold(self) -> float:
        """There was no room: the client waits; for how many seconds, 0.0 if it does already."""
        if self.is_held:
            return 0.0
        self.is_held = True
        seconds = self._hold
        self._hold = min(self._hold * 2, LONGEST_HOLD)
        return seconds

    def recover(self) -> None:
        """There was room for a request: the next wait is shorter."""
        self._hold = max(self._hold * HOLD_RECOVERS, SHORTEST_HOLD)
