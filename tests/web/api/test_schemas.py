"""JSON schemas of dataclasses."""

from collections.abc import Mapping
from dataclasses import make_dataclass
from typing import Any, Literal

import pytest

from gateway.modbus.codes import Area
from gateway.web.api.schemas import schemas_of


@pytest.mark.parametrize(
    ("hint", "schema"),
    [
        (int, {"type": "integer"}),
        (float | None, {"anyOf": [{"type": "number"}, {"type": "null"}]}),
        (tuple[str, ...], {"type": "array", "items": {"type": "string"}}),
        (Literal["up", "down"], {"enum": ["up", "down"]}),
        (Area, {"enum": ["coils", "discrete", "input", "holding"]}),
        (Mapping[int, bool], {"type": "object", "additionalProperties": {"type": "boolean"}}),
        (Any, {}),
    ],
)
def test_types(hint, schema):
    told = schemas_of({"Thing": make_dataclass("Thing", [("part", hint)])})["Thing"]
    assert told["properties"] == {"part": schema}
    assert (told["required"], told["additionalProperties"]) == (["part"], False)


def test_of_two_classes_with_one_name_each_has_its_own_schema():
    one = make_dataclass("Counts", [("a", int)], namespace={"__module__": "gateway.one"})
    other = make_dataclass("Counts", [("b", int)], namespace={"__module__": "gateway.some_other"})
    outer = make_dataclass("Outer", [("x", one), ("y", other)])
    told = schemas_of({"Outer": outer})
    names = {part["$ref"].rpartition("/")[2] for part in told["Outer"]["properties"].values()}
    assert {tuple(told[name]["properties"]) for name in names} == {("a",), ("b",)}
