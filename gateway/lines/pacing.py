"""When to look at a line again while an answer comes in, byte by byte, or noise.

Each byte that wakes the gateway costs as much as all else that is done for a transaction, and nothing can be decided
before the answer can be complete. So nobody looks until then. Why not have the driver gather bytes (VMIN):
docs/adr/0011-who-looks-at-each-byte.md
"""

from typing import Final

#: A byte may have waited in an adapter before it was handed over, so that those behind it come so many seconds sooner
#: than it seems: a USB frame lasts a millisecond.
HELD_BACK: Final = 0.001
#: The last bytes are read as they come: the one that was read last may be one character old.
AS_THEY_COME: Final = 1
#: It is worth it to look away if so many bytes come meanwhile.
WORTH: Final = 2
#: Nobody looks away for longer, in seconds: a port that is lost shows only to who looks.
LONGEST: Final = 0.05
#: Nor for longer than this before bytes were seen to come at the line's pace: the rest may come at once.
LONGEST_UNPROVEN: Final = 0.002
#: So long nobody looks at noise, in seconds: a driver keeps what comes meanwhile at any rate.
NOISE: Final = 0.005
#: When a byte is read tells to half a character when it came.
_ROUGHLY: Final = 0.5


def is_paced(came: int, character: float, seconds: float) -> bool:
    """Whether so many bytes may have taken so long on a line, and not less because they came from somewhere else."""
    return seconds >= (came - _ROUGHLY) * character


def look_at(missing: int, character: float, now: float, held_back: float, *, proven: bool) -> float | None:
    """When to look again for an answer of which at least `missing` bytes are still to come; None: at the next byte.

    It is `proven` that bytes come at the line's pace once some have.
    """
    away = min((missing - AS_THEY_COME) * character - held_back, LONGEST if proven else LONGEST_UNPROVEN)
    return None if away < WORTH * character else now + away


def look_at_noise(character: float, now: float) -> float | None:
    """When to look again at a line that is noisy and on which nothing is asked; None: at the next byte."""
    return None if WORTH * character > NOISE else now + NOISE


class Pace:
    """How bytes come from a line, whose longest frame has `longest` bytes."""

    def __init__(self, longest: int) -> None:
        self._longest = longest
        self._character = 0.0
        self._silence = 0.0
        self._held_back = 0.0
        #: Of an answer: when its first bytes came, how many they were, and how many have come.
        self._first_at = 0.0
        self._first = 0
        self._came = 0
        #: While nothing is asked: when the last byte came, and how many since the last silence.
        self._idle_at = 0.0
        self._unparted = 0

    def tune(self, character: float, silence: float, *, virtual: bool) -> None:
        """A character takes so many seconds, and so many of silence part two frames. See `Receiver` for `virtual`."""
        self._character = character
        self._silence = silence
        self._held_back = 0.0 if virtual else HELD_BACK

    def begin(self) -> None:
        """Something is asked."""
        self._first = self._came = self._unparted = 0

    def came(self, size: int, now: float) -> None:
        """So many bytes have come that may be those of the answer."""
        if not self._came:
            self._first_at, self._first = now, size
        self._came += size

    def came_idle(self, size: int, now: float) -> None:
        """So many bytes have come while nothing was asked."""
        if now - self._idle_at - size * self._character > self._silence:
            self._unparted = 0
        self._idle_at = now
        self._unparted += size

    @property
    def is_noisy(self) -> bool:
        """Whether more has come without a silence than any frame has."""
        return self._unparted > self._longest

    def look_at(self, missing: int, now: float) -> float | None:
        """When to look again for an answer of which at least `missing` bytes are still to come; None: at the next byte.

        What came faster than the line can carry it tells nothing of when the rest comes. That counts from the first
        byte, however long the device has thought before.
        """
        came = self._came - self._first
        if not missing or not is_paced(came, self._character, now - self._first_at):
            return None
        return look_at(missing, self._character, now, self._held_back, proven=came > 0)

    def look_at_idle(self, now: float) -> float | None:
        """The same while nothing is asked: noise need not be looked at byte by byte."""
        return look_at_noise(self._character, now) if self.is_noisy else None
