"""The JSON Schema of the config file, which `modbus-gateway check --schema` prints.

Editors complete keys with it, show what they mean, and mark most wrong values. `check` itself knows more; but what it
accepts, the schema accepts too.
"""

import json
import tomllib
from typing import Final

from pydantic.fields import FieldInfo
from pydantic.json_schema import GenerateJsonSchema
from pydantic_core import core_schema

from gateway.config.schema.config import Config
from gateway.config.schema.table import Table, keys_of
from gateway.config.values.kind import Kind, Schema

#: Taplo knows no later draft.
_DRAFT: Final = "http://json-schema.org/draft-07/schema#"


def json_schema() -> Schema:
    """Make the schema of a whole file."""
    whole = Config.model_json_schema(ref_template="#/definitions/{model}", schema_generator=_Generator)
    tables = whole.pop("$defs")
    return {"$schema": _DRAFT, **whole, "title": "modbus-gateway", "definitions": tables}


class _Generator(GenerateJsonSchema):
    """What pydantic makes, with defaults as they are written in a file, and without null, which TOML does not have."""

    def model_schema(self, schema: core_schema.ModelSchema) -> Schema:
        """Make the schema of a table."""
        table = super().model_schema(schema)
        fields = zip(keys_of(schema["cls"]), schema["cls"].model_fields.values(), strict=True)
        table["properties"] = {key: _with_default(table["properties"][key], field) for key, field in fields}
        return table

    def nullable_schema(self, schema: core_schema.NullableSchema) -> Schema:
        """Make the schema of what may be left out: `None` stands for a key that is not there."""
        return self.generate_inner(schema["schema"])

    def default_schema(self, schema: core_schema.WithDefaultSchema) -> Schema:
        """Make the schema without the default, which is a value that was read already."""
        return self.generate_inner(schema["schema"])

    def field_title_should_be_set(self, schema: object) -> bool:  # noqa: ARG002
        """Set no titles: they would repeat the keys."""
        return False


def _with_default(schema: Schema, field: FieldInfo) -> Schema:
    reference = schema.pop("$ref", None)  # with something beside it, which this draft would not see
    text = "" if field.is_required() else default_text(field)
    default = {"default": tomllib.loads(f"default = {text}")["default"]} if text else {}
    return {**({"allOf": [{"$ref": reference}]} if reference else {}), **schema, **default}


def default_text(field: FieldInfo) -> str:
    """Show the default as it is written in a file; empty if that cannot be written."""
    value = field.default
    for one in field.metadata:
        if isinstance(one, Kind) and value not in ((), {}):
            return one.show(value)
    if value in (None, (), {}) or isinstance(value, Table):
        return ""
    return json.dumps(value)
