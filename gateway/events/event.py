"""What all events have in common."""

import re
from collections.abc import Callable
from enum import IntEnum
from typing import ClassVar, Final, dataclass_transform

_FIELD: Final = re.compile(r"\{(\w+)\}")
_OPTIONAL: Final = re.compile(r"\[(.*?)\]")
_EMPTY: Final = ("", (), None)
_MISSING: Final = object()


class Level(IntEnum):
    """Log levels, with the numbers of Python's logging."""

    DEBUG = 10
    INFO = 20
    WARNING = 30
    ERROR = 40


@dataclass_transform(frozen_default=True)
class Event:
    """A log event. Its fields become the fields of the log line.

    To type checkers it is a frozen dataclass. At run time `dataclass` would compile six functions for each of the fifty
    events whenever the program starts, a tenth of all that it does until it is ready.
    """

    level: ClassVar[Level] = Level.INFO
    #: The event in words. `{unit}` is the value of a field; what stands in [...] is left out if a value in it is empty.
    says: ClassVar[str] = ""
    #: What is wrong from this event on, as in `LastEvents.began`; and what no longer is.
    begins: ClassVar[str] = ""
    ends: ClassVar[tuple[str, ...]] = ()
    #: The event's name in logs: `line_lost` for LineLost.
    name: ClassVar[str]
    #: The names of its fields, in the order of the values that make it.
    field_names: ClassVar[tuple[str, ...]] = ()
    #: By name the values of those that need not be given, and _MISSING for the others.
    _unless_given: ClassVar[dict[str, object]] = {}

    def __init_subclass__(cls) -> None:
        cls.name = re.sub(r"(?<!^)(?=[A-Z])", "_", cls.__name__).lower()
        cls.field_names = tuple(cls.__annotations__)
        cls._unless_given = {name: getattr(cls, name, _MISSING) for name in cls.field_names}

    def __init__(self, *values: object, **named: object) -> None:
        names = self.field_names
        if len(values) == len(names) and not named:
            self.__dict__.update(zip(names, values, strict=True))
        else:
            self.__dict__.update(self._completed(values, named))

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"{self} is frozen")

    def __eq__(self, other: object) -> bool:
        return isinstance(other, type(self)) and other.fields() == self.fields()

    def __hash__(self) -> int:
        return hash((type(self), *self.fields().values()))

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(f'{name}={value!r}' for name, value in self.fields().items())})"

    def fields(self) -> dict[str, object]:
        """Return the fields of the log line, by name."""
        return self.__dict__.copy()

    def in_words(self, template: str | None = None) -> str:
        """Return the event as a sentence; or another `template` filled in."""
        text = self.says if template is None else template
        return _FIELD.sub(self._told, _OPTIONAL.sub(self._kept, text)) if "{" in text else text

    def _completed(self, values: tuple[object, ...], named: dict[str, object]) -> dict[str, object]:
        """Return all fields, in their order."""
        names, given, who = self.field_names, len(values) + len(named), type(self).__name__
        told = {**self._unless_given, **dict(zip(names, values, strict=False)), **named}
        if len(values) > len(names) or len(told) > len(names) or not named.keys().isdisjoint(names[: len(values)]):
            raise TypeError(f"{who} has the fields {names}, and not {values} and {named}")
        if given < len(names) and (missing := [name for name in names if told[name] is _MISSING]):
            raise TypeError(f"{who} lacks {missing}")
        return told

    def _kept(self, part: re.Match[str]) -> str:
        """Return what stands in brackets, or nothing if a value in it is empty."""
        return "" if any(getattr(self, name) in _EMPTY for name in _FIELD.findall(part[1])) else part[1]

    def _told(self, field: re.Match[str]) -> str:
        value = getattr(self, field[1])
        if isinstance(value, tuple):
            return ", ".join(map(str, value))
        return f"{value:g}" if isinstance(value, float) else str(value)


#: Logs an event. It never raises and never blocks.
Emit = Callable[[Event], None]


def discard_event(event: Event) -> None:
    """Log nothing."""
