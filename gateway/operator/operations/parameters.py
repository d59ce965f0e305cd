"""Reads the parameters of an operation: from a JSON object, or from the text of an address and its query.

The annotations of a parameter (`Within` and others) describe themselves in a JSON schema: pydantic calls them when the
OpenAPI document is made, and is not loaded here.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass
from enum import Enum
from functools import cache
from types import NoneType, UnionType
from typing import Annotated, Any, Final, TypeVar, Union, get_args, get_origin, get_type_hints

from gateway.errors import Malformed

P = TypeVar("P")
N = TypeVar("N")

#: A text that may be read as a number; units and addresses are shorter.
_NUMBER: Final = re.compile(r"[0-9]{1,9}")


@dataclass(frozen=True, slots=True)
class Within:
    """A number from `least` to `most`: an annotation of a parameter."""

    least: float
    most: float

    def __get_pydantic_json_schema__(self, schema: Any, handler: Callable[[Any], dict[str, Any]]) -> dict[str, Any]:
        """Add the bounds to the schema of a number."""
        return {**handler(schema), "minimum": self.least, "maximum": self.most}


@dataclass(frozen=True, slots=True)
class OneOf:
    """One of these texts or numbers: an annotation of a parameter."""

    choices: Sequence[str | int]

    def __get_pydantic_json_schema__(self, _schema: Any, _handler: Callable[[Any], dict[str, Any]]) -> dict[str, Any]:
        """Make a schema of the choices."""
        return {"enum": list(self.choices)}


@dataclass(frozen=True, slots=True)
class Filled:
    """A list with one item at least: an annotation of a parameter."""

    def __get_pydantic_json_schema__(self, schema: Any, handler: Callable[[Any], dict[str, Any]]) -> dict[str, Any]:
        """Add the least length to the schema of a list."""
        return {**handler(schema), "minItems": 1}


@dataclass(frozen=True, slots=True)
class InBody:
    """An annotation of a parameter that comes in the body of an HTTP request."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter: its types, `what` it must be in words, and the notes of its annotation."""

    name: str
    types: tuple[type, ...]
    what: str
    notes: tuple[Any, ...]
    default: Any
    #: The dataclass of its items, if it is a list of those.
    item: Any = None

    @property
    def is_required(self) -> bool:
        """Whether it has no default."""
        return self.default is MISSING

    @property
    def is_in_body(self) -> bool:
        """Whether it comes in the body of an HTTP request."""
        return self.note(InBody) is not None

    def note(self, kind: type[N]) -> N | None:
        """Find the note of this kind; None if there is none."""
        return next((note for note in self.notes if isinstance(note, kind)), None)

    def takes(self, value: object) -> bool:
        """Return whether this value of JSON, or member of an enumeration, is valid."""
        if isinstance(value, bool):
            return bool in self.types
        one_of, within = self.note(OneOf), self.note(Within)
        if one_of is not None and value != self.default and value not in one_of.choices:
            return False
        if isinstance(value, int | float):
            fits = isinstance(value, self.types) or float in self.types
            return fits and (within is None or within.least <= value <= within.most)
        return isinstance(value, self.types) and (self.note(Filled) is None or bool(value))


def parameters_of(kind: Any) -> tuple[Parameter, ...]:
    """List the parameters that a dataclass describes: `Annotated[int, Within(1, 50), "a number from 1 to 50"]`."""
    return _parameters_of(kind)


@cache
def _parameters_of(kind: Any) -> tuple[Parameter, ...]:
    hints = get_type_hints(kind, include_extras=True)
    return tuple(_parameter(each, hints[each.name]) for each in fields(kind))


def _parameter(field: Field[Any], hint: Any) -> Parameter:
    types, notes = _types_and_notes(hint)
    what = next((note for note in notes if isinstance(note, str)), " or ".join(map(_called, types)))
    return Parameter(field.name, types, what, notes, field.default, _item(hint))


def _item(hint: Any) -> Any:
    """Find the dataclass of the items of a list; None if the parameter is no such list."""
    kind = get_args(hint)[0] if get_origin(hint) is Annotated else hint
    item = get_args(kind)[0] if get_origin(kind) is list else None
    return item if is_dataclass(item) else None


def _types_and_notes(hint: Any) -> tuple[tuple[type, ...], tuple[Any, ...]]:
    """Split a type into types and notes; parts may have notes: `Annotated[int | str, "a number or a name"] | None`."""
    origin = get_origin(hint)
    if origin is Annotated:
        part, *notes = get_args(hint)
        return _types_and_notes(part)[0], tuple(notes)
    if origin in (Union, UnionType):
        parts = [_types_and_notes(part) for part in get_args(hint)]
        return tuple(each for types, _ in parts for each in types), tuple(each for _, notes in parts for each in notes)
    return (origin or hint,), ()


def _called(kind: type) -> str:
    if issubclass(kind, Enum):
        return f"one of {', '.join(str(each.value) for each in kind)}"
    names = {int: "a number", float: "a number", str: "text", bool: "true or false", NoneType: "null"}
    return names.get(kind, kind.__name__)


def read_parameters(kind: Callable[..., P], given: Mapping[str, object], *, is_text: bool = False) -> P:
    """Read the parameters of a request. Null counts as missing, and others are ignored: clients may be older or newer.

    With `is_text` each value is text, as in the address of an HTTP request.

    Raises:
        Malformed: one is missing or invalid; the message names it, and says what it must be.
    """
    values = {}
    for each in parameters_of(kind):
        value = given.get(each.name)
        if value is not None:
            values[each.name] = _checked(each, _from_text(each, value) if is_text else value)
        elif each.is_required:
            raise _wrong(each)
    return kind(**values)


def _checked(parameter: Parameter, value: object) -> object:
    value = _member(parameter, value)
    if not parameter.takes(value):
        raise _wrong(parameter)
    return [_made(parameter, each) for each in value] if parameter.item and isinstance(value, list) else value


def _made(parameter: Parameter, each: object) -> object:
    """Make an item of a list from an object that has exactly its fields."""
    if not isinstance(each, dict) or set(each) != {field.name for field in fields(parameter.item)}:
        raise _wrong(parameter)
    return parameter.item(**each)


def _member(parameter: Parameter, value: object) -> object:
    """Convert a value to the member of an enumeration, if the parameter is one and has such a member."""
    members = next((kind for kind in parameter.types if issubclass(kind, Enum)), None)
    try:
        return value if members is None else members(value)
    except ValueError:
        return value


def _from_text(parameter: Parameter, text: object) -> object:
    """Convert a text to a number or truth value if it may be one; a number out of bounds may still be a name."""
    if isinstance(text, str) and int in parameter.types and _NUMBER.fullmatch(text):
        within, number = parameter.note(Within), int(text)
        is_name = str in parameter.types and within is not None and not within.least <= number <= within.most
        return text if is_name else number
    if isinstance(text, str) and bool in parameter.types and text in ("true", "false"):
        return text == "true"
    return text


def _wrong(parameter: Parameter) -> Malformed:
    return Malformed(f'"{parameter.name}" must be {parameter.what}')


def fields_of(value: Any) -> dict[str, Any]:
    """Return the fields of a dataclass by name, except `if_known` ones that are None. Unlike `asdict`, copy nothing."""
    return {
        name: each
        for name, only_if_known in _fields_of(value.__class__)
        if (each := getattr(value, name)) is not None or not only_if_known
    }


@cache
def _fields_of(kind: Any) -> tuple[tuple[str, bool], ...]:
    """List the fields of a dataclass, and which of them are told only if known."""
    return tuple((field.name, "if_known" in field.metadata) for field in fields(kind))
