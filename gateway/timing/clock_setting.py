"""How a wall clock is set, and whether times of earlier may be wrong by it."""

from typing import Final, NamedTuple

#: A clock was set if it has moved by more than this many seconds; corrections of a clock that runs are smaller.
_STEP: Final = 1.0


class ClockSetting(NamedTuple):
    """How the clock is set: so many seconds `ahead` of the time since the beginning of this `boot`.

    `is_set` is False while something is to set it, and has not done so yet.
    """

    boot: str
    ahead: float
    is_set: bool

    def has_stepped(self, since: "ClockSetting") -> bool:
        """Tell whether the clock was set since then, in the same boot."""
        return self.boot == since.boot and abs(self.ahead - since.ahead) > _STEP

    def differs(self, since: "ClockSetting") -> bool:
        """Tell whether times of then may be wrong by this clock: it was set since then."""
        return (self.is_set and not since.is_set) or self.has_stepped(since)
