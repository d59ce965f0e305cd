"""What the rows of a virtual unit become: places, polls, conversions, and points."""

from textwrap import dedent

import pytest

from gateway.config.load import parse
from gateway.config.plan.add_ons import publishable
from gateway.config.plan.differences import differences
from gateway.config.plan.forecast import longest_waits, waits_behind
from gateway.config.plan.line_load import load_of
from gateway.config.resolve import resolve
from gateway.images.polls import Poll
from gateway.images.virtual.settings import FreshBits, SourceAge
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span

DEVICES = """\
[[line]]
name = "hall"
port = "/dev/a"
devices = [
  { unit = 1, as = 41, name = "meter 1", profile = "meter" },
  { unit = 2, as = "none", name = "2nd", profile = "meter" },
  { unit = 3, as = 43, name = "enron", profile = "wide" },
  { unit = 4, as = 44, name = "any" },
  { unit = 5, as = 45, name = "pv", profile = "solar" },
]
[profile.meter]
points = [
  { name = "serial", input = 20, type = "string", length = 4 },
  { name = "power", holding = 10, type = "int32", swap = "words", scale = 0.1, decimals = 1, unit = "kW", write=true },
  { name = "mode", holding = 30, bits = "0-3", labels = { 0 = "off", 1 = "on" }, write = true },
  { name = "alarm", holding = 30, bit = 4 },
  { name = "order", holding = 5, write = "only" },
  { name = "cold", holding = 31, type = "int8", scale = 0.5, offset = -10 },
  { name = "long", holding = 32, type = "uint32", bits = "4-23" },
  { name = "relay", coils = 7, write = true },
  { name = "door", discrete = 3 },
  { name = "state", holding = 40, labels = { 1 = "runs" } },
]
[profile.wide]
wide = { holding = "5000-5009" }
points = [{ name = "flow", holding = 5002, type = "float32", unit = "l" }]
[profile.solar]
points = [
  { name = "watts", holding = 100, type = "int16", scale_from = "watts-scale", unit = "W" },
  { name = "watts-scale", holding = 103, type = "int16" },
]
[profile.target]
points = [
  { name = "active", input = 0, type = "float32", swap = "bytes", unit = "kW" },
  { name = "total", input = 10, type = "uint32", scale = 10, scale_from = "total-scale" },
  { name = "total-scale", input = 12, type = "int16" },
  { name = "unused", input = 50 },
]
[[image]]
unit = 200
name = "shift"
holding = 10
"""


def plan_of(*rows, keys="", more="", devices=DEVICES):
    """The settings of a virtual unit with these rows, and of all else."""
    listed = "".join(f"  {{ {row} }},\n" for row in rows)
    text = f'{devices}[[image]]\nunit = 240\nname = "block"\nstale = "5 s"\n{keys}\nmap = [\n{listed}]\n{more}'
    loaded = parse(dedent(text), "gateway.toml", port_trouble=lambda _: None, real_path=str)
    assert [str(one) for one in loaded.problems if one.severity == "error"] == []
    return resolve(loaded.config)


def values_of(*rows, keys=""):
    (unit,) = plan_of(*rows, keys=keys).virtual
    return unit.values


def points_of(*rows, keys=""):
    return plan_of(*rows, keys=keys).points.get(240, ())


def of_meter(point, more=""):
    return f'at = 4, device = "meter 1", point = "{point}", every = "1 s"{more}'


def test_a_range_is_read_and_stands_as_it_is():
    row = 'at = 20, device = "any", input = "100-103", every = "500 ms", swap = "words"'
    (value,) = values_of(row)
    assert (value.place, value.device, value.swap) == (Span(Area.HOLDING, 20, 4), "any", "words")
    assert value.poll == Poll(Area.INPUT, 100, 103, 0.5)
    assert (value.point, value.target, value.write, value.when_stale) == (None, None, False, "exception")
    (value,) = values_of('at = 0, area = "discrete", device = "any", coils = 3, every = "1 s"')
    assert (value.place, value.poll.span) == (Span(Area.DISCRETE, 0, 1), Span(Area.COILS, 3, 1))


def test_a_point_without_a_type_has_its_registers():
    (value,) = values_of(of_meter("power"))
    assert (value.place, value.target) == (Span(Area.HOLDING, 4, 2), None)
    assert (value.point.name, value.poll.span) == ("power", Span(Area.HOLDING, 10, 2))
    (text,) = values_of(of_meter("serial"))
    assert (text.place.count, text.target) == (4, None)
    (wide,) = values_of('at = 4, device = "enron", point = "flow", every = "1 s"')
    assert (wide.place, wide.target) == (Span(Area.HOLDING, 4, 2), None)
    assert wide.poll == Poll(Area.HOLDING, 5002, 5002, 1.0, width=4)


@pytest.mark.parametrize(
    ("point", "type_", "count", "scale", "offset"),
    [
        ("mode", "uint16", 1, 1, 0),
        ("alarm", "uint16", 1, 1, 0),
        ("cold", "int16", 1, 0.5, -10),
        ("long", "uint32", 2, 1, 0),
        ("relay", "uint16", 1, 1, 0),
        ("door", "uint16", 1, 1, 0),
    ],
)
def test_bits_and_bytes_are_registers_with_their_number(point, type_, count, scale, offset):
    (value,) = values_of(of_meter(point))
    target = value.target
    assert (target.type, target.scale, target.offset) == (type_, scale, offset)
    assert value.place == target.span == Span(Area.HOLDING, 4, count)


def test_a_type_says_how_the_value_stands_there():
    (value,) = values_of(of_meter("power", ', type = "float64", swap = "both", scale = 1000, offset = 2'))
    target = value.target
    assert (target.type, target.swap, target.scale, target.offset) == ("float64", "both", 1000, 2)
    assert (value.place, target.unit, target.decimals) == (Span(Area.HOLDING, 4, 4), "kW", 1)
    (value,) = values_of(of_meter("power", ', type = "int16"'))
    assert (value.target.scale, value.target.swap, value.place.count) == (1, "none", 1)
    (text,) = values_of(of_meter("serial", ', type = "string", swap = "bytes"'))
    assert (text.target.count, text.target.swap) == (4, "bytes")


def test_single_bits_are_coils():
    coils = ', area = "coils"'
    (relay,) = values_of(of_meter("relay", coils))
    assert (relay.place, relay.target) == (Span(Area.COILS, 4, 1), None)
    (alarm,) = values_of(of_meter("alarm", coils))
    assert (alarm.place, alarm.target.area, alarm.target.type) == (Span(Area.COILS, 4, 1), Area.COILS, "bit")


def test_every_point_stands_behind_the_one_before():
    found = [(value.point.name, value.place.start, value.place.count) for value in values_of(of_meter("*"))]
    assert found == [
        ("power", 4, 2),
        ("mode", 6, 1),
        ("alarm", 7, 1),
        ("cold", 8, 1),
        ("long", 9, 2),
        ("state", 11, 1),
        ("serial", 12, 4),
    ]
    bits = [
        (value.point.name, str(value.place.area), value.place.start)
        for value in values_of(of_meter("*", ', area = "discrete"'))
    ]
    assert bits == [("relay", "discrete", 4), ("door", "discrete", 5)]


def test_values_are_numbers_whatever_labels_a_device_has():
    (value,) = values_of(of_meter("state"))
    assert value.point.value(bytes((0, 1))) == 1


def test_a_row_says_what_stale_values_are_or_else_the_unit_does():
    bit = 'at = 8, fresh = ["meter 1"]'
    row, other = of_meter("power"), of_meter("power", ', when_stale = "hold"').replace("at = 4", "at = 6")
    (one, two), _ = values_of(row, other, bit, keys="when_stale = 0x7FC0"), None
    assert (one.when_stale, two.when_stale) == (0x7FC0, "hold")


def test_bits_and_ages_of_sources():
    names = '["meter 1", "any"]'
    (unit,) = plan_of(
        of_meter("power"),
        'at = 6, device = "any", holding = "0-1", every = "1 s", write = true',
        f"at = 8, fresh = {names}",
        f'at = 0, area = "discrete", fresh = {names}',
        'at = 9, age = "any"',
        keys='holding = "20-29"\ncoils = 4',
    ).virtual
    assert unit.fresh == (
        FreshBits(Span(Area.HOLDING, 8, 1), ("meter 1", "any")),
        FreshBits(Span(Area.DISCRETE, 0, 2), ("meter 1", "any")),
    )
    assert unit.ages == (SourceAge(Span(Area.HOLDING, 9, 1), "any"),)
    assert (unit.unit, unit.name, unit.stale, unit.devices) == (240, "block", 5.0, ("meter 1", "any"))
    assert unit.areas == {Area.COILS: ((0, 3),), Area.DISCRETE: ((0, 1),), Area.HOLDING: ((4, 9), (20, 29))}
    assert unit.own.areas == {Area.COILS: ((0, 3),), Area.HOLDING: ((20, 29),)}
    many = ", ".join(['"meter 1"'] * 17)
    (unit,) = plan_of(of_meter("power"), f"at = 6, fresh = [{many}]").virtual
    assert unit.fresh[0].place.count == 2


def test_a_row_may_be_a_point_of_the_profile():
    keys = 'profile = "target"\ninput = "12"\ninitial.input = [{ at = 12, values = [0xFFFE] }]'
    row = 'device = "meter 1", point = "power", every = "1 s"'
    plan = plan_of(f'at = "active", {row}', f'at = "total", {row}', keys=keys)
    active, total = plan.virtual[0].values
    assert (active.place, active.target.type, active.target.swap) == (Span(Area.INPUT, 0, 2), "float32", "bytes")
    assert (total.target.scale, total.target.scale_at) == (0.1, None)  # 10 x 10 ^ -2
    assert [point.name for point in plan.points[240]] == ["active", "total", "total-scale"]


def test_rows_say_which_points_of_the_profile_can_be_written():
    more = """
[profile.other]
points = [
  { name = "setpoint", holding = 0, write = true },
  { name = "shown", holding = 1 },
  { name = "command", holding = 2, write = "only" },
  { name = "float", holding = 4, type = "float32", write = true },
  { name = "half", holding = 4, write = true },
  { name = "range", holding = 8, type = "float32", write = true },
  { name = "flag", holding = 8, bit = 1, write = true },
  { name = "own", holding = 20, write = true },
]"""
    rows = [
        'at = "setpoint", device = "any", holding = 7, every = "1 s"',
        'at = "shown", device = "any", holding = 3, every = "1 s", write = true',
        'at = "command", device = "any", holding = 4, every = "1 s"',
        'at = "float", device = "meter 1", point = "power", every = "1 s", write = true',
        'at = "range", device = "any", holding = "10-11", every = "1 s", write = true',
    ]
    points = plan_of(*rows, keys='profile = "other"\nholding = "20"', more=more).points[240]
    assert {point.name: point.write for point in points} == {
        "setpoint": "no",
        "shown": "yes",
        "command": "no",
        "float": "yes",
        "half": "no",
        "range": "yes",
        "flag": "yes",
        "own": "yes",
    }


def test_without_a_profile_its_points_are_called_after_devices_and_points():
    found = points_of(of_meter("power"), 'at = 6, device = "2nd", point = "mode", every = "1 s", write = true')
    power, mode = found
    assert (power.name, power.span, power.type, power.swap) == (
        "meter-1.power",
        Span(Area.HOLDING, 4, 2),
        "int32",
        "words",
    )
    assert (power.scale, power.unit, power.decimals, power.write) == (0.1, "kW", 1, "no")
    assert (mode.name, mode.write, mode.labels) == ("nd.mode", "yes", {0: "off", 1: "on"})
    assert mode.value(bytes((0, 1))) == "on"


def test_points_within_ranges_and_of_freshness():
    found = points_of(
        'at = 0, device = "meter 1", holding = "30-40", every = "1 s"',
        'at = 20, device = "any", holding = "0-1", every = "1 s"',
        'at = 22, fresh = ["any", "meter 1"]',
        'at = 23, age = "any"',
    )
    assert [(point.name, point.address, point.bits) for point in found] == [
        ("meter-1.mode", 0, (0, 3)),
        ("meter-1.alarm", 0, (4, 4)),
        ("meter-1.cold", 1, (0, 7)),
        ("meter-1.long", 2, (4, 23)),
        ("meter-1.state", 10, None),
        ("any.fresh", 22, (0, 0)),
        ("meter-1.fresh", 22, (1, 1)),
        ("any.age", 23, None),
    ]
    half = points_of('at = 0, device = "meter 1", holding = "31-32", every = "1 s"')
    assert [point.name for point in half] == ["meter-1.cold"]
    turned = 'at = 0, device = "meter 1", holding = "30-39", every = "1 s", swap = "words"'
    assert points_of(turned) == ()


def test_the_same_point_twice_has_two_names():
    found = points_of(of_meter("power"), of_meter("power", ', type = "float32"').replace("at = 4", "at = 6"))
    assert [point.name for point in found] == ["meter-1.power", "meter-1.power-2"]


def test_a_scale_register_is_where_it_is_mapped():
    row = 'at = 0, device = "pv", point = "watts", every = "1 s"'
    assert points_of(row) == ()
    assert [point.type for point in points_of(row + ', type = "float32"')] == ["float32"]
    watts, _ = points_of(row, 'at = 1, device = "pv", point = "watts-scale", every = "1 s"')
    assert (watts.name, watts.scale_at, watts.read_span) == ("pv.watts", 1, Span(Area.HOLDING, 0, 2))
    (watts,) = points_of(row, 'at = 9, device = "pv", holding = "102-104", every = "1 s"')[:1]
    assert watts.scale_at == 10


def test_a_device_that_only_a_listener_for_its_line_leads_to_has_its_points():
    apart = """\
[[listen]]
name = "all"
bind = "tcp://127.0.0.1:5020"
[[listen]]
name = "x"
bind = "tcp://127.0.0.1:5021"
line = "x"
[[line]]
name = "x"
port = "/dev/x"
profile = "wide"
"""
    lines = apart + DEVICES
    plan = plan_of('at = 0, device = "x/41", point = "flow", every = "1 s"', devices=lines)
    assert plan.virtual[0].values[0].poll.span == Span(Area.HOLDING, 5002, 1)
    assert [point.name for point in plan.points[240]] == ["x-41.flow"]
    assert "power" in [point.name for point in plan.points[41]]
    assert 99 not in plan.points


def test_a_server_line_waits_for_the_slowest_of_its_sources():
    serves = '[[line]]\nname = "panel"\nport = "/dev/b"\nrole = "server"\nserves = [240]\n'
    plan = plan_of(of_meter("power"), 'at = 6, device = "shift", holding = "0-1", every = "1 s"', more=serves)
    waits = longest_waits(plan.lines[0])
    assert waits_behind(plan.servers[0], plan) == {240: ("block", waits["meter 1"])}


def test_it_can_be_published_and_a_reload_sees_its_changes():
    plan = plan_of(of_meter("power"))
    (found,) = [each for each in publishable(plan) if each.name == "block"]
    assert (found.unit, [point.name for point in found.points]) == (240, ["meter-1.power"])
    assert differences(plan, plan_of(of_meter("power"))).changed == ()
    assert differences(plan, plan_of(of_meter("power", ', type = "float32"'))).changed == ("image block",)


def test_equal_polls_of_a_mirror_and_of_maps_count_once():
    mirror = (
        '[[image]]\nunit = 241\nname = "copy"\nof = "meter 1"\n'
        'read = [{ holding = ["10-11", "12-15"], every = "1 s" }]\nstale = "5 s"\n'
    )
    plan = plan_of(of_meter("power"), of_meter("power").replace("at = 4", "at = 6"), more=mirror)
    (load,) = load_of(plan.lines[0], plan)
    assert load.declared.by == ("virtual unit block", "mirror copy")
    assert load.declared.poll.span == Span(Area.HOLDING, 10, 6)
