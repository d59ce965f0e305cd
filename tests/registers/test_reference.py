"""Reference numbers, as manuals print them."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.modbus.codes import Area
from gateway.registers.reference import place_of, reference


@pytest.mark.parametrize(
    ("area", "address", "number"),
    [
        (Area.HOLDING, 0, "40001"),
        (Area.HOLDING, 107, "40108"),
        (Area.HOLDING, 9998, "49999"),
        (Area.HOLDING, 9999, "410000"),
        (Area.HOLDING, 65535, "465536"),
        (Area.COILS, 126, "00127"),
        (Area.COILS, 9999, "010000"),
        (Area.DISCRETE, 0, "10001"),
        (Area.INPUT, 0, "30001"),
    ],
)
def test_a_reference_counts_from_1_behind_the_digit_of_its_area(area, address, number):
    assert reference(area, address) == number


@given(st.sampled_from(Area), st.integers(0, 65535))
def test_each_reference_leads_back(area, address):
    assert place_of(reference(area, address)) == (area, address)


def test_a_short_address_may_have_six_digits():
    assert place_of("400001") == (Area.HOLDING, 0)


@pytest.mark.parametrize("text", ["", "40000", "4001", "20001", "465537", "4000x", "4000001", "²0001"])
def test_other_numbers_are_none(text):
    assert place_of(text) is None
