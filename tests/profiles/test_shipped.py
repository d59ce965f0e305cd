"""The shipped profiles are complete, spell alike and pass `check`, and no point takes the place of another."""

import re
from collections.abc import Iterator

import pytest

from gateway.profiles.point import Point
from kit.config_problems import problems
from kit.shipped import SHIPPED, shipped, shipped_points

#: Spelled so that Home Assistant knows them, as far as it has them.
_UNITS = {
    *("V", "kV", "mV", "A", "mA", "kA", "W", "kW", "MW", "var", "kvar", "VA", "kVA", "Hz", "Ω", "kΩ", "MΩ"),
    *("Wh", "kWh", "MWh", "kvarh", "kVAh", "Ah", "°C", "K", "%", "°", "rpm", "bar", "mbar", "Pa", "hPa", "kPa"),
    *("m³", "m³/h", "L", "L/h", "m/s", "W/m²", "s", "min", "h", "d", "mm", "m", "g", "kg", "t", "N", "kN", "Nm"),
    *("ppm", "lx", "pH"),
}
#: An area, an address, and a bit of what is there.
Place = tuple[str, int, int]


def places(point: Point) -> Iterator[Place]:
    """The bits that a point reads, each with its register or coil."""
    size = 8 * point.width if point.area in ("holding", "input") else 1
    last = size * point.count - 1
    low, high = point.bits or (0, last)
    for bit in range(low, high + 1):
        yield str(point.area), point.address + (last - bit) // size, bit % size


@pytest.mark.parametrize("name", SHIPPED)
def test_a_profile_says_what_it_is_out_of(name: str) -> None:
    kind = shipped(name)
    assert kind.title
    assert name == "generic" or kind.source


@pytest.mark.parametrize("name", SHIPPED)
def test_names_and_units_are_spelled_alike(name: str) -> None:
    names = [point.name for point in shipped_points(name)]
    assert len(set(names)) == len(names)
    assert [each for each in names if not re.fullmatch(r"[a-z][a-z0-9]*(-[a-z0-9]+)*", each)] == []
    assert {point.unit for point in shipped_points(name)} - _UNITS - {""} == set()


@pytest.mark.parametrize("name", SHIPPED)
def test_no_two_points_read_the_same_bits(name: str) -> None:
    """A word as a whole, and beside it what its bits mean, are no such two."""
    whole: dict[Place, Point] = {}
    parts: dict[Place, Point] = {}
    for point in sorted(shipped_points(name), key=lambda point: point.bits or (-1, -1)):
        if point.write == "only":
            continue
        seen = whole if point.bits is None else parts
        for place in places(point):
            assert seen.setdefault(place, point) is point
            assert point.bits is None or whole.get(place, point).span == point.span


@pytest.mark.parametrize("name", SHIPPED)
def test_a_config_with_it_passes_check(name: str) -> None:
    mode = shipped(name).mode or "rtu"
    line = f'[[line]]\nname = "a"\nport = "/dev/a"\nmode = "{mode}"\n'
    assert problems(f'{line}devices = [{{ unit = 1, name = "one", profile = "{name}" }}]\n') == []


@pytest.mark.parametrize("name", SHIPPED)
def test_what_has_sunspec_models_is_recognised_by_them(name: str) -> None:
    """They are asked before registers: a kind with a register would be taken for one with fewer models."""
    if any(point.name == "manufacturer" for point in shipped_points(name)):
        identity = shipped(name).identity
        assert identity is not None
        assert identity.sunspec[0] == 1
