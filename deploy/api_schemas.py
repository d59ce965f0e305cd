"""JSON schemas of types, as pydantic makes them; used only by `document.py`."""

from dataclasses import fields
from inspect import cleandoc
from typing import Any, Final

from pydantic import TypeAdapter
from pydantic.json_schema import GenerateJsonSchema

Schema = dict[str, Any]

#: Where the schemas of types stand in the document.
PLACE: Final = "#/components/schemas/"
_NULL: Final = {"type": "null"}


def schema_of(kind: Any) -> Schema:
    """Make the schema of a type, with references to those of dataclasses."""
    return schemas_of(kind)[0]


def schemas_of(kind: Any) -> tuple[Schema, dict[str, Schema]]:
    """Make the schema of a type, and those that it refers to by name."""
    schemas, shared = TypeAdapter.json_schemas(
        [("it", "serialization", TypeAdapter(kind))],
        ref_template=PLACE + "{model}",
        schema_generator=_Schemas,
    )
    schema = schemas["it", "serialization"]
    return schema, shared.get("$defs", {})


class _Schemas(GenerateJsonSchema):
    """Schemas of what is sent: each field is there, except those that are left out while unknown, and no other."""

    def dataclass_schema(self, schema: Any) -> Schema:
        """Describe a dataclass."""
        made, kind = super().dataclass_schema(schema), schema["cls"]
        may_be_missing = {each.name for each in fields(kind) if "if_known" in each.metadata}
        return {
            "type": "object",
            "description": cleandoc(kind.__doc__ or ""),
            "properties": {
                name: without_null(each) if name in may_be_missing else each
                for name, each in made["properties"].items()
            },
            "required": [each.name for each in fields(kind) if each.name not in may_be_missing],
            "additionalProperties": False,
        }

    def default_schema(self, schema: Any) -> Schema:
        """Leave out defaults: all fields are sent."""
        return self.generate_inner(schema["schema"])

    def field_title_should_be_set(self, _schema: Any) -> bool:
        """Leave out titles: they only repeat names."""
        return False

    def get_title_from_name(self, _name: str) -> str:
        """Leave them out here too."""
        return ""


def without_null(schema: Schema) -> Schema:
    """Remove null from a schema of a value that is left out instead."""
    others = [each for each in schema.get("anyOf", ()) if each != _NULL]
    if len(others) == 1:
        return {**{name: each for name, each in schema.items() if name != "anyOf"}, **others[0]}
    return {**schema, "anyOf": others} if others else dict(schema)


def reference_to(name: str) -> Schema:
    """Refer to a schema by its name."""
    return {"$ref": f"{PLACE}{name}"}
