"""Values at addresses, as they are asked for over HTTP and at the control socket."""

import pytest

from gateway.errors import Malformed
from gateway.modbus.codes import Area
from gateway.operator.values.unit_values import values_at

WIDE = {"holding": ((5000, 5999),)}


@pytest.mark.parametrize(
    ("first", "last", "data_type", "expected"),
    [
        (5000, None, "", [("uint32", 1, 4)]),
        (5000, 5001, "int32", [("int32", 1, 4)] * 2),
        (5000, None, "float64", [("float64", 2, 4)]),
        (5000, 5003, "string", [("string", 4, 4)]),
        (4998, 4999, "", [("uint16", 1, 2)] * 2),
        (6000, None, "uint32", [("uint32", 2, 2)]),
    ],
)
def test_registers_have_as_many_bytes_as_the_unit_says(first, last, data_type, expected):
    points = values_at(Area.HOLDING, first, last, data_type, "none", WIDE)
    assert [(each.type, each.count, each.width) for each in points] == expected


@pytest.mark.parametrize(
    ("first", "last", "data_type", "why"),
    [
        (4999, 5000, "", "only some of holding 4999-5000 have four bytes"),
        (5999, None, "float64", "only some of holding 5999-6000 have four bytes"),
        (5000, None, "bcd16", "holding 5000 has four bytes, and a bcd16 has two"),
        (5000, 5002, "uint64", "5000-5002 are 3 registers, and each uint64 takes 2"),
    ],
)
def test_a_value_lies_in_registers_of_one_kind(first, last, data_type, why):
    with pytest.raises(Malformed, match=why):
        values_at(Area.HOLDING, first, last, data_type, "none", WIDE)
    assert values_at(Area.INPUT, first, first, "", "none", WIDE)[0].width == 2
