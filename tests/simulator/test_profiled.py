"""A device that a profile describes: its values, what changes them, and what it refuses."""

import pytest

from gateway.config.load import parse
from gateway.modbus.codes import Area
from gateway.modbus.frame import Frame
from gateway.modbus.pdu import Span
from gateway.simulator.broken import with_faults
from gateway.simulator.described import kind_of
from gateway.simulator.profiled import Kind, Profiled

METER = """
title     = "Meter"
maker     = "Maker"
functions = [3, 4, 6, 16, 22]
limits    = { 3 = 20 }
input     = "0-9"
timing    = [{ fc = 3, items = 1, time = "40 ms" }]
points    = [
  { name = "voltage-l1", input = 0, type = "float32", unit = "V" },
  { name = "frequency", input = 2, scale = 0.01, unit = "Hz", decimals = 2 },
  { name = "energy-import", input = 4, type = "uint32", unit = "kWh", scale = 0.001 },
  { name = "inside", holding = 3, type = "int16", scale = 0.1, offset = -40, invalid = 0x8000, min = -10, max = 15 },
  { name = "state", holding = 8, labels = { 0 = "off", 7 = "on" }, invalid = 0, write = true },
  { name = "alarm", holding = 9, bit = 3 },
  { name = "mode", holding = 9, bits = "4-6", write = true },
  { name = "limit", holding = 20, write = true, write_at = 120, unit = "%" },
  { name = "active-power", holding = 30, type = "int16", unit = "W", scale_from = "power-sf" },
  { name = "power-sf", holding = 31, type = "int16" },
  { name = "digits", holding = 33, type = "bcd16", write = true },
  { name = "high", holding = 34, byte = "high", type = "int8", invalid = -128, write = true },
  { name = "low", holding = 34, byte = "low", invalid = 255 },
  { name = "serial-number", holding = 40, type = "string", length = 4 },
  { name = "model", holding = 50, type = "string", length = 5, byte = "low" },
]
"""


def kind(text: str = METER) -> Kind:
    config = f'[[line]]\nport = "/dev/hall"\ndevices = [{{ unit = 1, profile = "meter" }}]\n[profile.meter]\n{text}'
    loaded = parse(config, port_trouble=lambda port: None, real_path=lambda port: port)
    assert loaded.config is not None, [str(problem) for problem in loaded.problems]
    return kind_of("meter", loaded.config.profile["meter"])


def asked(device: Profiled, pdu: str, now: float = 0.0) -> str:
    answer = device.receive(Frame(device.unit, bytes.fromhex(pdu)), now, 9600)
    assert answer is not None
    return answer.frame.pdu.hex(" ").upper()


def values(device: Profiled, now: float = 0.0) -> dict[str, object]:
    """What its points say after all registers were read at a time."""
    for pdu in ("04 0000 000A", "03 0000 0014", "03 0014 0014", "03 0028 0014"):
        assert not asked(device, pdu, now).startswith("8"), pdu
    return {point.name: point.value(device.items(point.read_span)) for point in device.kind.points}


def test_each_point_has_a_plausible_value():
    told = values(Profiled(1, kind()))
    assert 225 < told.pop("voltage-l1") < 237
    assert told.pop("frequency") == pytest.approx(50, abs=0.5)
    assert told.pop("energy-import") == pytest.approx(12_345, rel=0.01)
    assert -10 <= told.pop("inside") <= 15
    assert told.pop("active-power") == pytest.approx(1840, rel=0.1)
    assert told.pop("power-sf") in range(-3, 1)
    assert told.pop("limit") == pytest.approx(50, rel=0.06)
    assert all(1 <= told.pop(name) <= 20 for name in ("digits", "high", "low"))
    assert told.pop("mode") in range(8)
    assert told == {"state": "on", "alarm": 0, "serial-number": "SIM-0001", "model": "Meter"}


def test_values_change_slowly_and_energy_only_grows():
    device = Profiled(1, kind())
    first, later, last = values(device, 1000.0), values(device, 1060.0), values(device, 4600.0)
    assert first["energy-import"] < later["energy-import"] < last["energy-import"]
    assert last["energy-import"] - first["energy-import"] == pytest.approx(1.84, rel=0.1)
    changed = {name for name in first if first[name] != later[name]}
    assert {"voltage-l1", "energy-import", "active-power"} <= changed
    assert changed.isdisjoint({"state", "mode", "limit", "high", "low", "digits", "power-sf", "serial-number"})


def test_the_same_device_shows_the_same_and_another_unit_or_seed_something_else():
    meter = kind()
    told = values(Profiled(1, meter), 7.0)
    assert values(Profiled(1, meter), 99.0) == told, "time counts from the first request"
    assert values(Profiled(2, meter))["voltage-l1"] != told["voltage-l1"]
    assert values(Profiled(1, meter, seed=1))["voltage-l1"] != told["voltage-l1"]


def test_what_is_set_stays():
    settings = {"voltage-l1": "231.5", "state": "off", "alarm": "1", "power-sf": "2", "active-power": "1800"}
    settings |= {"inside": "invalid", "high": "invalid", "low": "invalid", "limit": "7", "mode": "5"}
    device = Profiled(1, kind(METER.replace(", invalid = 0, write", ", write")), settings)
    for now in (0.0, 100.0):
        told = values(device, now)
        assert {name: str(told[name]) for name in settings} == settings | dict.fromkeys(
            ("inside", "high", "low"), "None"
        )
    assert asked(device, "03 0022 0001") == "03 02 80 FF"
    assert asked(device, "03 0078 0001") == "03 02 00 07", "also where it is written"


@pytest.mark.parametrize(
    ("settings", "complaint"),
    [
        ({"voltage": "1"}, "meter has no point voltage"),
        ({"inside": "15.1"}, "15.1 is too high"),
        ({"limit": "invalid"}, "limit has no number that means that there is no value"),
        ({"limit": "70000"}, "does not fit into uint16"),
    ],
)
def test_what_cannot_be_set(settings, complaint):
    with pytest.raises(ValueError, match=complaint):
        Profiled(1, kind(), settings)


@pytest.mark.parametrize("exponent", ["invalid", "11", "-32768"])
def test_a_scale_that_is_none(exponent):
    device = Profiled(
        1, kind(METER.replace('type = "int16" },', 'type = "int16", invalid = 0x8000 },')), {"power-sf": exponent}
    )
    for now in (0.0, 100.0):
        assert values(device, now)["active-power"] is None


@pytest.mark.parametrize("exponent", ["4", "+4", "1e1"])
def test_a_scale_that_is_set(exponent):
    told = values(Profiled(1, kind(), {"power-sf": exponent}))
    assert told["active-power"] % 10 ** int(float(exponent)) == 0


def test_points_with_a_scale_that_was_written_do_not_change():
    device = Profiled(1, kind())
    before = values(device)
    assert before["power-sf"] == 0
    asked(device, "06 001F 0003")
    assert values(device, 100.0)["active-power"] == 1000 * before["active-power"]


@pytest.mark.parametrize("number", ["40000", "x"])
def test_a_scale_that_its_register_cannot_hold(number):
    with pytest.raises(ValueError, match=number):
        Profiled(1, kind(), {"power-sf": number})


def test_no_value_of_floating_point_and_of_bcd():
    device = Profiled(1, kind(), {"voltage-l1": "invalid", "digits": "invalid"})
    told = values(device)
    assert (told["voltage-l1"], told["digits"]) == (None, None)


def test_no_value_of_a_bit_is_that_of_its_register():
    text = 'points = [{ name = "a", holding = 0, bit = 3, invalid = 0xFFFF }, { name = "b", holding = 0, bit = 4 }]'
    device = Profiled(1, kind(text), {"a": "invalid"})
    assert device.kind.points[0].value(device.items(Span(Area.HOLDING, 0, 1))) is None


def test_what_is_written_stays_and_appears_where_it_is_read():
    device = Profiled(1, kind())
    assert asked(device, "06 0078 0021") == "06 00 78 00 21"
    assert asked(device, "06 0003 01A4") == "06 00 03 01 A4"
    assert asked(device, "06 001E 0007") == "06 00 1E 00 07"
    assert asked(device, "16 0009 FF8F 0050") == "16 00 09 FF 8F 00 50"
    told = values(device, 500.0)
    assert (told["limit"], told["inside"], told["mode"], told["alarm"]) == (33, 2, 5, 0)
    assert device.items(Span(Area.HOLDING, 30, 1)) == b"\0\7"


def test_it_refuses_what_its_profile_does():
    device = Profiled(1, kind())
    assert asked(device, "01 0000 0001") == "81 01"
    assert asked(device, "03 0000 0015") == "83 03"
    assert asked(device, "04 0009 0002") == "84 02"
    assert asked(device, "03 FFFF 0001") == "03 02 00 00", "an area without ranges has all addresses, with 0"
    assert asked(device, "2B 0E 01 00") == "AB 01"


def test_it_takes_the_time_of_its_profile():
    device = Profiled(1, kind())
    answer = device.receive(Frame(1, bytes.fromhex("03 0000 0001")), 0.0, 9600)
    assert answer.delay == pytest.approx(0.040)


def test_faults_break_it_like_any_other_device():
    devices = with_faults([Profiled(1, kind())], frozenset({"slow", "duplicate-address"}), 9600)
    assert [device.unit for device in devices] == [1, 1]
    assert values(devices[0]) == values(devices[1])
    assert devices[0].receive(Frame(1, bytes.fromhex("03 0000 0001")), 0.0, 9600).delay > 1.5 * 0.040


def test_it_speaks_only_the_mode_of_its_profile():
    assert Profiled(1, kind()).modes == {"rtu", "ascii"}
    assert Profiled(1, kind('mode = "ascii"\n')).modes == {"ascii"}


def test_bits_show_what_the_whole_register_says():
    text = (
        'points = [{ name = "alarm", holding = 0, bit = 0 }, { name = "state", holding = 0, labels = { 5 = "five" } }]'
    )
    device = Profiled(1, kind(text))
    assert asked(device, "03 0000 0001") == "03 02 00 05"


def test_registers_of_four_bytes():
    text = 'wide = { holding = "5000-5999" }\npoints = [{ name = "a", holding = 5000, type = "float32", unit = "V" }]'
    device = Profiled(1, kind(text), {"a": "230.5"})
    (point,) = device.kind.points
    assert asked(device, "03 1388 0002") == "03 08 43 66 80 00 00 00 00 00"
    assert asked(device, "10 1388 0001 04 41200000") == "10 13 88 00 01"
    assert point.value(device.items(point.span)) == 10
    assert asked(device, "06 1388 0001") == "86 01"
    assert asked(device, "03 1387 0002") == "83 02"
    assert asked(device, "03 1387 0001") == "03 02 00 00"


def test_a_put_outside_its_addresses_is_an_error():
    with pytest.raises(ValueError, match="meter has no input 10-11"):
        Profiled(1, kind()).put(Span(Area.INPUT, 10, 2), bytes(4))


def test_a_register_tells_the_kind():
    device = Profiled(1, kind(METER.replace("timing", "identity = { holding = 8, equals = 0x1234 }\ntiming")))
    assert asked(device, "03 0008 0001") == "03 02 12 34"


def test_the_identification_tells_the_kind():
    device = Profiled(1, kind(METER.replace("timing", 'identity = { fc43 = "M-1" }\ntiming')))
    assert bytes.fromhex(asked(device, "2B 0E 01 00")[21:]) == b"\x00\x05Maker\x01\x03M-1\x02\x031.0"
    assert asked(device, "2B 0E 02 03").startswith("2B 0E 02 82 00 00 01 04 05 4D")
    assert asked(device, "2B 0E 01 77").startswith("2B 0E 01 82 00 00 03 00"), "from the first one (A 6.21)"
    assert asked(device, "2B 0E 04 01") == "2B 0E 04 82 00 00 01 01 03 4D 2D 31"
    assert asked(device, "2B 0E 04 09") == "AB 02"
    assert asked(device, "2B 0E 05 00") == "AB 03"


def test_a_chain_of_sunspec_models_tells_the_kind():
    text = 'holding = "40000-40300"\nidentity = { sunspec = [1, 103] }\npoints = [{ name = "w", holding = 40084 }]'
    device = Profiled(1, kind(text))
    assert asked(device, "03 9C40 0004") == "03 08 53 75 6E 53 00 01 00 42"
    assert asked(device, "03 9C86 0002") == "03 04 00 67 00 32"
    assert asked(device, "03 9CBA 0002") == "03 04 FF FF 00 00"
