"""What kinds of value are called in the documentation, and what they look like for an editor."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

from pydantic import GetJsonSchemaHandler
from pydantic_core import CoreSchema

Schema = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Kind:
    """How the documentation calls a kind of value, its JSON Schema, and how a file shows one."""

    name: str
    schema: Schema = field(hash=False)
    show: Callable[[Any], str] = str

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
