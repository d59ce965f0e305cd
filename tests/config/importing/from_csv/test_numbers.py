"""Numbers, factors, and units that are a factor too."""

from decimal import Decimal

import pytest

from gateway.config.importing.from_csv.words import factor_of, number_of, scaled_unit
from gateway.config.importing.imported import ImportedFileError
from gateway.config.importing.points import plain


@pytest.mark.parametrize(
    ("cell", "number"),
    [
        ("1", "1"),
        ("-0.5", "-0.5"),
        ("−40", "-40"),
        ("0x7FFF", "32767"),
        ("7FFFh", "32767"),
        ("1e-3", "0.001"),
        (".5", "0.5"),
    ],
)
def test_numbers(cell, number):
    assert number_of(cell) == Decimal(number)


@pytest.mark.parametrize(
    ("cell", "has_decimal_comma", "number"),
    [
        ("0,1", False, "0.1"),
        ("0,1", True, "0.1"),
        ("1,000", False, "1000"),
        ("1,000", True, "1"),
        ("1,234.5", False, "1234.5"),
    ],
)
def test_commas(cell, has_decimal_comma, number):
    assert number_of(cell, has_decimal_comma=has_decimal_comma) == Decimal(number)


@pytest.mark.parametrize("cell", ["", "a", "1 V", "1e999", "--1", "0x", "nan", "inf", "١"])
def test_what_is_no_number(cell):
    with pytest.raises(ImportedFileError):
        number_of(cell)


@pytest.mark.parametrize(
    ("cell", "factor"),
    [
        ("0.1", "0.1"),
        ("1/10", "0.1"),
        ("x10", "10"),
        ("×0.01", "0.01"),
        ("/10", "0.1"),
        ("÷ 100", "0.01"),
        ("10^-2", "0.01"),
        ("*10", "10"),
    ],
)
def test_factors(cell, factor):
    assert factor_of(cell) == Decimal(factor)


@pytest.mark.parametrize("cell", ["0", "1/0", "", "SF_A", "1e99"])
def test_what_is_no_factor(cell):
    with pytest.raises(ImportedFileError):
        factor_of(cell)


@pytest.mark.parametrize(
    ("unit", "factor", "rest"),
    [
        ("0.1V", "0.1", "V"),
        ("10 mA", "10", "mA"),
        ("0.01", "0.01", ""),
        ("V", "1", "V"),
        ("1/min", "1", "1/min"),
        ("%", "1", "%"),
        ("", "1", ""),
        ("0-100", "1", "0-100"),
        ("m3/h", "1", "m3/h"),
    ],
)
def test_a_unit_may_be_a_factor_too(unit, factor, rest):
    assert scaled_unit(unit) == (Decimal(factor), rest)


def test_a_number_is_written_as_it_is():
    assert [plain(Decimal(text)) for text in ("10", "0.1", "1E+2", "-40.0")] == [10, 0.1, 100, -40]
