"""Units that a program gives by number, and the config around them."""

import re
from pathlib import Path

import pytest

from gateway import CustomUnit, Gateway
from gateway.errors import ConfigError
from gateway.library.reading_config import read_text

LINE = (
    '[[line]]\nname = "hall"\nport = "/dev/null"\nbaud = 9600\nformat = "8E1"\n'
    'devices = [{ unit = 60, name = "silo" }, { unit = 5 }]\n'
)
BY_CONFIG = (
    '[[image]]\nunit = 60\nname = "time"\npython = "no_module_has_this_name:Clock"\ntimeout = "2 s"\nholding = 10\n'
)


READ = "write async def read(self, area, address, count)"


class Clock(CustomUnit):
    """Any unit."""


class Plain(CustomUnit):
    """One that nobody can await."""

    def read(self, area, address, count):
        return [area, address][:count]


class Short(CustomUnit):
    """One that does not ask for the area."""

    async def read(self, address, count):
        return [address] * count


def images(text, units):
    return read_text(text, Path(), units, has_state=False).plan.images


def errors(text, units):
    with pytest.raises(ConfigError) as caught:
        images(text, units)
    return [str(each) for each in caught.value.problems if each.severity == "error"]


def test_a_unit_is_an_image_of_its_own_with_all_addresses():
    (clock,) = images("", {60: Clock()})
    assert (clock.unit, clock.name, clock.python, clock.timeout) == (60, "clock-60", "Clock", 1.0)
    assert set(clock.areas.values()) == {((0, 65535),)}
    assert len(clock.areas) == 4


def test_a_unit_takes_the_place_of_the_one_that_the_config_names_and_nothing_is_imported():
    (clock,) = images(BY_CONFIG, {60: Clock()})
    assert (clock.name, clock.python, clock.timeout, len(clock.areas)) == ("time", "Clock", 2.0, 1)
    assert "there is no module no_module_has_this_name" in errors(BY_CONFIG, {61: Clock()})[0]


def test_the_config_may_name_a_unit_of_the_program():
    text = '[[image]]\nunit = 7\nmap = [{ at = 0, device = "clock-60", holding = 3, every = "1 s" }]\n'
    assert [each.name for each in images(text, {60: Clock()})] == ["clock-60"]
    assert 'there is no device "clock-60"' in errors(text, {61: Clock()})[0]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (LINE, '<text>: error: units[60]: 60 is already a unit of line "hall" (<text>:6)'),
        (
            "[[image]]\nunit = 60\nholding = 3",
            '<text>: error: units[60]: 60 is already a unit of image "image-60" (<text>:1)',
        ),
        ("[self]\nunit = 60", '<text>:2:8: error: self.unit: 60 is already a unit of image "clock-60" (units[60])'),
        (
            '[[image]]\nunit = 3\nname = "clock-60"\nholding = 3',
            '<text>: error: units[60]: "clock-60" is already used in <text>:1',
        ),
        (
            f"{BY_CONFIG}{BY_CONFIG}",
            '<text>:8:8: error: image[1].unit: 60 is already a unit of image "time" (<text>:1) (image "time")',
        ),
    ],
)
def test_a_number_or_name_that_the_config_uses_otherwise_is_an_error(text, said):
    assert said in errors(text, {60: Clock()})


def test_a_line_that_passes_units_through_leaves_those_of_the_program():
    plan = read_text(LINE[: LINE.index("devices")], Path(), {60: Clock()}, has_state=False).plan
    assert {60} == set(range(1, 248)) - {each.known_as for each in plan.lines[0].shared}


@pytest.mark.parametrize("number", [0, 248, 254, 256, -1, 10**30])
def test_a_number_that_no_client_can_use_is_an_error(number):
    assert (
        errors("", {number: Clock(), 255: Clock()})[0]
        == f"<text>: error: units[{number}]: {number} is neither 1-247 nor 255"
    )


@pytest.mark.parametrize(
    ("units", "said"),
    [
        ({60: Clock}, "units[60] is the class Clock: write Clock()"),
        ({60: None}, "units[60] is None, and no CustomUnit"),
        ({60: "a:Clock"}, "units[60] is 'a:Clock', and no CustomUnit"),
        ({"60": Clock()}, "units['60']: the number of a unit is an int"),
        ({True: Clock()}, "units[True]: the number of a unit is an int"),
        ({60.0: Clock()}, "units[60.0]: the number of a unit is an int"),
        ({60: Plain()}, f"units[60]: Plain has a read that is not async: {READ}"),
        ({60: Short()}, f"units[60]: Short has a read with other parameters, (address, count): {READ}"),
        ([Clock()], "units: write a dict such as {60: Clock()}, not list"),
    ],
)
def test_what_is_no_unit_is_a_type_error(units, said):
    for make in (lambda: Gateway.from_text("", units=units), lambda: Gateway({}, units=units)):
        with pytest.raises(TypeError, match=re.escape(said)):
            make()
