"""How busy a line was: an outline for a picture, and a row for each hour."""

from dataclasses import dataclass
from itertools import groupby

from gateway.timing.history import STEP, LineUse, Past
from gateway.web.pages.heat_map import clock, day_and_clock, midnight_before

#: The height of the picture: all of the time.
FULL = 100


@dataclass(frozen=True, slots=True)
class Hour:
    """What a line did in an hour, or in the part of it in which the gateway ran."""

    begin: str
    busy_share: float
    down_s: float
    sent: int
    failed: int


def busy_outline(past: Past, line: str) -> str:
    """Draw the busy share of a line as a path, a column for each slot; nothing where the gateway did not run."""
    parts: list[str] = []
    is_open = False
    for place, use in enumerate(_uses(past, line)):
        if use is not None:
            parts.append(f"{'' if is_open else f'M{place} {FULL}'}V{FULL - round(FULL * use.busy_share)}h1")
        elif is_open:
            parts.append(f"V{FULL}z")
        is_open = use is not None
    return "".join(parts) + (f"V{FULL}z" if is_open else "")


def hours(past: Past, line: str) -> list[Hour]:
    """List the hours of the last day, the last one first; those of the day before with their date."""
    slots = [(past.first + place, use) for place, use in enumerate(_uses(past, line)) if use is not None]
    per_hour = 3600 // STEP
    today = midnight_before(past.first + len(past.slots) - 1)
    rows = []
    for hour, group in groupby(slots, key=lambda slot: slot[0] // per_hour):
        use = LineUse()
        for _, each in group:
            use = use.plus(each)
        begin = hour * per_hour
        rows.append(
            Hour(
                clock(begin) if begin >= today else day_and_clock(begin), use.busy_share, use.down, use.sent, use.failed
            )
        )
    return rows[::-1]


def _uses(past: Past, line: str) -> list[LineUse | None]:
    return [None if slot is None else slot.lines.get(line) for slot in past.slots]
