"""What kinds of value are called in the documentation, what they look like for an editor, and how they are read."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import CoreSchema, core_schema

Schema = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Kind:
    """How the documentation calls a kind of value, its JSON Schema, and how a file shows one.

    `parse` reads what a user wrote, or raises WrongValue; without it pydantic reads the type itself.
    """

    name: str
    schema: Schema = field(hash=False)
    parse: Callable[[Any], Any] | None = None
    show: Callable[[Any], str] = str

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Return what reads a value."""
        return handler(source) if self.parse is None else core_schema.no_info_plain_validator_function(self.parse)

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: GetJsonSchemaHandler) -> Schema:
        """Return the schema: pydantic cannot know it of what a function reads."""
        return dict(self.schema)


WORD: Final[Schema] = {"type": "string"}
TRUTH: Final[Schema] = {"type": "boolean"}
NUMBER: Final[Schema] = {"type": "integer"}


def text(pattern: str) -> Schema:
    """Make the schema of text that matches `pattern`, with space around it or none."""
    return {"type": "string", "pattern": rf"^\s*({pattern})\s*$"}


def any_of(*schemas: Schema) -> Schema:
    """Make the schema of what one of these accepts."""
    return {"anyOf": list(schemas)}


def one_of(*values: Any) -> Schema:
    """Make the schema of these values."""
    return {"enum": list(values)}


def list_of(items: Schema) -> Schema:
    """Make the schema of a list."""
    return {"type": "array", "items": items}


def map_to(values: Schema) -> Schema:
    """Make the schema of a table with any keys."""
    return {"type": "object", "additionalProperties": values}
