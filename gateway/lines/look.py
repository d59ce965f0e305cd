"""When to look at a line again while an answer comes in, byte by byte.

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


def look_at(missing: int, character: float, now: float, held_back: float) -> float | None:
    """When to look again for an answer of which at least `missing` bytes are still to come; None: at the next byte."""
    away = (missing - AS_THEY_COME) * character - held_back
    if away < WORTH * character:
        return None
    return now + min(away, LONGEST)
