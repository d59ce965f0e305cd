"""How registers carry values, against pymodbus: both encode and decode alike, in both orders of words."""

import math

from hypothesis import given
from hypothesis import strategies as st
from pymodbus.client.mixin import ModbusClientMixin

from gateway.registers.datatypes import decode, encode

_THEIRS = ModbusClientMixin.DATATYPE
TYPES = {
    "uint16": _THEIRS.UINT16,
    "int16": _THEIRS.INT16,
    "uint32": _THEIRS.UINT32,
    "int32": _THEIRS.INT32,
    "uint64": _THEIRS.UINT64,
    "int64": _THEIRS.INT64,
    "float32": _THEIRS.FLOAT32,
    "float64": _THEIRS.FLOAT64,
}


@given(st.sampled_from(sorted(TYPES)), st.sampled_from(["none", "words"]), st.data())
def test_both_read_and_write_the_same(data_type, swap, data):
    theirs = TYPES[data_type]
    registers = data.draw(st.lists(st.integers(0, 0xFFFF), min_size=theirs.value[1], max_size=theirs.value[1]))
    order = "little" if swap == "words" else "big"
    value = ModbusClientMixin.convert_from_registers(registers, theirs, word_order=order)
    carried = b"".join(register.to_bytes(2, "big") for register in registers)
    if isinstance(value, float) and math.isnan(value):
        assert math.isnan(decode(carried, data_type, swap))
        return
    assert encode(value, data_type, swap) == carried
    assert encode(decode(carried, data_type, swap), data_type, swap) == carried
    assert ModbusClientMixin.convert_to_registers(value, theirs, word_order=order) == registers
