"""What stands in the store of leases: one entry for each lease."""

import json
from math import isfinite
from typing import Any, Final, NamedTuple

#: The longest time to live that an entry may claim, in seconds; more is damage.
_LONGEST: Final = 3600.0
#: The longest name of a holder, and how deep what moves may be nested; more is damage.
_LONGEST_NAME: Final = 500
_DEEPEST: Final = 10
#: Who holds a lease whose entry cannot be read.
_NOBODY: Final = "somebody whose entry cannot be read"

#: What moves with the lease, as JSON has it.
State = dict[str, Any]


class LeaseEntry(NamedTuple):
    """What stands in the store: who holds the lease, or has released it.

    `instance` is the holder's process, `beat` counts its writes. Who takes a released lease is silent for `silent`
    seconds. `state` is what moves.
    """

    holder: str
    instance: str
    beat: int
    ttl: float
    is_released: bool = False
    silent: float = 0.0
    state: State = {}  # noqa: RUF012 - never changed

    def encode(self) -> bytes:
        """As it is stored."""
        return json.dumps(self._asdict()).encode()

    @classmethod
    def decode(cls, value: bytes, ttl: float) -> "LeaseEntry":
        """A stored entry. One that cannot be read is somebody's who lives for `ttl`."""
        try:
            entry = cls(**json.loads(value))
            return entry if _is_sound(entry) else cls(_NOBODY, "", 0, ttl)
        except (ValueError, TypeError, RecursionError):
            return cls(_NOBODY, "", 0, ttl)


def _is_sound(entry: Any) -> bool:
    """Whether all that was read is what it should be. Raises TypeError too if it is not."""
    types = isinstance(entry.instance, str) and isinstance(entry.beat, int) and isinstance(entry.is_released, bool)
    times = 0 < entry.ttl <= _LONGEST and 0 <= entry.silent <= _LONGEST
    return types and times and _is_name(entry.holder) and isinstance(entry.state, dict) and _can_move(entry.state)


def _is_name(holder: Any) -> bool:
    return isinstance(holder, str) and holder.isprintable() and len(holder) <= _LONGEST_NAME


def _can_move(value: Any, deepest: int = _DEEPEST) -> bool:
    """Whether this can be written again: it is nested no deeper, and all numbers are finite."""
    if isinstance(value, dict | list):
        held = value.values() if isinstance(value, dict) else value
        return deepest > 0 and all(_can_move(each, deepest - 1) for each in held)
    return not isinstance(value, float) or isfinite(value)
