"""The entry of a lease in the store."""

import json
from math import isfinite
from typing import Any, Final, NamedTuple

#: The longest valid time to live, in seconds; more is damage.
_LONGEST: Final = 3600.0
#: The longest valid name of a holder, and the deepest nesting of a state; more is damage.
_LONGEST_NAME: Final = 500
_DEEPEST: Final = 10
#: The holder named for an unreadable entry.
_NOBODY: Final = "somebody whose entry cannot be read"

#: The state that moves with the lease, as JSON values.
State = dict[str, Any]


class LeaseEntry(NamedTuple):
    """An entry: the holder of the lease, or the one that has released it.

    `instance` is the holder's process, `beat` counts its writes. After a released entry the next holder is silent for
    `silent` seconds. `state` moves to it.
    """

    holder: str
    instance: str
    beat: int
    ttl: float
    is_released: bool = False
    silent: float = 0.0
    state: State = {}  # noqa: RUF012 - never changed

    def encode(self) -> bytes:
        """Encode the entry as JSON."""
        return json.dumps(self._asdict()).encode()

    @classmethod
    def decode(cls, value: bytes, ttl: float) -> "LeaseEntry":
        """Decode a stored entry. An unreadable one counts as another holder's with the time to live `ttl`."""
        try:
            entry = cls(**json.loads(value))
            return entry if _is_sound(entry) else cls(_NOBODY, "", 0, ttl)
        except (ValueError, TypeError, RecursionError):
            return cls(_NOBODY, "", 0, ttl)


def _is_sound(entry: Any) -> bool:
    """Check the fields of an entry. Raises TypeError too if they are wrong."""
    types = isinstance(entry.instance, str) and isinstance(entry.beat, int) and isinstance(entry.is_released, bool)
    times = 0 < entry.ttl <= _LONGEST and 0 <= entry.silent <= _LONGEST
    return types and times and _is_name(entry.holder) and isinstance(entry.state, dict) and _can_move(entry.state)


def _is_name(holder: Any) -> bool:
    return isinstance(holder, str) and holder.isprintable() and len(holder) <= _LONGEST_NAME


def _can_move(value: Any, deepest: int = _DEEPEST) -> bool:
    """Tell whether a state can be written again: all numbers are finite, and it is not nested too deeply."""
    if isinstance(value, dict | list):
        held = value.values() if isinstance(value, dict) else value
        return deepest > 0 and all(_can_move(each, deepest - 1) for each in held)
    return not isinstance(value, float) or isfinite(value)
