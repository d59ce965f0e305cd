"""The keys of a row of a virtual unit: its place there, and what a read gets of a stale value."""

from gateway.config.problem import WrongValue
from gateway.config.values.ranges import MOST_ITEMS, is_range
from gateway.images.virtual.settings import WhenStale


def parse_map_place(value: object) -> int | str:
    """Parse where a row is in its unit: an address, or the name of a point.

    Raises:
        WrongValue: it is neither.
    """
    if isinstance(value, int) and not isinstance(value, bool):
        if 0 <= value < MOST_ITEMS:
            return int(value)
        raise WrongValue(f"addresses are 0 to {MOST_ITEMS - 1}")
    if not isinstance(value, str) or not value:
        raise WrongValue("must be an address, or the name of a point of the profile")
    if is_range(value):
        raise WrongValue("an address has no quotes", f"write at = {value.partition('-')[0].strip()}")
    return value


def parse_when_stale(value: object) -> WhenStale:
    """Parse what a read gets of a stale value.

    Raises:
        WrongValue: it is none of the three.
    """
    if value == "exception":
        return "exception"
    if value == "hold":
        return "hold"
    if isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= 0xFFFF:
        return int(value)
    raise WrongValue('must be "exception", "hold" or a number', "a number 0-65535 is what each register has then")
