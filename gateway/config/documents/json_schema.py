"""The JSON Schema of the config file, which `modbus-gateway check --schema` prints.

Editors complete keys with it, show what they mean, and mark most wrong values. `check` itself knows more; but what it
accepts, the schema accepts too.
"""

from collections.abc import Mapping, Sequence
from enum import Enum
from types import NoneType
from typing import Annotated, Any, Final, Literal, get_args, get_origin

from pydantic.fields import FieldInfo

from gateway.config.reading.wording import keys_of
from gateway.config.schema.root import Config
from gateway.config.schema.table import Table
from gateway.config.values.kinds import Kind

Schema = dict[str, Any]

_DRAFT: Final = "http://json-schema.org/draft-07/schema#"
#: What bounds a number, as pydantic and as JSON Schema say it.
_BOUNDS: Final = {"ge": "minimum", "gt": "exclusiveMinimum", "le": "maximum", "lt": "exclusiveMaximum"}
_PLAIN: Final[Mapping[Any, str]] = {int: "integer", float: "number", str: "string", bool: "boolean"}


def _text(pattern: str) -> Schema:
    return {"type": "string", "pattern": rf"^\s*({pattern})\s*$"}


def _any_of(*schemas: Schema) -> Schema:
    return {"anyOf": list(schemas)}


def _file(*plain: Schema) -> Schema:
    named = [{"type": "object", "required": [key], "properties": {key: _WORD}} for key in ("file", "credential")]
    return _any_of(*plain, *named)


_WORD: Final[Schema] = {"type": "string"}
_YES_OR_NO: Final[Schema] = {"type": "boolean"}
_NUMBER: Final[Schema] = {"type": "integer"}
_DURATION: Final = _text(r"0|[0-9]+(\.[0-9]+)?\s*(ms|s|min|h)")
_AUTO: Final[Schema] = {"const": "auto"}
_RANGE: Final = _any_of(_NUMBER, _text(r"[0-9]+(\s*-\s*[0-9]+)?"))
_RANGES: Final = _any_of(_RANGE, {"type": "array", "items": _RANGE})

#: What the kinds of value look like, by the names that docs/configuration.md has for them.
_KINDS: Final[Mapping[str, Schema]] = {
    "text": _WORD,
    "path": _WORD,
    "address": _text(".+://.+"),
    "path or address": _text("/.*|.+://.+"),
    "path or `{ credential = ... }`": _file(_WORD),
    "`{ file = ... }` or `{ credential = ... }`": _file(),
    'table such as `{ file = "metrics.token" }`': _file(),
    "duration": _DURATION,
    "duration from 10 ms": _DURATION,
    "duration from 1 s": _DURATION,
    'duration or `"auto"`': _any_of(_DURATION, _AUTO),
    'duration, `"auto"` or `"off"`': _any_of(_DURATION, _AUTO, {"const": "off"}),
    'size such as `"4 MiB"`': _text(r"0|[0-9]+(\.[0-9]+)?\s*(KiB|MiB|GiB)"),
    'text such as `"8E1"`': _text("[78][NEOneo][12]"),
    '`"refuse"`, `"broadcast"` or a unit': _any_of({"enum": ["refuse", "broadcast"]}, _NUMBER),
    "units": _RANGES,
    'units or `"all"`': _any_of({"const": "all"}, _RANGES),
    "addresses": _RANGES,
    "address or range": _RANGE,
    "function": {"type": "integer", "minimum": 1, "maximum": 127},
    "value": _any_of(_NUMBER, _YES_OR_NO),
    "table such as `{ 3 = 99 }`": {"type": "object", "additionalProperties": _NUMBER},
    'table such as `{ 0 = "off" }`': {"type": "object", "additionalProperties": _WORD},
    '`true`, `false` or `"only"`': {"enum": [True, False, "only"]},
    'list such as `["10.2.0.0/24"]`': {"type": "array", "items": _WORD},
    'list such as `["nats://127.0.0.1:4222"]`': {"type": "array", "items": _text(".+://.+")},
    '`true`, `false` or a prefix such as `"homeassistant"`': _any_of(_YES_OR_NO, _WORD),
    '`false` or table such as `{ group = "plant-2" }`': _any_of(
        {"const": False}, {"type": "object", "required": ["group"], "additionalProperties": _WORD}
    ),
}


def json_schema() -> Schema:
    """The schema of a whole file."""
    tables: dict[str, Schema] = {}
    _add_table(Config, tables)
    whole = tables.pop(Config.__name__)
    return {"$schema": _DRAFT, "title": "modbus-gateway", **whole, "definitions": tables}


def _add_table(model: type[Table], tables: dict[str, Schema]) -> None:
    """Add the schema of a table, and those of the tables in it, to `tables` by their names."""
    if model.__name__ in tables:
        return
    schema: Schema = {"type": "object", "description": model.__doc__, "additionalProperties": False}
    tables[model.__name__] = schema
    fields = dict(zip(keys_of(model), model.model_fields.values(), strict=True))
    schema["properties"] = {key: _field(field, tables) for key, field in fields.items()}
    required = [key for key, field in fields.items() if field.is_required()]
    if required:
        schema["required"] = required


def _field(field: FieldInfo, tables: dict[str, Schema]) -> Schema:
    schema = _type(field.annotation, field.metadata, tables)
    description = {"description": field.description} if field.description else {}
    return {"allOf": [schema], **description} if "$ref" in schema else {**schema, **description}


def _type(annotation: Any, metadata: Sequence[Any], tables: dict[str, Schema]) -> Schema:
    for one in metadata:
        if isinstance(one, Kind):
            return _KINDS[one.name]
    if annotation in _PLAIN:
        return {"type": _PLAIN[annotation], **_bounds(metadata)}
    if isinstance(annotation, type) and issubclass(annotation, Table):
        _add_table(annotation, tables)
        return {"$ref": f"#/definitions/{annotation.__name__}"}
    if isinstance(annotation, type) and issubclass(annotation, Enum):
        return {"enum": [choice.value for choice in annotation]}
    return _compound(get_origin(annotation), get_args(annotation), tables)


def _compound(origin: Any, parts: tuple[Any, ...], tables: dict[str, Schema]) -> Schema:
    if origin is Annotated:
        return _type(parts[0], parts[1:], tables)
    if origin is Literal:
        return {"enum": list(parts)}
    if origin is tuple:
        return {"type": "array", "items": _type(parts[0], (), tables)}
    if origin is Mapping:
        return {"type": "object", "additionalProperties": _type(parts[1], (), tables)}
    (given,) = (part for part in parts if part is not NoneType)  # `None` stands for a key that is not there
    return _type(given, (), tables)


def _bounds(metadata: Sequence[Any]) -> Schema:
    return {
        keyword: getattr(one, bound) for one in metadata for bound, keyword in _BOUNDS.items() if hasattr(one, bound)
    }
