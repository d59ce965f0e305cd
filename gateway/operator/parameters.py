"""Reads the parameters of an operation: from a JSON object, or from the text of an address and its query."""

import re
from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, dataclass, fields
from functools import cache
from types import NoneType, UnionType
from typing import Annotated, Any, Final, TypeVar, Union, get_args, get_origin, get_type_hints

from gateway.errors import WrongQuestion

P = TypeVar("P")

#: The numbers that a text may be taken for: no unit and no address is longer.
_NUMBER: Final = re.compile(r"[0-9]{1,9}")


@dataclass(frozen=True, slots=True)
class Within:
    """A number from `least` to `most`: an annotation of a parameter."""

    least: float
    most: float


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter: the types that it may have, what it must be in words, and its bounds."""

    name: str
    types: tuple[type, ...]
    what: str
    within: Within | None
    is_required: bool

    def takes(self, value: object) -> bool:
        """Tell whether the parameter may be this value of JSON."""
        if isinstance(value, bool):
            return bool in self.types
        if not isinstance(value, int | float):
            return isinstance(value, self.types)
        fits = isinstance(value, self.types) or float in self.types
        return fits and (self.within is None or self.within.least <= value <= self.within.most)


def parameters_of(kind: Any) -> tuple[Parameter, ...]:
    """List the parameters that a dataclass describes: `Annotated[int, Within(1, 50), "a number from 1 to 50"]`."""
    return _parameters_of(kind)


@cache
def _parameters_of(kind: Any) -> tuple[Parameter, ...]:
    hints = get_type_hints(kind, include_extras=True)
    return tuple(_parameter(each, hints[each.name]) for each in fields(kind))


def _parameter(field: Field[Any], hint: Any) -> Parameter:
    types, notes = _types_and_notes(hint)
    return Parameter(
        field.name,
        types,
        next((note for note in notes if isinstance(note, str)), " or ".join(map(_called, types))),
        next((note for note in notes if isinstance(note, Within)), None),
        field.default is MISSING and field.default_factory is MISSING,
    )


def _types_and_notes(hint: Any) -> tuple[tuple[type, ...], tuple[Any, ...]]:
    """Take a type apart, of which also a part may be annotated: `Annotated[int | str, "a number or a name"] | None`."""
    origin = get_origin(hint)
    if origin is Annotated:
        part, *notes = get_args(hint)
        return _types_and_notes(part)[0], tuple(notes)
    if origin in (Union, UnionType):
        parts = [_types_and_notes(part) for part in get_args(hint)]
        return tuple(each for types, _ in parts for each in types), tuple(each for _, notes in parts for each in notes)
    return (origin or hint,), ()


def _called(kind: type) -> str:
    names = {int: "a number", float: "a number", str: "text", bool: "true or false", NoneType: "null"}
    return names.get(kind, kind.__name__)


def read_parameters(kind: Callable[..., P], given: Mapping[str, object], *, is_text: bool = False) -> P:
    """Read the parameters of a request. Others in it are ignored: it may be of another version.

    With `is_text` each value is text, as in the address of an HTTP request.

    Raises:
        WrongQuestion: one is missing, or is no such value; the message names it, and says what it must be.
    """
    values = {}
    for each in parameters_of(kind):
        if each.name in given:
            value = given[each.name]
            values[each.name] = _checked(each, _from_text(each, value) if is_text else value)
        elif each.is_required:
            raise _wrong(each)
    return kind(**values)


def _checked(parameter: Parameter, value: object) -> object:
    if not parameter.takes(value):
        raise _wrong(parameter)
    return value


def _from_text(parameter: Parameter, text: object) -> object:
    """Take a text for a number where it is one and the parameter may be one."""
    if isinstance(text, str) and int in parameter.types and _NUMBER.fullmatch(text):
        return int(text)
    if isinstance(text, str) and bool in parameter.types and text in ("true", "false"):
        return text == "true"
    return text


def _wrong(parameter: Parameter) -> WrongQuestion:
    return WrongQuestion(f'"{parameter.name}" must be {parameter.what}')


def fields_of(value: Any) -> dict[str, Any]:
    """Give the fields of a dataclass by name, without what is told only if known; unlike `asdict` it copies nothing."""
    told = ((field, getattr(value, field.name)) for field in fields(value))
    return {field.name: each for field, each in told if each is not None or "if_known" not in field.metadata}
