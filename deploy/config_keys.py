"""The keys of every table with their values, for the page that completes them: the JSON Schema, made small.

    PYTHONPATH=. .venv/bin/python -m deploy.config_keys > gateway/web/pages/static/config-keys.json

`{"Line": {"mode": {"what": "What is spoken on the line.", "values": ["rtu", "ascii"]}}}` has the keys of the whole file
under the empty name, and at a key the `table` that stands there, with `list` if `[[name]]` is written, and with `named`
if `[name.ANY]` is.
"""

import json
import re
import sys
from collections.abc import Iterator, Mapping
from typing import Any, Final

from gateway.config.documents.json_schema import json_schema

_REFERENCE: Final = re.compile(r"[^/]+$")
#: The end of a first sentence.
_SENTENCE: Final = re.compile(r"(?<=[.;])\s(?=[A-Z`\"])")
#: The longest description, in characters.
_LONGEST: Final = 110


def completion() -> dict[str, Any]:
    """Describe the keys of all tables."""
    schema = json_schema()
    tables = {"": schema["properties"]} | {name: each["properties"] for name, each in schema["definitions"].items()}
    return {name: {key: _key(each) for key, each in keys.items()} for name, keys in tables.items()}


def _key(schema: Mapping[str, Any]) -> dict[str, Any]:
    values = list(dict.fromkeys(_values(schema)))
    return {
        **({"what": _short(schema["description"])} if "description" in schema else {}),
        **({"values": values} if values else {}),
        **_table(schema),
    }


def _short(text: str) -> str:
    first = _SENTENCE.split(text)[0].replace("`", "").rstrip(";")
    return first if len(first) <= _LONGEST else f"{first[:_LONGEST].rpartition(' ')[0]} ..."


def _values(schema: Mapping[str, Any]) -> Iterator[Any]:
    """List the values of a key that takes only some, and those beside which it takes others."""
    yield from schema.get("enum", ())
    if schema.get("type") == "boolean":
        yield from (True, False)
    if isinstance(schema.get("items"), dict):
        yield from _values(schema["items"])
    for each in (*schema.get("anyOf", ()), *schema.get("allOf", ())):
        yield from _values(each)


def _table(schema: Mapping[str, Any]) -> dict[str, Any]:
    """Say which table stands at a key, if one does."""
    found = _find_table(schema)
    if found is None:
        return {}
    return {
        "table": found,
        **({"list": True} if "items" in schema else {}),
        **({"named": True} if isinstance(schema.get("additionalProperties"), dict) else {}),
    }


def _find_table(schema: Any) -> str | None:
    if not isinstance(schema, dict):
        return None
    if match := _REFERENCE.search(schema.get("$ref", "")):
        return match[0]
    inside = (
        schema.get("items"),
        schema.get("additionalProperties"),
        *schema.get("anyOf", ()),
        *schema.get("allOf", ()),
    )
    return next((name for each in inside if (name := _find_table(each)) is not None), None)


if __name__ == "__main__":
    sys.stdout.write(json.dumps(completion(), ensure_ascii=False, separators=(",", ":")) + "\n")
