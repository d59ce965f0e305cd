"""Virtual units: their rows, where these stand, and what their devices allow."""

import time

import pytest

from gateway.config.load import parse
from kit.config_problems import problems

DEVICES = """\
[[line]]
name = "hall"
port = "/dev/a"
devices = [
  { unit = 1, as = 41, name = "meter", profile = "meter" },
  { unit = 2, as = 42, name = "relay", profile = "relay" },
  { unit = 3, as = 43, name = "enron", profile = "wide" },
  { unit = 4, as = 44, name = "any" },
]
[profile.meter]
functions = [3, 4, 16]
limits = { 3 = 20 }
holding = "0-99"
input = "0-9"
points = [
  { name = "power", holding = 10, type = "int32", scale = 0.1, unit = "kW" },
  { name = "limit", holding = 12, write = true },
  { name = "order", holding = 13, write = "only" },
  { name = "serial", holding = 20, type = "string", length = 4 },
  { name = "state", holding = 30, bits = "0-3" },
  { name = "alarm", holding = 30, bit = 4 },
  { name = "energy", holding = 40, type = "uint32", scale_from = "energy-scale" },
  { name = "energy-scale", holding = 44, type = "int16" },
]
[profile.relay]
functions = [1, 2, 3, 5]
points = [{ name = "on", coils = 0, write = true }, { name = "closed", discrete = 0 }]
[profile.wide]
wide = { holding = "5000-5009" }
points = [{ name = "flow", holding = 5000, type = "float32" }]
[profile.target]
functions = [3, 4, 6, 16]
input = "0-19"
holding = "0-9"
points = [
  { name = "watts", input = 0, type = "float32" },
  { name = "model", input = 4, type = "string", length = 4 },
  { name = "flag", input = 8, bit = 1 },
  { name = "total", input = 10, type = "uint32", scale_from = "total-scale" },
  { name = "total-scale", input = 12, type = "int16" },
  { name = "demand", input = 14, type = "float32", unit = "W" },
]
[[image]]
unit = 200
name = "shift"
holding = 10
[[image]]
unit = 201
name = "copy"
of = "meter"
read = [{ holding = "0-1", every = "500 ms" }]
"""


def unit(*rows, keys=""):
    """A virtual unit with these rows and other keys."""
    listed = "".join(f"  {{ {row} }},\n" for row in rows)
    return f'{DEVICES}[[image]]\nunit = 240\nname = "block"\nstale = "5 s"\n{keys}\nmap = [\n{listed}]\n'


def said(*rows, keys=""):
    """What is said of it, without the place that all of it has."""
    return [each.replace("image[2].map[", "[") for each in problems(unit(*rows, keys=keys))]


POWER = 'at = 0, device = "meter", point = "power", every = "1 s"'


@pytest.mark.parametrize(
    "row",
    [
        POWER,
        POWER + ', type = "float32", swap = "words", scale = 0.001, offset = -5',
        'at = 0, device = "meter", point = "limit", every = "1 s", write = true',
        'at = 0, device = "meter", holding = "0-19", every = "1 s", write = true',
        'at = 0, device = "meter", holding = 3, every = "1 s"',
        'at = 0, device = "meter", holding = "0-3", every = "1 s", swap = "both"',
        'at = 0, device = "meter", point = "*", every = "1 s"',
        'at = 0, device = "shift", holding = "0-9", every = "1 s", write = true',
        'at = 0, device = "relay", coils = "0-1", area = "coils", every = "1 s"',
        'at = 0, device = "relay", point = "*", area = "discrete", every = "1 s"',
        'at = 0, device = "meter", point = "alarm", area = "coils", every = "1 s"',
        'at = 0, device = "relay", point = "on", every = "1 s"',
        'at = 0, device = "enron", point = "flow", every = "1 s"',
        'at = 65534, device = "any", holding = "0-1", every = "1 s"',
    ],
)
def test_rows_that_mean_something(row):
    assert said(row) == []


@pytest.mark.parametrize(
    ("row", "what"),
    [
        ("at = 0", "[0]: must have one of device, fresh and age | such as"),
        (POWER + ', age = "meter"', "[0]: has device and age, and one is needed | make several rows of it"),
        ('at = 0, device = "meter", every = "1 s"', "[0]: must have one of point, holding, input, coils and discrete"),
        (POWER + ", holding = 1", "[0]: must have one of point, holding, input, coils and discrete | such as"),
        ('at = 0, device = "meter", point = "power"', "[0]: every is missing | say how often it is read"),
        (POWER + ', type = "bit"', '[0].type: bit is not all of a register | write "uint16" or "int16"'),
        (POWER + ', type = "int16", scale = 0', "[0].scale: must not be 0: the value is divided by it"),
        (POWER + ", scale = 2", ("[0].scale: without type, registers are as the device has them | write type, too: "
         'power has type = "int32" and scale = 0.1')),
        (POWER + ', type = "string"', "[0].type: power is a number, and string is text"),
        (POWER.replace("power", "serial") + ', type = "int16"', "[0].type: serial is text, and int16 is a number"),
        ('at = 0, device = "meter", holding = "0-1", every = "1 s", type = "int32"',
         "[0].type: registers of a range are as they are; only points have values | take it out, or name a point"),
        ('at = 0, device = "meter", holding = "0-2", every = "1 s", swap = "words"',
         "[0].swap: it turns pairs of registers, and 3 are no pairs"),
        ('at = 0, device = "relay", coils = "0-1", area = "coils", every = "1 s", swap = "words"',
         "[0].swap: coils have no order of words and bytes | take it out"),
        ('at = 0, device = "meter", point = "alarm", area = "coils", type = "int16", every = "1 s"',
         "[0].type: coils are single bits | take it out"),
        ('at = 0, device = "meter", point = "power", area = "coils", every = "1 s"',
         '[0].point: power of meter is no single bit, as coils are | write area = "holding", or take area out'),
        ('at = 0, device = "relay", coils = "0-1", every = "1 s"',
         "[0].coils: these are bits, and holding of this unit are registers | map them in another area"),
        ('at = 0, device = "meter", holding = "0-1", area = "discrete", every = "1 s"',
         "[0].holding: these are registers, and discrete of this unit are bits | map them in another area"),
        ('at = 0, device = "metre", point = "power", every = "1 s"',
         '[0].device: there is no device "metre" | did you mean "meter"?'),
        ('at = 0, device = "41", point = "power", every = "1 s"',
         '[0].device: there is no device "41" | write the name of unit 41: "meter"'),
        ('at = 0, device = "copy", holding = "0-1", every = "1 s"',
         '[0].device: "copy" is a mirror, and rows read devices and images | name its device'),
        ('at = 0, device = "block", holding = "0-1", every = "1 s"',
         '[0].device: "block" is a virtual unit, and rows read devices and images | name its device'),
        ('at = 0, device = "meter", point = "powr", every = "1 s"',
         '[0].point: meter has no point "powr" | did you mean "power"?'),
        ('at = 0, device = "any", point = "power", every = "1 s"',
         ('[0].point: any has no point "power" | it has no points: name addresses, such as holding = "0-1", '
         "or give points to its profile")),
        ('at = 0, device = "meter", point = "order", every = "1 s"',
         "[0].point: order of meter is only written, and has no value"),
        ('at = 0, device = "any", point = "*", every = "1 s"', "[0].point: any has no points of registers"),
        ('at = 0, device = "meter", point = "*", area = "coils", every = "1 s"',
         "[0].point: meter has no points of coils or discrete inputs"),
        ('at = 0, device = "meter", coils = "0-1", area = "coils", every = "1 s"',
         "[0].coils: meter has no function 1, which reads coils"),
        ('at = 0, device = "meter", holding = "99-100", every = "1 s"',
         "[0].holding: meter does not have all of holding 99-100 | its holding: 0-99"),
        ('at = 0, device = "shift", input = 0, every = "1 s"',
         "[0].input: shift does not have all of input 0-0 | its input: none"),
        ('at = 0, device = "meter", holding = "0-20", every = "1 s"',
         "[0].holding: one request reads a row, and meter answers 20 of holding at once, not 21 | make several rows"),
        ('at = 0, device = "any", holding = "0-125", every = "1 s"',
         "[0].holding: one request reads a row, and any answers 125 of holding at once, not 126 | make several rows"),
        ('at = 0, device = "enron", holding = "5000-5001", every = "1 s"',
         "[0].holding: registers of enron with four bytes are mapped only as points | map each by its point"),
        ('at = 65535, device = "any", holding = "0-1", every = "1 s"',
         "[0].at: ends at 65536, and the last address is 65535"),
        ('at = "power", device = "meter", point = "power", every = "1 s"',
         "[0].at: profile generic has no points | write an address, such as at = 0"),
        ('at = "12", device = "meter", point = "power", every = "1 s"',
         "[0].at: an address has no quotes | write at = 12"),
        ('at = 70000, device = "meter", point = "power", every = "1 s"', "[0].at: addresses are 0 to 65535"),
        (POWER + ', when_stale = "held"', '[0].when_stale: must be "exception", "hold" or a number'),
        ('at = 0, fresh = ["relay"]', '[0].fresh[0]: no row of this map reads "relay"'),
        ('at = 0, age = "relay"', '[0].age: no row of this map reads "relay"'),
        ("at = 0, fresh = []", '[0].fresh: is empty | name devices of this map, such as ["meter-1"]'),
        ('at = 0, area = "coils", age = "meter"',
         "[0].age: coils are single bits, and an age is a register | map it in another area"),
        ('at = 0, age = "meter", every = "1 s"',
         "[0].every: only a row with device has it, and this has age | take it out"),
    ],
)  # fmt: skip
def test_rows_that_mean_nothing(row, what):
    others = [POWER.replace("at = 0", "at = 1")] if "device" not in row else []
    found = said(row, *others)
    assert [each.startswith(f"error: {what}") for each in found] == [True], found


@pytest.mark.parametrize(
    ("row", "what"),
    [
        ('at = 0, device = "meter", point = "power", every = "1 s"',
         "power of meter cannot be written | take it out, or add write = true to the point"),
        ('at = 0, area = "coils", device = "relay", point = "closed", every = "1 s"',
         "closed of relay cannot be written | take it out, or add write = true and write_at = ADDRESS to the point"),
        ('at = 0, device = "meter", point = "*", every = "1 s"',
         "power of meter cannot be written | take it out, and map the points that can be written by their names"),
        ('at = 0, device = "meter", point = "limit", area = "input", every = "1 s"',
         "input of this unit cannot be written | take it out, or map it in another area"),
        ('at = 0, device = "any", coils = 0, area = "discrete", every = "1 s"',
         "discrete of this unit cannot be written | take it out, or map it in another area"),
        ('at = 0, device = "meter", input = "0-1", every = "1 s"', "input of meter cannot be written | take it out"),
        ('at = 0, device = "any", discrete = 0, area = "coils", every = "1 s"',
         "discrete of any cannot be written | take it out"),
        ('at = 0, device = "meter", holding = "0-1", swap = "words", every = "1 s"',
         "a range whose registers are turned takes no writes | take it out, or map each value by its point"),
        ('at = 0, device = "relay", holding = "0-1", every = "1 s"',
         "relay has no function 6 or 16, which write holding | take it out"),
    ],
)  # fmt: skip
def test_writes_that_no_device_could_take(row, what):
    assert said(row) == []
    (found,) = said(row + ", write = true")
    assert found.startswith(f"error: [0].write: {what}")


def test_a_row_has_no_address_of_another_one_nor_of_the_registers_of_the_unit_itself():
    at_2 = POWER.replace("at = 0", "at = 2")
    assert said(POWER, at_2) == []
    assert said(at_2, POWER) == []
    (found,) = said(POWER, at_2, POWER.replace("at = 0", "at = 1"))
    assert found == (
        "error: [2].at: holding 1: the row at gateway.toml:58 has them already | 2 is the first address behind that row"
    )
    whole = 'at = 0, device = "any", holding = "0-9", every = "1 s"'
    assert [each.partition(":")[2].partition(":")[0] for each in said(POWER, at_2, whole)] == [" [2].at"]
    within = [f'at = {at}, age = "any"' for at in (1, 5)]
    assert [each.partition(": ")[2].partition(":")[0] for each in said(whole, *within)] == ["[1].at", "[2].at"]
    assert said(POWER, POWER + ', area = "input"') == []
    assert said(POWER, keys='holding = "2-9"') == []
    assert said(POWER, keys='holding = "1-9"') == [
        (
            "error: [0].at: holding 1: registers of the unit's own, which no row may have | "
            "choose another address, or take them out of holding"
        )
    ]


def test_every_point_needs_its_place():
    (found,) = said('at = 0, device = "meter", point = "*", every = "1 s"', 'at = 11, age = "meter"')
    assert found.startswith("error: [1].at: holding 11: the row at gateway.toml:58 has them already | 12 is")


def test_a_gap_that_one_read_could_include_is_a_warning():
    def gap(at):
        return said(POWER, f'at = {at}, age = "meter"')

    assert gap(2) == []
    assert gap(3) == [
        (
            "warning: [1].at: nothing is at holding 2: a read over it is answered 02 | "
            'close it, or let it have registers of the unit\'s own, which are 0: holding = "2-2"'
        )
    ]
    assert len(gap(125)) == 1
    assert gap(126) == []  # 2 and 123 between them and 1 are more than one request reads
    assert said(POWER, 'at = 10, age = "meter"', keys='holding = "2-9"') == []
    (found,) = said(POWER, 'at = 10, age = "meter"', keys='holding = "4-9"')
    assert found.endswith('own, which are 0: add "2-3" to holding')
    many = [f'at = {at}, age = "meter"' for at in (3, 5, 7, 9)]
    assert said(POWER, *many)[0].startswith("warning: [1].at: nothing is at holding 2, 4, 6 and 1 more gap: a read")
    assert said(POWER, *many[:2])[0].endswith('own, which are 0: holding = ["2-2", "4-4"]')


def test_a_poll_comes_more_often_than_values_are_stale():
    late = POWER.replace("1 s", "5 s")
    assert said(late) == [
        (
            "warning: [0].every: values become stale between two polls: stale is 5 s | "
            "make stale two or three times as long as every"
        )
    ]
    assert said(late, late.replace("at = 0", "at = 2"))[0].startswith(
        "warning: [0].every: values become stale between two polls (and so in 1 more row): stale is 5 s"
    )


def test_clients_can_tell_that_values_are_stale():
    bit = 'at = 2, fresh = ["meter"]'
    remedy = 'add a row with a bit for it: { at = ADDRESS, fresh = ["meter"] }'
    what = f"clients could not tell that values of meter are stale | {remedy}"
    assert said(POWER + ', when_stale = "hold"') == [f"error: [0].when_stale: {what}"]
    assert said(POWER + ', when_stale = "hold"', bit) == []
    assert said(POWER, keys="when_stale = 0x7FC0") == [f"error: image[2].when_stale: {what}"]
    assert said(POWER, bit, keys="when_stale = 0x7FC0") == []
    assert said(POWER + ', when_stale = "exception"', keys="when_stale = 0x7FC0") == []


def test_a_coil_is_0_or_1_when_it_is_stale():
    row = 'at = 0, area = "coils", device = "relay", coils = 0, every = "1 s"'
    bit = 'at = 1, area = "coils", fresh = ["relay"]'
    assert said(row + ", when_stale = 1", bit) == []
    assert said(row + ", when_stale = 2", bit) == ["error: [0].when_stale: coils can only be 0 or 1"]
    assert said(row, bit, keys="when_stale = 2") == [
        "error: image[2].when_stale: this map has coils, which can only be 0 or 1 | write when_stale in the rows"
    ]


def test_a_point_as_it_is_needs_its_scale():
    row = 'at = 0, device = "meter", point = "energy", every = "1 s"'
    assert said(row) == [
        (
            "warning: [0].point: energy has its scale in holding 44 there, and that is not mapped | "
            'write type, such as "float32": then the value is scaled'
        )
    ]
    assert said(row + ', type = "float32"') == []
    assert said(row, 'at = 2, device = "meter", holding = "44-45", every = "1 s"') == []


TARGET = 'profile = "target"'


@pytest.mark.parametrize(
    ("row", "what"),
    [
        ('at = "watts", device = "meter", point = "power", every = "1 s"', ""),
        ('at = "model", device = "meter", point = "serial", every = "1 s"', ""),
        ('at = "watts", device = "any", holding = "0-1", every = "1 s"', ""),
        ('at = "wats", device = "meter", point = "power", every = "1 s"',
         '.at: profile target has no point "wats" | did you mean "watts"?'),
        ('at = "watts", device = "meter", point = "power", every = "1 s", type = "int32"',
         '.type: the point "watts" of the profile says it | take it out, or write an address for at'),
        ('at = "watts", device = "meter", point = "power", every = "1 s", area = "holding"',
         '.area: the point "watts" of the profile says it'),
        ('at = "watts", device = "meter", point = "power", every = "1 s", write = true',
         ".write: power of meter cannot be written"),
        ('at = "watts", device = "meter", point = "limit", every = "1 s", write = true',
         ".write: input of this unit cannot be written"),
        ('at = "watts", device = "meter", point = "serial", every = "1 s"',
         ".point: serial is text, and float32 is a number"),
        ('at = "model", device = "meter", point = "power", every = "1 s"',
         ".point: power is a number, and string is text"),
        ('at = "watts", device = "meter", point = "*", every = "1 s"',
         ".at: must be an address where several points are mapped"),
        ('at = "watts", device = "any", holding = 0, every = "1 s"',
         ".holding: takes 1, and point watts has 2 | map as many as it has"),
        ('at = "watts", age = "any"', ".age: takes 1, and point watts has 2 | map as many as it has"),
        ('at = "watts", fresh = ["any"]', ".fresh: takes 1, and point watts has 2 | map as many as it has"),
        ('at = "flag", fresh = ["any"]', ".at: flag is a part of register 8, and a row takes whole registers"),
        ('at = "flag", device = "any", holding = 0, every = "1 s"',
         ".at: flag is a part of register 8, and a row takes whole registers"),
        ('at = "flag", device = "meter", point = "alarm", every = "1 s"',
         ".at: flag is a part of register 8, and a row takes whole registers"),
        ('at = 19, area = "input", device = "meter", point = "power", every = "1 s"',
         ".at: profile target has no input 19-20 | its input: 0-19"),
        ('at = "total", device = "meter", point = "power", every = "1 s"',
         (".at: total has its scale in input 12, which has no fixed value here | make it one of the unit's own: "
         'input = "12", initial.input = [{ at = 12, values = [0] }]')),
    ],
)  # fmt: skip
def test_a_row_may_name_a_point_of_the_profile(row, what):
    others = ['at = 0, device = "any", holding = 0, every = "1 s"'] if "device" not in row else []
    found = said(row, *others, keys=TARGET)
    assert [each.startswith(f"error: [0]{what}") for each in found] == [True] * bool(what), found


@pytest.mark.parametrize(
    ("scale", "exponent"), [(10, None), (65526, None), (11, 11), (0x7FFF, 32767), (0x8000, -32768), (65300, -236)]
)
def test_the_fixed_scale_of_a_point_is_a_power_of_ten_that_numbers_can_have(scale, exponent):
    own = f'input = "12"\ninitial.input = [{{ at = 12, values = [{scale}] }}]'
    found = said('at = "total", device = "meter", point = "power", every = "1 s"', keys=f"{TARGET}\n{own}")
    what = f"total has its scale in input 12, and {exponent} is too large a power of ten"
    assert found == ([] if exponent is None else [f"error: [0].at: {what} | let initial.input have -10 to 10 there"])


def test_the_functions_of_the_profile_hold():
    row = 'at = 0, device = "any", coils = 0, area = "coils", every = "1 s"'
    (found,) = said(row, keys=TARGET)
    assert found == "error: [0].at: profile target has no function 1, which reads coils | choose another area"
    row = 'at = 0, device = "any", holding = 0, every = "1 s", write = true'
    assert said(row, keys=TARGET) == []
    (found,) = said(row, keys='profile = "relay"')
    assert found == "error: [0].write: profile relay has no function 6 or 16, which write holding | take it out"


@pytest.mark.parametrize(("writes", "most"), [("functions = [3, 6]", 1), ("limits = { 16 = 3 }", 3)])
def test_one_write_can_set_all_of_a_value(writes, most):
    row = 'at = 0, device = "any", point = "level", type = "float64", every = "1 s", write = true'
    level = '{ unit = 4, as = 44, name = "any", points = [{ name = "level", holding = 0, write = true }] }'
    text = unit(row, keys='profile = "few"').replace('{ unit = 4, as = 44, name = "any" }', level)
    (found,) = problems(f"{text}[profile.few]\n{writes}\n")
    what = f"4 of holding are one value, and one write to profile few sets {most}"
    assert found == f"error: image[2].map[0].write: {what} | take it out, or choose a shorter type"


def test_the_scale_of_a_point_of_the_profile_is_a_register_of_the_unit_itself():
    keys = f'{TARGET}\ninput = "12"\ninitial.input = [{{ at = 12, values = [0xFFFF] }}]'
    assert said('at = "total", device = "meter", point = "power", every = "1 s"', keys=keys) == []


def test_an_image_is_one_of_three_kinds():
    assert said(keys="") == [
        'error: image[2].map: is empty | write map = [{ at = 0, device = "meter-1", point = "power", every = "1 s" }]'
    ]
    (read,) = said(POWER, keys='read = [{ holding = "0-1", every = "1 s" }]')
    assert read.startswith("error: image[2].read: only a mirror has this key")
    of = said(POWER, keys='of = "meter"\nread = [{ holding = "0-1", every = "1 s" }]')
    assert of == ["error: image[2].map: a mirror has no map | take the key out, or of"]
    (wide,) = said(POWER, keys='profile = "wide"')
    assert wide == "error: image[2].profile: an image has no registers of four bytes | choose another profile"


def test_its_number_and_name_are_its_own():
    text = unit(POWER)
    assert problems(text.replace("unit = 240", "unit = 41"))[0].startswith("error: image[2].unit: 41 is already a unit")
    assert problems(text.replace('"block"', '"shift"'))[0].startswith('error: image[2].name: "shift" is already used')
    serves = '[[line]]\nname = "panel"\nport = "/dev/b"\nrole = "server"\nserves = [240]\n'
    assert problems(text + serves) == []
    assert problems(text + '[[access]]\nunits = 240\nallow = ["read"]\n') == []
    assert problems(text + '[[listen]]\nname = "all"\nbind = "tcp://127.0.0.1:5020"\nunit0 = 240\n') == []


def test_a_device_that_only_a_map_reads_is_asked():
    alone = '[[listen]]\nname = "m"\nbind = "tcp://127.0.0.1:5020"\nline = "x"\n'
    line = '[[line]]\nname = "x"\nport = "/dev/x"\n'
    serves = '[[line]]\nname = "panel"\nport = "/dev/b"\nrole = "server"\nserves = [240]\n'
    found = problems(unit(POWER) + alone + line + serves)
    assert [each for each in found if "no listener leads to" in each and "41" in each] == []


def test_a_device_of_a_line_that_passes_all_units_through():
    text = '[[line]]\nname = "a"\nport = "/dev/a"\n[[image]]\nunit = 240\nmap = [{ at = 0, device = "a/7", '
    assert problems(text + 'holding = "0-1", every = "1 s" }]\n') == []
    found = problems(text.replace("a/7", "a/240") + 'holding = "0-1", every = "1 s" }]\n')
    assert found == ['error: image[0].map[0].device: there is no device "a/240" | unit 240 is of image "image-240"']


def test_reference_numbers_of_manuals():
    at, there = said('at = 40001, device = "any", holding = "40101-40102", every = "1 s"')
    assert at == (
        "warning: [0].at: addresses are those on the wire, from 0 | "
        "if 40001 is a number that counts from 40001, write at = 0"
    )
    assert there.startswith("warning: [0].holding: addresses are those on the wire, from 0")


def test_ten_thousand_rows_take_no_minute():
    rows = [
        f'at = {2 * index}, device = "any", holding = "{2 * (index % 500)}-{2 * (index % 500) + 1}", every = "1 s"'
        for index in range(10_000)
    ]
    began = time.process_time()
    loaded = parse(unit(*rows), "gateway.toml", port_trouble=lambda _: None, real_path=str)
    assert [one for one in loaded.problems if one.severity == "error"] == []
    assert time.process_time() - began < 20  # 3 s here; quadratic, it would be minutes


def test_a_point_of_the_profile_is_in_the_same_unit_of_measure():
    row = 'at = "demand", device = "meter", point = "power", every = "1 s"'
    assert said(row, keys=TARGET) == [
        (
            "warning: [0].point: power of meter is in kW, and demand here in W | "
            "numbers are copied as they are: give meter a point with another scale, in W"
        )
    ]
    assert said(row.replace("power", "state"), keys=TARGET) == []
    assert said(row.replace("demand", "watts"), keys=TARGET) == []
    assert said(row.replace('"demand"', '14, area = "input", type = "float32"'), keys=TARGET) == []
