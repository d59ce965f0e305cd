"""JSON schemas of dataclasses, from the types of their fields, so that they describe what is really told."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from inspect import cleandoc
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

Schema = dict[str, Any]
_PLAIN: Mapping[Any, Schema] = {
    int: {"type": "integer"},
    float: {"type": "number"},
    str: {"type": "string"},
    bool: {"type": "boolean"},
    NoneType: {"type": "null"},
    Any: {},
}


def schemas_of(types: Mapping[str, type]) -> dict[str, Schema]:
    """The schemas of dataclasses, and of all in them, by name."""
    names = {cls: name for name, cls in types.items()}
    found: dict[str, Schema] = {}
    waiting = list(types.values())
    while waiting:
        cls = waiting.pop()
        name = _name(cls, names)
        if name not in found:
            found[name] = _of_dataclass(cls, names, waiting)
    return found


def _name(cls: type, names: dict[type, str]) -> str:
    """What a class is called in the document; where another is called so, its module is part of the name."""
    if cls not in names:
        module = cls.__module__.rpartition(".")[2].title().replace("_", "")
        names[cls] = module + cls.__name__ if cls.__name__ in names.values() else cls.__name__
    return names[cls]


def _of_dataclass(cls: type, names: dict[type, str], waiting: list[type]) -> Schema:
    hints = get_type_hints(cls)
    return {
        "type": "object",
        "description": cleandoc(cls.__doc__ or ""),
        "properties": {each.name: _of_type(hints[each.name], names, waiting) for each in fields(cls)},
        "required": [each.name for each in fields(cls)],
        "additionalProperties": False,
    }


def _of_type(hint: Any, names: dict[type, str], waiting: list[type]) -> Schema:
    if hint in _PLAIN:
        return _PLAIN[hint]
    if is_dataclass(hint) and isinstance(hint, type):
        waiting.append(hint)
        return {"$ref": f"#/components/schemas/{_name(hint, names)}"}
    if isinstance(hint, type) and issubclass(hint, Enum):
        return {"enum": [each.value for each in hint]}
    return _of_compound(get_origin(hint), get_args(hint), names, waiting)


def _of_compound(origin: Any, parts: tuple[Any, ...], names: dict[type, str], waiting: list[type]) -> Schema:
    if origin is Literal:
        return {"enum": list(parts)}
    if origin in (Union, UnionType):
        return {"anyOf": [_of_type(part, names, waiting) for part in parts]}
    if origin in (tuple, list, frozenset):
        return {"type": "array", "items": _of_type(parts[0], names, waiting)}
    return {"type": "object", "additionalProperties": _of_type(parts[1], names, waiting)}
