"""What matters of a state, as one number: two states with the same one go on alike.

Objects are walked through all their attributes, whatever these are called, so that this holds for any machine. Times
count from now; which object is which counts, not where it lies. Left out is what only counts or tells.
"""

from collections import deque
from collections.abc import Collection
from dataclasses import is_dataclass
from types import BuiltinMethodType, FunctionType, GetSetDescriptorType, MemberDescriptorType, MethodType
from typing import Final

#: A number of so many seconds is a time, a smaller one is a duration.
EPOCH: Final = 1e6
#: A larger integer is a place in what a line has delivered, and counts from the end of that.
PLACES: Final = 1 << 40
#: What stands further before that stands long before, and what has no place yet has none.
_LONG_BEFORE: Final = 4096
_NO_PLACE: Final = 1 << 59
#: What has happened longer ago than this, in seconds, has happened long ago.
_LONG_AGO: Final = 1000.0

#: Public attributes that nothing follows from: counters, names, settings, and what is kept for those who read.
_TELLS_ONLY: Final = frozenset(
    {
        *("counts", "overheard", "unasked_bytes", "spent", "times", "settings", "setting", "source", "received_at"),
        *("error", "story"),
    }
)
_PLAIN: Final = frozenset({int, str, bytes, bool, type(None)})
_ORDERED: Final = (tuple, list, deque, bytearray)
_UNORDERED: Final = (set, frozenset)
_NAMED: Final = (FunctionType, BuiltinMethodType, type)


def picture(root: object, now: float, end: int) -> int:
    """The number that stands for `root` and all that it leads to, on a line that has delivered `end` bytes."""
    walk = _Walk(now, end)
    walk.take(root)
    return hash(tuple(walk.atoms))


class _Walk:
    def __init__(self, now: float, end: int) -> None:
        self.atoms: list[object] = []
        self._now = now
        self._end = end
        self._seen: dict[int, int] = {}
        self._kept: list[object] = []

    def take(self, each: object) -> None:
        kind = type(each)
        if kind is int and PLACES <= each < _NO_PLACE:
            self.atoms.append(max(each - self._end, -_LONG_BEFORE))
        elif kind in _PLAIN:
            self.atoms.append(each)
        elif kind is float:
            self.atoms.append(self._time(each))
        elif kind in _UNORDERED:
            self._take_all(sorted(each, key=repr))
        elif isinstance(each, _ORDERED):
            self._take_all(each)
        elif kind is dict:
            self._take_all(each)
            self._take_all(each.values())
        elif isinstance(each, MethodType):
            self.take(each.__name__)
            self.take(each.__self__)
        elif isinstance(each, _NAMED):
            self.take(each.__name__)
        else:
            self._take_object(each)

    def _take_all(self, items: Collection[object]) -> None:
        self.atoms.append(len(items))
        for item in items:
            self.take(item)

    def _time(self, seconds: float) -> int:
        since = seconds - self._now if seconds > EPOCH / 2 else seconds
        return round(1e6 * max(-_LONG_AGO, min(since, EPOCH)))

    def _take_object(self, each: object) -> None:
        if id(each) in self._seen:
            self.atoms.append(self._seen[id(each)])
            return
        constant = _constant(each)
        if constant is not None:
            self.atoms.append(constant)
            return
        self._seen[id(each)] = len(self._kept)
        self._kept.append(each)  # as long as it lives, nothing else has its id
        self.atoms.append(type(each).__name__)
        for name in _slots(type(each)):
            if hasattr(each, name):
                self.take(getattr(each, name))
        for name, value in getattr(each, "__dict__", {}).items():
            if name not in _TELLS_ONLY:
                self.atoms.append(name)
                self.take(value)


_names: dict[type, list[str]] = {}


def _slots(kind: type) -> list[str]:
    """The attributes that instances have without a dict; those of compiled classes look like properties in C."""
    if kind not in _names:
        _names[kind] = [
            name
            for each in kind.__mro__
            for name, value in vars(each).items()
            if isinstance(value, MemberDescriptorType | GetSetDescriptorType)
            and name not in _TELLS_ONLY
            and not name.startswith("__")
        ]
    return _names[kind]


def _constant(each: object) -> int | None:
    """What stands for a frozen dataclass, None for all else and for those that hold what may change."""
    if not (is_dataclass(each) and each.__dataclass_params__.frozen):
        return None
    try:
        return hash(each)
    except TypeError:
        return None
