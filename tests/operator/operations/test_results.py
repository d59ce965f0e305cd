"""Results of operations, from JSON back to what they were."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Literal

import pytest

from gateway.control.messages import answer_of, line_of, question_of, result_in
from gateway.control.server import _line
from gateway.modbus.codes import Area
from gateway.operator.operations.answers.unit import UnitPicture
from gateway.operator.operations.parameters import read_parameters
from gateway.operator.operations.results import NotUnderstoodError, read_result
from gateway.operator.operations.table import BY_NAME, OPERATIONS
from gateway.profiles.point import Point
from kit.asking import answers
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import gateway_bench


@dataclass(frozen=True, slots=True)
class Inner:
    """Part of a result."""

    state: Literal["up", "down"]
    share: float | None = None


@dataclass(frozen=True, slots=True)
class Outer:
    """A result with a field of each kind."""

    name: Annotated[str, "a note"]
    parts: tuple[Inner, ...]
    counts: Mapping[int, Inner] = field(default_factory=dict)
    areas: dict[Area, list[int]] = field(default_factory=dict)
    span: tuple[int, int] = (0, 0)
    names: Sequence[str] = ()
    who: int | str = 0
    last: Inner | None = None
    is_fine: bool = True


WHOLE = Outer(
    "hall", (Inner("up"), Inner("down", 1)), {3: Inner("up")}, {Area.COILS: [1]}, (1, 2), ["a"], "silo", Inner("up")
)


def told(result):
    return json.loads(_line({"of": result}))["of"]


def test_what_was_told_is_what_it_was():
    assert read_result(Outer, told(WHOLE)) == WHOLE


def test_what_is_missing_has_its_default_and_what_is_new_is_ignored():
    assert read_result(Outer, {"name": "hall", "parts": [{"state": "up", "new": 1}], "new": 1}) == Outer(
        "hall", (Inner("up"),)
    )


def test_a_unit_of_a_gateway_that_knows_neither_gaps_nor_wide_registers_has_none():
    older = UnitPicture(1, "silo-1", "device", "generic", None, {}, {}, 0.0, (Point("a", Area.HOLDING, 3),))
    newer = told(older)
    point = {name: newer["points"][0][name] for name in ("name", "area", "address", "type", "swap", "count")}
    assert read_result(UnitPicture, {**without(newer, "max_gap", "wide"), "points": [point]}) == older


def without(result, *names):
    return {name: value for name, value in result.items() if name not in names}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"name": 3}, "'name' is not a text"),
        ({"parts": [{"state": "up"}, {}]}, "'parts[1].state' is missing"),
        ({"parts": [{"state": "new"}]}, "'parts[0].state' is none of up, down"),
        ({"parts": {}}, "'parts' is not a list"),
        ({"counts": {"3": {"state": "up", "share": "all"}}}, "'counts.3.share' is not a number"),
        ({"counts": {"three": {"state": "up"}}}, "'counts.three' is not a number"),
        ({"areas": {"tables": []}}, "'areas.tables' is none of coils, discrete, input, holding"),
        ({"span": [1, 2, 3]}, "'span' does not have 2 values"),
        ({"who": None}, "'who' is not a text"),
        ({"last": True}, "'last' is not an object"),
        ({"is_fine": 1}, "'is_fine' is not true or false"),
        ({"span": [True, 1]}, "'span[0]' is not a whole number"),
    ],
)
def test_what_is_wrong_is_named(change, said):
    with pytest.raises(NotUnderstoodError) as error:
        read_result(Outer, {**told(WHOLE), **change})
    assert str(error.value) == said


def test_a_result_that_is_no_object():
    with pytest.raises(NotUnderstoodError, match=r"^it is not an object$"):
        read_result(Outer, [])


CONFIG = """
[[line]]
name = "hall"
port = "/dev/hall"
devices = [{ unit = 1, as = 41, name = "silo-1", profile = "weigher" }]

[[image]]
unit = 200
name = "shift"
holding = 10
profile = "shift"

[profile.shift]
points = [{ name = "speed", holding = 0, write = true }]
"""
IMAGE = {"unit": 200, "area": "holding", "start": 0}
QUESTIONS = {
    "status": {},
    "config": {},
    "check-config": {"text": "[[image]]\nunit = 9\nhoding = 4\n[log]\n"},
    "lines": {},
    "line": {"name": "hall"},
    "units": {},
    "unit": {"unit": 41},
    "unit-status": {"unit": 41},
    "values": {},
    "points": {"unit": 200},
    "point": {"unit": 200, "name": "speed"},
    "read": {**IMAGE, "end": 3},
    "write-points": {"unit": 200, "values": [{"point": "speed", "value": 3}]},
    "write-point": {"unit": 200, "name": "speed", "values": [3]},
    "write": {**IMAGE, "values": [3]},
    "image": IMAGE,
    "request": {"unit": 41, "pdu": "03 00 00 00 01"},
    "doctor": {},
    "trace": {"since": 600, "lines": True},
    "meaning": {"unit": 41, "request": "03 00 00 00 02", "response": "03 04 45 9C 3D 51"},
    "why": {"who": "silo-1"},
    "events": {"since": 60, "unit": 41},
    "bench": {"line": "hall", "seconds": 1.0, "progress": True},
    "times": {"unit": 41},
    "scan": {"line": "hall", "units": "7-8"},
    "inventory": {},
    "support": {"trace": True},
}


@pytest.mark.parametrize("name", QUESTIONS)
def test_each_question_is_read_as_what_it_was(name):
    operation = BY_NAME[name]
    asked = read_parameters(operation.parameters, QUESTIONS[name])
    assert read_parameters(operation.parameters, json.loads(line_of(question_of(operation, asked)))) == asked


@pytest.mark.parametrize("name", QUESTIONS)
async def test_each_result_of_a_gateway_is_read_as_what_it_was(name):
    """What a field holds is what its type says."""
    operation = BY_NAME[name]
    async with gateway_bench(CONFIG) as bench:
        bench.attach("hall", SimulatedLine("rtu", SimulatedDevice(1)))
        for answer in await answers(bench.running, {"verb": name, **QUESTIONS[name]}):
            result = result_in(operation, told(answer))
            assert told(answer_of(operation, result)) == told(answer)


def test_each_operation_has_a_question_above_or_is_tested_elsewhere():
    elsewhere = {"which", "fleet", "reload", "forget", "line-history", "unit-history", "value-history"}
    assert set(QUESTIONS) | elsewhere == {each.name for each in OPERATIONS}
