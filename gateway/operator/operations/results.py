"""Reads the result of an operation back from JSON, into the dataclass that it was written from.

The gateway may be of another version. Additional fields are ignored; missing ones get the default of the field. So a
field that is added later needs a default.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, fields, is_dataclass
from enum import Enum
from functools import cache
from itertools import repeat
from types import NoneType, UnionType
from typing import Annotated, Any, Final, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

R = TypeVar("R")
_Read = Callable[[Any], Any]


class NotUnderstoodError(ValueError):
    """A result of another form. `place` is the field, and `what` is wrong with it."""

    def __init__(self, what: str, place: str = "") -> None:
        super().__init__(f"'{place.removeprefix('.')}' {what}" if place else f"it {what}")
        self.what = what
        self.place = place

    def inside(self, place: int | str) -> "NotUnderstoodError":
        """Return the same error for a value inside another one: at this place in a list, or in this field."""
        return NotUnderstoodError(self.what, (f"[{place}]" if isinstance(place, int) else f".{place}") + self.place)


def read_result(kind: type[R], told: object) -> R:
    """Read a dataclass from JSON.

    Raises:
        NotUnderstoodError: a field is missing, or holds something else; the message names it.
    """
    hint: Any = kind
    result: R = _reader(hint)(told)
    return result


@cache
def _reader(hint: Any) -> _Read:
    """Make the reader of values of this type."""
    kind, hints = get_origin(hint) or hint, get_args(hint)
    if kind is Annotated:
        read = _reader(hints[0])
    elif kind in (Union, UnionType):
        read = _any_of(hints)
    elif kind is Literal:
        read = _one_of(hints)
    elif kind in (tuple, list, Sequence):
        read = _list(kind, hints)
    elif kind in (dict, Mapping):
        read = _table(*hints)
    elif is_dataclass(kind):
        read = _fields(kind)
    elif isinstance(kind, type) and issubclass(kind, Enum):
        read = _member(kind)
    else:
        read = _PLAIN.get(kind, lambda told: told)
    return read


def _plain(called: str, *kinds: type) -> _Read:
    takes_bool = bool in kinds

    def read(told: Any) -> Any:
        if not isinstance(told, kinds) or (told.__class__ is bool and not takes_bool):
            raise NotUnderstoodError(f"is not {called}")
        return told

    return read


#: The readers of plain values.
_PLAIN: Final[Mapping[Any, _Read]] = {
    str: _plain("a text", str),
    int: _plain("a whole number", int),
    float: _plain("a number", int, float),
    bool: _plain("true or false", bool),
}
_LIST: Final = _plain("a list", list)
_OBJECT: Final = _plain("an object", dict)


def _one_of(values: tuple[Any, ...]) -> _Read:
    def read(told: Any) -> Any:
        if told not in values:
            raise NotUnderstoodError(f"is none of {', '.join(map(str, values))}")
        return told

    return read


def _member(kind: type[Enum]) -> _Read:
    read_value = _one_of(tuple(each.value for each in kind))
    return lambda told: kind(read_value(told))


def _any_of(hints: tuple[Any, ...]) -> _Read:
    """Make a reader that tries these types in turn; the error is that of the last one."""
    *others, last = (_reader(each) for each in hints if each is not NoneType)

    def read(told: Any) -> Any:
        if told is None and NoneType in hints:
            return None
        for reader in others:
            try:
                return reader(told)
            except NotUnderstoodError:
                continue
        return last(told)

    return read


def _list(kind: Any, hints: tuple[Any, ...]) -> _Read:
    """Make a reader of a list, or of a tuple: of any length, or with a type for each value."""
    many = None if kind is not tuple or hints[-1] is Ellipsis else len(hints)
    readers = repeat(_reader(hints[0])) if many is None else [_reader(each) for each in hints]

    def read(told: Any) -> Any:
        if many not in (None, len(_LIST(told))):
            raise NotUnderstoodError(f"does not have {many} values")
        values: list[Any] = []
        try:
            for reader, each in zip(readers, told, strict=False):
                values.append(reader(each))
        except NotUnderstoodError as wrong:
            raise wrong.inside(len(values)) from None
        return tuple(values) if kind is tuple else values

    return read


def _table(key: Any, value: Any) -> _Read:
    """Make a reader of a mapping. Keys are text in JSON."""
    read_key, read_value = _number if key is int else _reader(key), _reader(value)

    def read(told: Any) -> Any:
        name, values = "", {}
        try:
            for name, each in _OBJECT(told).items():
                values[read_key(name)] = read_value(each)
        except NotUnderstoodError as wrong:
            raise wrong.inside(name) from None
        return values

    return read


def _number(key: str) -> int:
    try:
        return int(key)
    except ValueError:
        raise NotUnderstoodError("is not a number") from None


def _fields(kind: Any) -> _Read:
    """Make a reader of a dataclass."""
    hints, known = get_type_hints(kind), [each for each in fields(kind) if each.init]
    readers = {each.name: _reader(hints[each.name]) for each in known}
    required = {each.name for each in known if each.default is MISSING and each.default_factory is MISSING}

    def read(told: Any) -> Any:
        missing = required - _OBJECT(told).keys()
        if missing:
            raise NotUnderstoodError("is missing", f".{min(missing)}")
        name, values = "", {}
        try:
            for name, reader in readers.items():
                if name in told:
                    values[name] = reader(told[name])
        except NotUnderstoodError as wrong:
            raise wrong.inside(name) from None
        return kind(**values)

    return read
