"""Reads the result of an operation back from JSON, into the dataclass that it was written from.

The gateway may be of another version. Additional fields are ignored; missing ones get the default of the field. So a
field that is added later needs a default.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, Field, fields, is_dataclass
from enum import Enum
from functools import cache
from types import NoneType, UnionType
from typing import Annotated, Any, Final, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

R = TypeVar("R")
_Read = Callable[[Any], Any]

#: The JSON types of plain values, and their names in messages.
_PLAIN: Final[Mapping[Any, tuple[tuple[type, ...], str]]] = {
    str: ((str,), "a text"),
    int: ((int,), "a whole number"),
    float: ((int, float), "a number"),
    bool: ((bool,), "true or false"),
    NoneType: ((NoneType,), "null"),
}


class NotUnderstoodError(ValueError):
    """A result of another form. `place` is the field, and `what` is wrong with it."""

    def __init__(self, what: str, place: str = "") -> None:
        super().__init__(f"'{place.removeprefix('.')}' {what}" if place else f"it {what}")
        self.what = what
        self.place = place

    def inside(self, place: str) -> "NotUnderstoodError":
        """Return the same error for a field inside `place`."""
        return NotUnderstoodError(self.what, place + self.place)


def read_result(kind: type[R], told: object) -> R:
    """Read a dataclass from JSON.

    Raises:
        NotUnderstoodError: a field is missing, or holds something else; the message names it.
    """
    result: R = _reader_of(kind)(told)
    return result


def _reader_of(kind: Any) -> _Read:
    return _reader(kind)


@cache
def _reader(hint: Any) -> _Read:
    """Make the reader of values of this type."""
    make = _COMPOSED.get(get_origin(hint))
    if make is not None:
        return make(get_args(hint))
    if hint in _PLAIN:
        return _plain(*_PLAIN[hint])
    if isinstance(hint, type) and is_dataclass(hint):
        return _fields(hint)
    if isinstance(hint, type) and issubclass(hint, Enum):
        return _one_of_enum(hint)
    return lambda told: told


def _plain(kinds: tuple[type, ...], called: str) -> _Read:
    takes_bool = bool in kinds

    def read(told: Any) -> Any:
        if not isinstance(told, kinds) or (told.__class__ is bool and not takes_bool):
            raise NotUnderstoodError(f"is not {called}")
        return told

    return read


def _one_of(values: tuple[Any, ...]) -> _Read:
    def read(told: Any) -> Any:
        if told not in values:
            raise NotUnderstoodError(f"is none of {', '.join(map(str, values))}")
        return told

    return read


def _one_of_enum(kind: type[Enum]) -> _Read:
    read_value = _one_of(tuple(each.value for each in kind))
    return lambda told: kind(read_value(told))


def _any_of(hints: tuple[Any, ...]) -> _Read:
    """Make a reader that tries these types in turn; the error is that of the last one."""
    others = [_reader(each) for each in hints if each is not NoneType]
    takes_null = len(others) < len(hints)

    def read(told: Any) -> Any:
        if told is None and takes_null:
            return None
        for reader in others[:-1]:
            try:
                return reader(told)
            except NotUnderstoodError:
                continue
        return others[-1](told)

    return read


def _tuple(hints: tuple[Any, ...]) -> _Read:
    """Make a reader of a tuple: of any length, or with a type for each value."""
    if hints[-1] is Ellipsis:
        read_list = _list(hints)
        return lambda told: tuple(read_list(told))
    readers = [_reader(each) for each in hints]

    def read(told: Any) -> Any:
        _require(told, list, "a list")
        if len(told) != len(readers):
            raise NotUnderstoodError(f"does not have {len(readers)} values")
        return tuple(reader(each) for reader, each in zip(readers, told, strict=True))

    return read


def _list(hints: tuple[Any, ...]) -> _Read:
    reader = _reader(hints[0])

    def read(told: Any) -> Any:
        _require(told, list, "a list")
        values: list[Any] = []
        try:
            for each in told:
                values.append(reader(each))  # noqa: PERF401 - how far it got says where an error is
        except NotUnderstoodError as wrong:
            raise wrong.inside(f"[{len(values)}]") from None
        return values

    return read


def _table(hints: tuple[Any, ...]) -> _Read:
    """Make a reader of a mapping. Keys are text in JSON."""
    read_key = _number if hints[0] is int else _reader(hints[0])
    read_value = _reader(hints[1])

    def read(told: Any) -> Any:
        _require(told, dict, "an object")
        name, values = "", {}
        try:
            for name, each in told.items():
                values[read_key(name)] = read_value(each)
        except NotUnderstoodError as wrong:
            raise wrong.inside(f".{name}") from None
        return values

    return read


def _number(key: str) -> int:
    try:
        return int(key)
    except ValueError:
        raise NotUnderstoodError("is not a number") from None


def _fields(kind: type[Any]) -> _Read:
    """Make a reader of a dataclass."""
    hints = get_type_hints(kind)
    readers = {each.name: _reader(hints[each.name]) for each in fields(kind) if each.init}
    required = {each.name for each in fields(kind) if each.init and _is_required(each)}

    def read(told: Any) -> Any:
        _require(told, dict, "an object")
        missing = required - told.keys()
        if missing:
            raise NotUnderstoodError("is missing", f".{min(missing)}")
        name, values = "", {}
        try:
            for name, reader in readers.items():
                if name in told:
                    values[name] = reader(told[name])
        except NotUnderstoodError as wrong:
            raise wrong.inside(f".{name}") from None
        return kind(**values)

    return read


def _is_required(field: Field[Any]) -> bool:
    return field.default is MISSING and field.default_factory is MISSING


#: What makes the readers of composed types.
_COMPOSED: Final[Mapping[Any, Callable[[tuple[Any, ...]], _Read]]] = {
    Annotated: lambda hints: _reader(hints[0]),
    Union: _any_of,
    UnionType: _any_of,
    Literal: _one_of,
    tuple: _tuple,
    list: _list,
    Sequence: _list,
    dict: _table,
    Mapping: _table,
}


def _require(told: object, kind: type, called: str) -> None:
    if not isinstance(told, kind):
        raise NotUnderstoodError(f"is not {called}")
