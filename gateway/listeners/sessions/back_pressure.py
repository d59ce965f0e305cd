"""Why a client's requests are not read at the moment."""

from typing import Final

#: How long a client is not read after the queue of a line refused one of its requests, in seconds: at first, and at
#: most. Each such refusal doubles it; any other response multiplies it by this.
SHORTEST_HOLD: Final = 0.002
LONGEST_HOLD: Final = 0.128
HOLD_RECOVERS: Final = 0.8


class BackPressure:
    """Either the client does not read its responses, or the queue of a line has just refused one of its requests.

    Clients that repeat at once after a refusal would leave the lines no time. `blocked_at` is since when it does not
    read its responses, None while it does; `is_held` is whether it is held back after a refusal; `is_paused` is whether
    its connection has been told to receive nothing, for one of these or because it has enough requests in progress.
    """

    __slots__ = ("_hold", "blocked_at", "is_held", "is_paused")

    def __init__(self) -> None:
        self.blocked_at: float | None = None
        self.is_held = False
        self.is_paused = False
        self._hold = SHORTEST_HOLD

    @property
    def is_on(self) -> bool:
        """Whether the client is not to be read."""
        return self.is_held or self.blocked_at is not None

    def hold(self) -> float:
        """Hold the client back after a refusal; for how many seconds, 0.0 if it is already held back."""
        if self.is_held:
            return 0.0
        self.is_held = True
        seconds = self._hold
        self._hold = min(self._hold * 2, LONGEST_HOLD)
        return seconds

    def recover(self) -> None:
        """A request was accepted: the next hold is shorter."""
        self._hold = max(self._hold * HOLD_RECOVERS, SHORTEST_HOLD)
