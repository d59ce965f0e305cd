"""Meters and inverters: what their documents print, and what the points of their profiles make of it."""

from struct import pack

import pytest

from gateway.modbus import rtu
from gateway.profiles.point import Point
from gateway.registers.items import items_read, read_request
from kit.shipped import shipped_points

#: SDM630 Protocol, v2.0, section 3.8.1 (page 11), and SDM120M, V2.5, section 2.1 (page 3): "Volts 1", which is 230.2.
REQUEST = "01 04 00 00 00 02 71 CB"
RESPONSE = "01 04 04 43 66 33 34 1B 38"


def point_of(profile: str, name: str) -> Point:
    (point,) = (each for each in shipped_points(profile) if each.name == name)
    return point


@pytest.mark.parametrize(("profile", "name"), [("eastron-sdm630", "voltage-l1"), ("eastron-sdm120", "voltage")])
def test_the_printed_frames_are_those_of_the_first_voltage(profile: str, name: str) -> None:
    voltage = point_of(profile, name)
    assert rtu.encode(1, read_request(voltage.span)).hex(" ").upper() == REQUEST
    pdu = bytes.fromhex(RESPONSE)[1:-2]
    assert rtu.encode(1, pdu).hex(" ").upper() == RESPONSE
    assert voltage.value(items_read(voltage.span, pdu)) == 230.2


@pytest.mark.parametrize(("number", "scale", "value"), [(2071, -2, 20.71), (2071, 2, 207100), (0xFFFF, -2, None)])
def test_the_scale_is_that_of_the_register_behind_the_currents(number: int, scale: int, value: float | None) -> None:
    """SunSpec Logging in SolarEdge Inverters, version 2.0, page 16; 0xFFFF is SunSpec's "not implemented"."""
    current = point_of("sunspec-inverter", "current")
    assert (current.address, current.read_span.addresses) == (40072 - 1, "40071-40075")
    assert current.value(pack(">4Hh", number, 1, 2, 3, scale)) == value


def test_the_low_word_of_an_em340_comes_first() -> None:
    """Communication protocol, version 2 revision 9, sections 2.1 and 2.3."""
    power = point_of("carlo-gavazzi-em340", "active-power")
    assert power.value(bytes.fromhex("FF38 FFFF")) == -20
    assert power.value(bytes.fromhex("FFFF 7FFF")) is None
