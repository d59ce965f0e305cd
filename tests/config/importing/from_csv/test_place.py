"""Addresses and references, as manuals and spreadsheets write them."""

import pytest

from gateway.config.importing.from_csv.place import Addressing, Place, addressing_of, looks_like_a_place
from gateway.config.importing.imported import ImportedFileError
from gateway.modbus.codes import Area

PLAIN = Addressing()


@pytest.mark.parametrize("cell", ["31", "0x1F", "0X1f", "1Fh", "001FH", "$1F", "16#1F", "x1F", "'31", " 31 "])
def test_a_number_in_any_notation(cell):
    assert PLAIN.place(cell) == Place(31, 31)


@pytest.mark.parametrize(
    ("cell", "first", "last"),
    [
        ("100-101", 100, 101),
        ("100 – 101", 100, 101),
        ("100~103", 100, 103),
        ("100...103", 100, 103),
        ("100 to 103", 100, 103),
        ("100 bis 103", 100, 103),
        ("0x10-0x11", 16, 17),
        ("100, 101", 100, 101),
        ("100/101", 100, 101),
        ("100\n101", 100, 101),
        ("7 & 8 & 9", 7, 9),
        ("10,001", 10001, 10001),
    ],
)
def test_several_registers(cell, first, last):
    assert PLAIN.place(cell) == Place(first, last)


@pytest.mark.parametrize(("cell", "bit"), [("100.3", 3), ("100.15", 15), ("100.b8", 8), ("100:4", 4), ("0x64.2", 2)])
def test_a_bit_of_a_register(cell, bit):
    assert PLAIN.place(cell) == Place(100, 100, None, bit)


@pytest.mark.parametrize(
    ("cell", "area", "address"),
    [
        ("40001", Area.HOLDING, 0),
        ("400001", Area.HOLDING, 0),
        ("30017", Area.INPUT, 16),
        ("10001", Area.DISCRETE, 0),
        ("00017", Area.COILS, 16),
        ("17", Area.COILS, 16),
        ("465536", Area.HOLDING, 65535),
    ],
)
def test_references_count_from_1_and_name_their_area(cell, area, address):
    assert Addressing(is_reference=True).place(cell) == Place(address, address, area)


@pytest.mark.parametrize(
    ("cell", "area"), [("4x0017", Area.HOLDING), ("3x00017", Area.INPUT), ("1X0017", Area.DISCRETE)]
)
def test_a_reference_with_an_x_is_one_in_any_column(cell, area):
    assert PLAIN.place(cell) == Place(16, 16, area)


@pytest.mark.parametrize("cell", ["", "-", "abcdefg", "70000", "-5", "103-100", "100, 103, 101", "see 12", "1.99"])
def test_what_is_no_address(cell):
    with pytest.raises(ImportedFileError):
        PLAIN.place(cell)
    assert not looks_like_a_place(cell)


@pytest.mark.parametrize("cell", ["40000", "50001", "49999999", "0", "400000"])
def test_what_is_no_reference(cell):
    with pytest.raises(ImportedFileError):
        Addressing(is_reference=True).place(cell)


@pytest.mark.parametrize(
    ("heading", "cells", "expected"),
    [
        ("Address", ["40001", "40003"], Addressing(is_reference=True, was_guessed=True)),
        ("Register", ["30001", "400001", "10017"], Addressing(is_reference=True, was_guessed=True)),
        ("Address", ["400001", "400020.3"], Addressing(is_reference=True, was_guessed=True)),
        ("Address", ["32080", "37000.1"], Addressing(was_guessed=True)),
        ("Address", ["40000", "40002"], Addressing()),  # 40000 is no reference, so none is
        ("Register address", ["32080", "37000"], Addressing(was_guessed=True)),  # as inverters have them
        ("Protocol address", ["40001", "40003"], Addressing()),
        ("Address (0-based)", ["40001"], Addressing()),
        ("Address", ["1", "40001"], Addressing()),
        ("Address (from 1)", ["1", "2"], Addressing(from_1=True)),
        ("Address (hex)", ["10", "11"], Addressing(is_hex=True)),
        ("Address", ["0010", "001A"], Addressing(is_hex=True)),
        ("Address", ["0010", "001A-001B"], Addressing(is_hex=True)),
        ("Address", ["10", "1A", "112.3"], Addressing()),
        ("Address", ["100.0", "101.0"], Addressing(has_points=True)),
        ("Address", ["100.0", "100.1"], Addressing()),
    ],
)
def test_how_the_numbers_of_a_column_are_meant(heading, cells, expected):
    assert addressing_of(heading, cells, is_reference=False) == expected


def test_letters_in_a_column_of_decimal_numbers_are_no_address():
    with pytest.raises(ImportedFileError, match=r'^"1A" is no address, unless all are hexadecimal: then write'):
        PLAIN.place("1A")
    assert looks_like_a_place("1A")


def test_numbers_in_such_columns():
    assert Addressing(is_hex=True).place("10") == Place(16, 16)
    assert Addressing(from_1=True).place("1") == Place(0, 0)
    assert Addressing(has_points=True).place("100.0") == Place(100, 100)
    with pytest.raises(ImportedFileError):
        Addressing(from_1=True).place("0")
