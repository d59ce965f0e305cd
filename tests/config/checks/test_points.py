"""What is said about points that cannot be."""

import pytest

from gateway.config.load import parse
from gateway.config.reading.profile_file import shipped_profile
from gateway.config.resolve import resolve
from gateway.modbus.codes import Area
from gateway.profiles.point import Point


def problems(*rows, profile="", of_profile=""):
    text = f'[profile.mine]\n{profile}\npoints = [{of_profile}]\n[[line]]\nport = "/dev/x"\n'
    text += (
        f'devices = [{{ unit = 6, profile = "mine", points = [\n{", ".join(f"{{ {row} }}" for row in rows)}\n] }}]\n'
    )
    return [str(one).removeprefix("gateway.toml:") for one in parse(text, port_trouble=lambda _: None).problems]


WHERE = "line[0].devices[0].points[0]"


@pytest.mark.parametrize(
    ("row", "problem"),
    [
        ('name = "a"', "7:1: error: {}: must have one of holding, input, coils and discrete"),
        ('name = "a", holding = 1, coils = 1', "7:1: error: {}: must have one of holding, input, coils and discrete"),
        ('name = "2a", holding = 1', '7:10: error: {}.name: "2a" is no name of a point'),
        ('name = "a/b", holding = 1', '7:10: error: {}.name: "a/b" is no name of a point'),
        ("name = 7, holding = 1", "7:10: error: {}.name: must be text"),
        ('name = "input", holding = 1', '7:10: error: {}.name: "input" is the name of an area'),
        ('name = "a", holding = true', "7:25: error: {}.holding: is no address"),
        ('name = "a", holding = -1', "{}.holding: is no address\n  help: write an address such as 16"),
        ('name = "a", holding = "x"', "{}.holding: is no address\n  help: write an address such as 16"),
        ('name = "a", holding = 1, invalid = 1' + "0" * 400, "{}.invalid: must be a number or a list of numbers"),
        ('name = "a", holding = ["1-2"]', "7:25: error: {}.holding: is no address"),
        ('name = "a", holding = 65536', "7:25: error: {}.holding: address 65536 is above 65535"),
        ('name = "a", holding = 65535, type = "float32"', "{}.holding: the point ends at 65536, and the last address"),
        ('name = "a", coils = 1, type = "int16"', "{}.type: coils are bits\n  help: leave type out"),
        ('name = "a", coils = 1, bit = 3', "{}.bit: coils are bits\n  help: leave bit out"),
        ('name = "a", holding = 1, type = "bit"', "{}.type: holding registers are no bits\n  help: read the whole"),
        ('name = "a", holding = 1, type = "string"', "{}.type: a string needs its length\n  help: add length = 8"),
        ('name = "a", holding = 1, length = 2', "{}.length: only a string has a length; uint16 has its own"),
        ('name = "a", holding = 1, swap = "words"', "{}.swap: there is nothing to swap: the point is one word"),
        ('name = "a", coils = 1, swap = "bytes"', "{}.swap: there is nothing to swap: the point is one bit"),
        ('name = "a", holding = "1-3"', '{}.name: several points need several names\n  help: write "a-*"'),
        ('name = "a-*", holding = 1', "{}.name: * stands for a number, and this is one point"),
        ('name = "a", holding = 1, first = 1', "{}.first: only a range of points has it"),
        ('name = "a-*", holding = "1-5", type = "int32"', "5 registers are no whole number of values of 2\n"),
        ('name = "a", input = 1, write = true', "{}.write: input registers cannot be written"),
        ('name = "a", discrete = 1, write = "only"', "{}.write: discrete inputs cannot be written"),
        ('name = "a", holding = 1, write = "yes"', '{}.write: must be true, false or "only"'),
        ('name = "a", holding = 1, scale = 0', "{}.scale: must not be 0"),
        ('name = "a", coils = 1, decimals = 2', "{}.decimals: a bit is no number to be scaled, rounded or limited"),
        ('name = "a", holding = 1, scale = 0.1, min = 6554', "{}.min: is more than the highest value that the point"),
        ('name = "a", holding = 1, bits = "0-2", write = true, min = 8', "{}.min: is more than the highest value"),
        ('name = "a", holding = 1, offset = -40, max = -41', "{}.max: is less than the lowest value that the point"),
        ('name = "a", holding = 1, type = "float32", invalid = 1e39', "{}.invalid: 1e+39 does not fit into float32"),
        ('name = "a", holding = 1, type = "string", length = 2, scale = 2.0', "{}.scale: a string is no number"),
        ('name = "a", holding = 1, type = "float32", labels = { 0 = "off" }', "{}.labels: labels are for whole"),
        ('name = "a", holding = 1, labels = { 70000 = "off" }', "{}.labels: 70000 does not fit into uint16"),
        ('name = "a", coils = 1, labels = { 2 = "half" }', "{}.labels: 2 does not fit into bit: 0 to 1"),
        ('name = "a", holding = 1, labels = { x = "off" }', '{}.labels: "x" is no whole number'),
        ('name = "a", holding = 1, labels = { 0 = 1 }', "{}.labels: the label of 0 must be text"),
        ('name = "a", holding = 1, labels = { 0 = "off", 00 = "on" }', "{}.labels: 0 is there twice"),
        ('name = "a", holding = 1, labels = { 0 = "off", 1 = "off" }', '{}.labels: "off" is there twice'),
        ('name = "a", holding = 1, labels = "off"', "{}.labels: must be a table"),
        ('name = "a", holding = 1, labels = { 0x10 = "x", 16 = "y" }', "{}.labels: 16 is there twice"),
        (
            'name = "a", holding = 1, type = "int16", labels = { 0xFFFF = "x", -1 = "y" }',
            "{}.labels: two of the numbers are the same in a register",
        ),
        ('name = "a", holding = 1, bit = 3, bits = "3-4"', "{}.bits: a point has one of bit, bits, byte, and this one"),
        ('name = "a", holding = 1, bit = 16', "{}.bit: a uint16 has the bits 0 to 15"),
        ('name = "a", holding = 1, bits = "8-32", type = "uint32"', "{}.bits: a uint32 has the bits 0 to 31"),
        ('name = "a", holding = 1, bits = "x"', "{}.bits: is no range of bits"),
        ('name = "a", holding = 1, bit = 3, type = "int16"', "{}.bit: a int16 has no bits to name"),
        ('name = "a", holding = 1, byte = "high", type = "uint16"', "{}.type: a byte is uint8 or int8, or one of each"),
        (
            'name = "a", holding = 1, byte = "high", swap = "bytes"',
            "{}.swap: there is nothing to swap: the point is one",
        ),
        ('name = "a", coils = 1, bit = 0', "{}.bit: coils are bits\n  help: leave bit out"),
        (
            'name = "a", holding = 1, bit = 3, scale = 0.1',
            "{}.scale: a bit is no number to be scaled, rounded or limited",
        ),
        (
            'name = "a", holding = 1, bits = "2-3", labels = { 4 = "x" }',
            "{}.labels: 4 does not fit into bits 2-3: 0 to 3",
        ),
        ('name = "a", holding = 1, invalid = 70000', "{}.invalid: 70000 does not fit into uint16: 0 to 65535"),
        ('name = "a", holding = 1, invalid = [0.5]', "{}.invalid: 0.5 does not fit into uint16"),
        ('name = "a", holding = 1, invalid = []', "{}.invalid: must be a number or a list of numbers"),
        (
            'name = "a", holding = 1, type = "float32", invalid = nan',
            "{}.invalid: must be a number or a list of numbers",
        ),
        ('name = "a", coils = 1, invalid = 1', "{}.invalid: a bit always has a value"),
        ('name = "a", holding = 1, min = 5, max = 4', "{}.min: is more than max, which is 4"),
        ('name = "a", coils = 1, max = 4', "{}.max: a bit is no number to be scaled, rounded or limited"),
        ('name = "a", holding = 1, write_at = 5', "{}.write_at: the point is not written\n  help: add write = true"),
        ('name = "a", holding = 1, write_function = "single"', "{}.write_function: the point is not written"),
        (
            'name = "a", input = 1, write = true, write_at = 65535, type = "int32"',
            "{}.write_at: the point would end at 65536",
        ),
        (
            'name = "a", holding = 1, type = "int32", write = true, write_function = "single"',
            "{}.write_function: function 6",
        ),
        (
            'name = "a", input = 1, bit = 3, write = true, write_at = 5',
            "{}.bit: bits can be written only in the holding",
        ),
        (
            'name = "a", holding = 1, type = "uint32", bits = "8-20", write = true',
            "{}.bits: can be written only in one",
        ),
        ('name = "a", holding = 1, bit = 3, write = "only"', "{}.write: bits are written by reading the others"),
        ('name = "a", holding = 1, scale_from = "b"', '{}.scale_from: there is no point "b"'),
        ('name = "a", holding = 1, unlt = "kg"', '{}.unlt: unknown key\n  help: did you mean "unit"?'),
    ],
)
def test_a_point_that_cannot_be_is_an_error_at_its_key(row, problem):
    (found,) = problems(row)
    assert problem.format(WHERE) in found


@pytest.mark.parametrize(
    "row",
    [
        'name = "a", holding = 1, bits = "4-4", write = true',
        'name = "a", holding = 1, type = "int16", invalid = [0x7FFF, 0x8000, -3], labels = { 0x8001 = "x" }',
        'name = "a", holding = 1, type = "float32", invalid = [-9999.0, 5]',
        'name = "a", holding = 0x0200, type = "uint64", bit = 63',
        'name = "a-*", holding = "0x10-0x13", first = 1, byte = "high", type = "int8", write = true',
        'name = "a", input = 1, write = true, write_at = 0x1001, type = "int32", write_function = "multiple"',
        'name = "a", discrete = 1, write = true, write_at = 9',
        'name = "a", holding = 1, offset = -40, min = -40, max = -40, write = true',
        'name = "a", holding = 1, type = "string", length = 8, byte = "low"',
        'name = "a", holding = 1, type = "bcd32", labels = { 99999999 = "never" }',
    ],
)
def test_a_point_that_says_more_is_fine(row):
    assert problems(row) == []


SCALE = '{ name = "sf", holding = 9, type = "int16" }'


@pytest.mark.parametrize(
    ("row", "of_profile", "said"),
    [
        ("holding = 1", SCALE, None),
        ("holding = 20, write = true", SCALE, None),
        ("input = 1", SCALE, "sf is no input register of type int16 with the plain number"),
        ("holding = 1", '{ name = "sf", holding = 9 }', "sf is no holding register of type int16"),
        ("holding = 133", SCALE, None),
        ("holding = 134", SCALE, "is 126 registers away"),
        ("holding = 200", SCALE, "is 192 registers away, and one request reads 125"),
        ('holding = 1, type = "float32"', SCALE, "a float32 has no scale register"),
        ("holding = 1, write = true, max = 5", SCALE, "limits cannot be guarded"),
        ("holding = 1", '{ name = "sf", holding = 9, type = "int16", swap = "bytes" }', "sf is no holding register"),
        ("holding = 1", '{ name = "sf", holding = 9, type = "int16", write = "only" }', "sf is only written"),
        ('holding = 1, write = "only"', SCALE, "is read together with its point, which is only written"),
        ("holding = 299", '{ name = "x", holding = 1 }, { name = "sf", holding = 300, type = "int16" }', None),
    ],
)
def test_a_scale_register_is_read_with_its_point(row, of_profile, said):
    found = problems(f'name = "a", {row}, scale_from = "sf"', of_profile=of_profile)
    assert [f"{WHERE}.scale_from: {said}" in one for one in found] == [True] * (said is not None)


@pytest.mark.parametrize(("scale", "said"), [("sf-299", None), ("sf-290", None), ("sf-10", "is 291 registers away")])
def test_a_scale_register_may_be_one_of_several(scale, said):
    found = problems(
        f'name = "a", holding = 300, scale_from = "{scale}"',
        of_profile='{ name = "sf-*", holding = "10-299", type = "int16" }',
    )
    assert [f"{WHERE}.scale_from: {said}" in one for one in found] == [True] * (said is not None)


def test_a_scale_register_that_is_in_two_areas_is_an_error():
    found = problems(
        'name = "a", holding = 1, scale_from = "sf"', 'name = "sf", holding = 2, input = 2, type = "int16"'
    )
    assert any("points[1]: must have one of holding, input" in one for one in found)


@pytest.mark.parametrize("at", [2, 21])
def test_a_point_and_its_scale_have_no_wide_registers_between_them(at):
    found = problems(
        f'name = "a", holding = {at}, type = "uint32", scale_from = "sf"',
        profile='wide = { holding = "10-22" }',
        of_profile='{ name = "sf", holding = 24, type = "int16" }',
    )
    assert ["scale_from: is read together with its point, and only some of" in one for one in found] == [True]


@pytest.mark.parametrize(("at", "write_at"), [(5, 30), (30, 5), (30, 9)])
def test_a_point_is_written_in_registers_as_wide_as_its_own(at, write_at):
    found = problems(
        f'name = "a", holding = {at}, type = "float32", write = true, write_at = {write_at}',
        profile='wide = { holding = "0-9" }',
    )
    assert ["write_at: its registers have" in one for one in found] == [True]


@pytest.mark.parametrize(("addresses", "is_far"), [("10-133", False), ("10-134", True)])
def test_each_point_of_a_range_is_read_with_the_scale_by_itself(addresses, is_far):
    found = problems(f'name = "a-*", holding = "{addresses}", scale_from = "sf"', of_profile=SCALE)
    assert ["is 126 registers away, and one request reads 125" in one for one in found] == [True] * is_far


def test_the_registers_up_to_the_scale_exist():
    (found,) = problems(
        'name = "a", holding = 1, scale_from = "sf"', profile='holding = ["0-3", "9"]', of_profile=SCALE
    )
    assert "is read together with its point, and the profile has no holding 1-9" in found


@pytest.mark.parametrize(
    ("row", "said"),
    [
        ('type = "float32", write = true', None),
        ('type = "float64"', None),
        ('type = "uint32", bit = 31', None),
        ("write_at = 5, write = true", "type: the register has four bytes, and a uint16 has fewer"),
        ('type = "uint32", bit = 3, write = true', "bit: can be written only in one register of two bytes"),
        ('type = "float32", write = true, write_function = "single"', "write_function: function 6 writes one register"),
    ],
)
def test_a_wide_register_holds_four_bytes(row, said):
    found = problems(f'name = "a", holding = 5000, {row}', profile='wide = { holding = "5000-5999" }')
    assert [f"{WHERE}.{said}" in one for one in found] == [True] * (said is not None)


def test_the_last_wide_register_is_one():
    assert problems('name = "a", holding = 5999, type = "float32"', profile='wide = { holding = "5000-5999" }') == []


@pytest.mark.parametrize(
    "row",
    [
        'name = "a", holding = 5005, type = "uint64"',
        'name = "a", holding = 4990, type = "string", length = 40',
        'name = "a-*", holding = "4990-5009"',
    ],
)
def test_a_point_is_not_partly_wide(row):
    (found,) = problems(row, profile='wide = { holding = "5000-5005" }')
    assert "only some of its registers are wide, which have four bytes" in found


@pytest.mark.parametrize("functions", ["[3, 22]", "[3, 6]", "[3, 16]"])
def test_bits_are_written_with_function_22_or_by_a_read_and_a_write(functions):
    row = 'name = "a", holding = 1, bit = 3, write = true'
    assert problems(row, profile=f"functions = {functions}") == []
    (found,) = problems(row, profile="functions = [3]")
    assert "cannot be written: function 6 or 16 is not among the functions of the profile" in found


def test_a_point_outside_its_profile_is_an_error():
    (found,) = problems('name = "a", holding = 9, type = "int32"', profile='holding = "1-9"')
    assert found == f"7:25: error: {WHERE}.holding: the profile has no holding 9-10, but 1-9"


@pytest.mark.parametrize(
    ("profile", "row", "said"),
    [
        ("functions = [4, 6]", "holding = 1", "cannot be read: function 3 is not among the functions of the profile"),
        ("functions = [3]", "input = 1", "cannot be read: function 4 is not among the functions of the profile"),
        ("functions = [3, 16]", "coils = 1", "cannot be read: function 1 is not among"),
        ("functions = [3]", "holding = 1, write = true", "cannot be written: function 6 or 16 is not among"),
        ("functions = [3]", 'holding = 1, write = "only"', "cannot be written: function 6 or 16 is not among"),
        (
            "functions = [3, 6]",
            'holding = 1, type = "int32", write = true',
            "cannot be written: function 16 is not among",
        ),
        ("functions = [1]", "coils = 1, write = true", "cannot be written: function 5 or 15 is not among"),
        (
            "limits = { 3 = 1 }",
            'holding = 1, type = "int32"',
            "cannot be read at once: it takes 2, and the profile allows 1",
        ),
        (
            "limits = { 16 = 1 }",
            'holding = 1, type = "int32", write = true',
            "cannot be written at once: it takes 2, and the profile allows 1 (function 16)",
        ),
    ],
)
def test_a_point_that_its_profile_makes_impossible_is_an_error_at_the_point(profile, row, said):
    area = row.split()[0]
    (found,) = problems(f'name = "a", {row}', profile=profile)
    assert found.startswith("7:")
    assert f"error: {WHERE}.{area}: {said}" in found
    (found,) = problems(profile=profile, of_profile=f'{{ name = "a", {row} }}')
    assert found.startswith("3:")
    assert f"error: profile.mine.points[0].{area}: {said}" in found


@pytest.mark.parametrize(
    ("profile", "row"),
    [
        ("functions = [16]", 'holding = 1, write = "only"'),
        ("functions = [3, 16]", "holding = 1, write = true"),
        ("functions = [3, 6]\nlimits = { 16 = 1 }", "holding = 1, write = true"),
        ("functions = [1, 15]", "coils = 1, write = true"),
        ("limits = { 3 = 2, 16 = 2 }", 'holding = 1, type = "float32", write = true'),
        ("functions = [2, 4]", "input = 1"),
    ],
)
def test_a_point_for_which_the_profile_has_the_functions_is_fine(profile, row):
    assert problems(f'name = "a", {row}', profile=profile) == []


def test_of_a_device_at_address_0_only_holding_registers_can_be_points():
    text = '[[line]]\nport = "/dev/x"\ndevices = [{ unit = 0, as = 5, points = [{ name = "a", input = 1 }] }]\n'
    found = [one for one in parse(text, port_trouble=lambda _: None).problems if one.severity == "error"]
    assert [one.what for one in found] == ["cannot be read: function 4 is not among the functions of the profile"]


def test_a_name_is_there_once_with_those_of_the_profile():
    rows = ('name = "a", holding = 1', 'name = "b-*", holding = "2-3"', 'name = "b-3", holding = 9')
    assert problems(*rows, of_profile='{ name = "a", holding = 5 }') == [
        f'7:10: error: {WHERE}.name: the point "a" is already there: gateway.toml:3',
        '7:74: error: line[0].devices[0].points[2].name: the point "b-3" is already there: gateway.toml:7',
    ]


def points(text):
    loaded = parse(text, port_trouble=lambda _: None)
    assert loaded.config is not None, loaded.errors
    return resolve(loaded.config).points


LINE = '[[line]]\nname = "hall"\nport = "/dev/x"\n'


def test_a_device_has_the_points_of_its_profile_and_its_own():
    found = points(
        f'{LINE}devices = [{{ unit = 1, as = 41, profile = "weigher", points = [{{ name = "t", holding = 5 }}] }}]'
    )
    assert [point.name for point in found[41]] == ["weight", "baud", "address", "zero", "set-baud", "set-address", "t"]
    assert found[41][0] == Point("weight", Area.HOLDING, 0, "float32", count=2, decimals=2)


def test_a_range_makes_several_points_numbered_by_address_or_from_first():
    rows = '{ name = "a-*", holding = "10-13", type = "int32" }, { name = "c-*.x", coils = "3-4", first = 1 }'
    found = points(f"{LINE}devices = [{{ unit = 1, points = [{rows}] }}]")[1]
    assert [(point.name, point.address, point.count) for point in found] == [
        ("a-10", 10, 2),
        ("a-12", 12, 2),
        ("c-1.x", 3, 1),
        ("c-2.x", 4, 1),
    ]


@pytest.mark.parametrize("number", ["3.4028234663852886e38", "3.40282347e38", "3.4028235e38"])
def test_the_largest_float32_is_no_value_with_any_of_its_digits(number):
    row = f'name = "a", holding = 4, type = "float32", invalid = [-1, {number}]'
    (point,) = points(f"{LINE}devices = [{{ unit = 1, points = [{{ {row} }}] }}]")[1]
    assert point.value(bytes.fromhex("7F 7F FF FF")) is None
    assert point.value(bytes.fromhex("7F 7F FF FE")) == 3.4028233e38


def test_first_and_last_register_of_one_value_are_one_point():
    (point,) = points(
        f'{LINE}devices = [{{ unit = 1, points = [{{ name = "a", holding = "4-5", type = "float32" }}] }}]'
    )[1]
    assert (point.name, point.address, point.count) == ("a", 4, 2)


def test_units_that_pass_through_have_the_points_of_their_lines_profile():
    found = points(f'{LINE}profile = "weigher"\n[[image]]\nunit = 200\nholding = 5\n')
    assert set(found) == set(range(1, 248)) - {200}


def test_an_image_has_the_points_that_it_has_registers_for():
    found = points('[[image]]\nunit = 200\nprofile = "mint"\nholding = "1-2"\ncoils = 1\n')
    assert [point.name for point in found[200]] == ["comms-1", "comms-2", "output-0"]


def test_a_mirror_has_the_points_that_it_polls_and_those_that_are_written_only():
    found = points(
        f'{LINE}devices = [{{ unit = 1, name = "silo", profile = "weigher" }}]\n'
        '[[image]]\nunit = 241\nof = "silo"\nread = [{ holding = "0-1", every = "1 s" }]\n'
    )
    assert [point.name for point in found[241]] == ["weight", "zero", "set-baud", "set-address"]


@pytest.mark.parametrize("name", ["mint", "v80", "weigher"])
def test_the_built_in_profiles_have_points(name):
    assert shipped_profile(name).table.points
