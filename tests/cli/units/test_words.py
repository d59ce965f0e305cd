"""What the words behind `read UNIT` and `write UNIT` mean, and what is said of words that mean nothing."""

import pytest

from gateway.cli.kit.usage import WrongUsageError
from gateway.cli.units.words import Command, find_assignments, find_points
from gateway.modbus.codes import Area
from gateway.profiles.point import Point

WEIGHT = Point("weight", Area.HOLDING, 0, "float32", count=2)
SPEED = Point("speed", Area.HOLDING, 8, write="yes")
ZERO = Point("zero", Area.HOLDING, 0x1A00, labels={187: "take"}, write="only")
POINTS = (WEIGHT, SPEED, ZERO)


def read(*words, points=POINTS, swap="none", wide=()):
    return find_points(Command("read", "silo", points, swap, dict(wide)), words)


def write(*words, points=POINTS, swap="none", wide=()):
    return find_assignments(Command("write", "silo", points, swap, dict(wide)), words)


def places(points):
    return [(point.area, point.address, point.type, point.count) for point in points]


def test_without_words_all_points_are_read_that_can_be():
    assert read() == [WEIGHT, SPEED]


def test_points_are_read_in_the_order_of_the_words():
    assert read("speed", "weight") == [SPEED, WEIGHT]


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["holding", "107"], [("holding", 107, "uint16", 1)]),
        (["holding", "0x6B-0x6C"], [("holding", 107, "uint16", 1), ("holding", 108, "uint16", 1)]),
        (["coils", "3-4"], [("coils", 3, "bit", 1), ("coils", 4, "bit", 1)]),
        (["discrete", "0", "bit"], [("discrete", 0, "bit", 1)]),
        (["input", "5", "float32"], [("input", 5, "float32", 2)]),
        (["input", "5-8", "int32"], [("input", 5, "int32", 2), ("input", 7, "int32", 2)]),
        (["holding", "5-8", "string"], [("holding", 5, "string", 4)]),
        (["holding", "65532", "uint64"], [("holding", 65532, "uint64", 4)]),
    ],
)
def test_an_area_with_addresses_and_type_means_values(words, expected):
    assert places(read(*words)) == expected


def test_the_swap_is_that_of_the_command():
    assert read("holding", "0", "int32", swap="words")[0].swap == "words"


@pytest.mark.parametrize(
    ("words", "what", "remedy"),
    [
        (["wieght"], 'silo has no point "wieght"', 'did you mean "weight"?'),
        (["holdin", "3"], 'silo has no point "holdin"', 'did you mean "holding"?'),
        (["zero"], "zero can be written, but not read", "modbus-gateway read silo reads all readable points"),
        (["40108"], "40108 is a reference number: holding 107", "modbus-gateway read silo holding 107"),
        (["30001", "float32"], "30001 is a reference number: input 0", "modbus-gateway read silo input 0 float32"),
        (["5-7"], "5-7 of what?", "modbus-gateway read silo holding 5-7"),
        (["holding"], "holding of which address? It is missing", "modbus-gateway read silo holding 0"),
        (["holding", "x"], '"x" is not an address', "modbus-gateway read silo holding 0"),
        (["holding", "9-5"], "9-5 counts backwards", "modbus-gateway read silo holding 5-9"),
        (["holding", "70000"], "70000 is not an address", "addresses are 0 to 65535"),
        (["holding", "400108"], "400108 is a reference number, not an address", "modbus-gateway read silo holding 107"),
        (["holding", "0", "float"], '"float" is not a type', 'did you mean "float32" or "float64"?'),
        (["holding", "0", "bit"], "holding registers are not bits", "modbus-gateway read silo holding 0"),
        (["coils", "0", "int16"], "coils are bits, not int16", "modbus-gateway read silo coils 0"),
        (["holding", "0", "int16", "x"], '"x" is one word too many', "modbus-gateway read silo holding 0 int16"),
        (["holding", "10-12", "float32"], "10-12 are 3 registers, but each float32 takes 2", "10-13 float32"),
        (["holding", "65535", "float32"], "the last address is 65535, but the value ends at 65536", ""),
    ],
)
def test_words_that_mean_nothing_are_answered_with_what_to_type(words, what, remedy):
    with pytest.raises(WrongUsageError) as wrong:
        read(*words)
    assert str(wrong.value).startswith(what)
    assert wrong.value.remedy.endswith(remedy)


def test_a_unit_without_points_needs_an_area():
    with pytest.raises(WrongUsageError) as wrong:
        read(points=())
    assert wrong.value.remedy == "modbus-gateway read silo holding 0-9"


def test_bits_have_nothing_to_swap():
    with pytest.raises(WrongUsageError, match="bits have no order to swap"):
        read("coils", "0", swap="words")


def test_a_point_gets_its_value():
    assert write("speed", "-3") == [(SPEED, "-3")]
    assert write("zero", "take") == [(ZERO, "take")]


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["holding", "5", "7"], [(5, "uint16", "7")]),
        (["holding", "5", "7", "8"], [(5, "uint16", "7"), (6, "uint16", "8")]),
        (["holding", "5-6", "7", "8"], [(5, "uint16", "7"), (6, "uint16", "8")]),
        (["holding", "5", "1.5", "2", "float32"], [(5, "float32", "1.5"), (7, "float32", "2")]),
        (["holding", "5", "abc", "string"], [(5, "string", "abc")]),
        (["coils", "0x10", "on"], [(16, "bit", "on")]),
        (["holding", "5", "string"], [(5, "uint16", "string")]),
    ],
)
def test_values_go_to_an_address_and_those_behind_it(words, expected):
    assert [(point.address, point.type, text) for point, text in write(*words)] == expected


def test_text_takes_as_many_registers_as_it_needs():
    assert places(point for point, _ in write("holding", "5", "abc", "string")) == [("holding", 5, "string", 2)]


@pytest.mark.parametrize(
    ("words", "what", "remedy"),
    [
        ([], "say what to write", "modbus-gateway write silo speed 1"),
        (
            ["weight", "5"],
            "weight is read-only",
            "write its address, without scale: modbus-gateway write silo holding 0 VALUE float32",
        ),
        (["speed"], "speed takes one value", "modbus-gateway write silo speed 1"),
        (["zero"], "zero takes one value", "modbus-gateway write silo zero take"),
        (["speed", "1", "2"], "speed takes one value, not 2", "modbus-gateway write silo speed 1"),
        (
            ["input", "0", "1"],
            "input cannot be written; coils and holding can",
            "modbus-gateway write silo holding 0 1",
        ),
        (["holding", "7"], "address and value are missing", "modbus-gateway write silo holding 7 1"),
        (["holding"], "address and value are missing", "modbus-gateway write silo holding 0 1"),
        (["40108", "5"], "40108 is a reference number: holding 107", "modbus-gateway write silo holding 107 5"),
        (
            ["holding", "1-3", "5"],
            "1-3 are 3 registers, but the values need 1",
            "modbus-gateway write silo holding 1 5",
        ),
        (["coils", "1", "1", "int16"], "coils are bits, not int16", "modbus-gateway write silo coils 1 1"),
        (["holding", "65535", "1", "2"], "the last address is 65535, but the values end at 65536", ""),
    ],
)
def test_what_cannot_be_written_is_answered_with_what_to_type(words, what, remedy):
    with pytest.raises(WrongUsageError) as wrong:
        write(*words)
    assert str(wrong.value).startswith(what)
    assert wrong.value.remedy.endswith(remedy)


@pytest.mark.parametrize("point", [WEIGHT, Point("fresh", Area.HOLDING, 20, bits=(1, 1))])
def test_what_a_virtual_unit_takes_writes_of_its_map_shows(point):
    with pytest.raises(WrongUsageError, match=f"{point.name} is read-only") as wrong:
        find_assignments(Command("write", "hall", (point,), is_virtual=True), [point.name, "5"])
    assert wrong.value.remedy.endswith("modbus-gateway map hall shows what can")


WIDE = {"holding": ((5000, 5999),)}


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["holding", "5000-5001"], [(5000, "uint32", 1), (5001, "uint32", 1)]),
        (["holding", "5000", "float64"], [(5000, "float64", 2)]),
        (["holding", "5000-5003", "string"], [(5000, "string", 4)]),
        (["holding", "4999"], [(4999, "uint16", 1)]),
    ],
)
def test_registers_of_four_bytes_hold_values_of_32_bits(words, expected):
    points = read(*words, wide=WIDE)
    assert [(each.address, each.type, each.count) for each in points] == expected
    assert {each.width for each in points} == {4 if words[1] != "4999" else 2}


def test_values_are_written_to_registers_of_four_bytes():
    written = [each.point for each in write("holding", "5000", "1.5", "2.5", "float32", wide=WIDE)]
    assert [(each.address, each.count, each.width) for each in written] == [(5000, 1, 4), (5001, 1, 4)]
    (text,) = write("holding", "5000", "abcde", "string", wide=WIDE)
    assert (text.point.count, text.point.width) == (2, 4)


@pytest.mark.parametrize(
    ("words", "what"),
    [
        (["holding", "4999-5000"], "only some of holding 4999-5000 have four bytes"),
        (["holding", "4999", "uint32"], "only some of holding 4999-5000 have four bytes"),
        (["holding", "5999", "float64"], "only some of holding 5999-6000 have four bytes"),
        (["holding", "5000", "int16"], "these registers have four bytes, and a int16 has two"),
    ],
)
def test_a_value_lies_in_registers_of_one_kind(words, what):
    with pytest.raises(WrongUsageError, match=what):
        read(*words, wide=WIDE)
    with pytest.raises(WrongUsageError, match="only some of holding 4999-5000 have four bytes"):
        write("holding", "4999", "1", "2", wide=WIDE)
