"""Parameters of operations, read from JSON and from the text of an address."""

from dataclasses import dataclass
from typing import Annotated

import pytest

from gateway.errors import Malformed
from gateway.modbus.codes import Area
from gateway.operator.operations.asked import Addresses, NamedValue, Traced, UnitNamed
from gateway.operator.operations.parameters import Filled, InBody, OneOf, Within, parameters_of, read_parameters


@dataclass(frozen=True, slots=True)
class Asked:
    """One parameter of each kind."""

    unit: UnitNamed
    area: Area = Area.HOLDING
    start: Annotated[int | None, Within(0, 9), "an address from 0 to 9"] = None
    swap: Annotated[str, OneOf(("words", "bytes")), "words or bytes"] = ""
    is_all: bool = False
    values: Annotated[list[float | str], InBody(), Filled(), "a list with one value at least"] | None = None
    named: Annotated[list[NamedValue], InBody(), "a list of names and values"] | None = None


@dataclass(frozen=True, slots=True)
class Written:
    """Named values."""

    named: Annotated[list[NamedValue], Filled(), "a list of names and values"]


@pytest.mark.parametrize(
    ("text", "unit"), [("41", 41), ("255", 255), ("256", "256"), ("1234567890", "1234567890"), ("silo", "silo")]
)
def test_a_text_that_is_no_number_of_a_unit_is_a_name(text, unit):
    assert read_parameters(Asked, {"unit": text}, is_text=True).unit == unit


def test_text_is_taken_for_what_a_parameter_is():
    asked = read_parameters(
        Asked, {"unit": "silo", "area": "coils", "start": "7", "swap": "words", "is_all": "true"}, is_text=True
    )
    assert asked == Asked("silo", Area.COILS, 7, "words", is_all=True)
    assert read_parameters(Asked, {"unit": "silo", "swap": ""}, is_text=True).swap == ""


def test_a_list_of_objects_is_one_of_dataclasses():
    asked = read_parameters(Written, {"named": [{"point": "speed", "value": 3}]})
    assert asked.named == [NamedValue("speed", 3)]


def test_null_is_as_if_nothing_were_said_which_is_how_commands_of_an_earlier_version_say_it():
    asked = read_parameters(Asked, {"unit": 1, "area": None, "swap": None, "is_all": None, "values": None})
    assert asked == Asked(1)


@pytest.mark.parametrize(
    ("kind", "given", "said"),
    [
        (Asked, {}, '"unit" must be a number from 0 to 255, or a name'),
        (Asked, {"unit": None}, '"unit" must be a number from 0 to 255, or a name'),
        (Asked, {"unit": 256}, '"unit" must be a number from 0 to 255, or a name'),
        (Asked, {"unit": True}, '"unit" must be a number from 0 to 255, or a name'),
        (Asked, {"unit": 1, "area": "tables"}, '"area" must be one of coils, discrete, input, holding'),
        (Asked, {"unit": 1, "area": []}, '"area" must be one of coils, discrete, input, holding'),
        (Asked, {"unit": 1, "start": 10}, '"start" must be an address from 0 to 9'),
        (Asked, {"unit": 1, "start": "7"}, '"start" must be an address from 0 to 9'),
        (Asked, {"unit": 1, "swap": "both"}, '"swap" must be words or bytes'),
        (Asked, {"unit": 1, "values": []}, '"values" must be a list with one value at least'),
        (Asked, {"unit": 1, "values": "x"}, '"values" must be a list with one value at least'),
        (Written, {"named": [{"point": "speed"}]}, '"named" must be a list of names and values'),
        (Written, {"named": [{"point": "speed", "value": 1, "more": 1}]}, '"named" must be a list of names and values'),
        (Written, {"named": ["speed"]}, '"named" must be a list of names and values'),
    ],
)
def test_what_a_parameter_cannot_be_is_refused_in_words(kind, given, said):
    with pytest.raises(Malformed) as wrong:
        read_parameters(kind, given)
    assert str(wrong.value) == said


@pytest.mark.parametrize("since", [10**400, 1e300, float("nan"), float("inf"), -1])
def test_a_time_that_no_clock_has_is_refused(since):
    with pytest.raises(Malformed, match='"since" must be a number of seconds, not below 0'):
        read_parameters(Traced, {"since": since})


@pytest.mark.parametrize(("name", "one"), [("type", "float32"), ("swap", "words")])
def test_what_a_value_can_be_encoded_as_is_named(name, one):
    with pytest.raises(Malformed, match=f'"{name}" must be one of .*{one}'):
        read_parameters(Addresses, {"unit": 1, "area": "holding", "start": 0, name: "unheard-of"})


def test_what_comes_in_a_body_is_known():
    assert [each.name for each in parameters_of(Asked) if each.is_in_body] == ["values", "named"]
    assert [each.name for each in parameters_of(Asked) if each.is_required] == ["unit"]
