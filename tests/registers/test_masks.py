"""Function 22: the requests for bits, what they make of a register, and what does the same without it."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.modbus.pdu import parse_request
from gateway.registers.masks import mask_request, masked, read_before, write_after

WORDS = st.integers(0, 0xFFFF)


def test_the_example_of_the_specification() -> None:
    """A 6.16: 12 AND F2 OR (25 AND NOT F2) is 17."""
    assert masked(bytes.fromhex("16 00 04 00 F2 00 25"), 0x12) == 0x17


@given(WORDS, WORDS, WORDS, WORDS)
def test_only_the_bits_of_the_mask_change(address: int, mask: int, bits: int, before: int) -> None:
    pdu = mask_request(address, mask, bits)
    assert parse_request(pdu).write.start == address
    assert masked(pdu, before) == (before & ~mask) | (bits & mask)


@pytest.mark.parametrize(("function", "written"), [(6, "06 12 34 00 F5"), (16, "10 12 34 00 01 02 00 F5")])
def test_a_read_and_a_write_do_the_same(function: int, written: str) -> None:
    pdu = mask_request(0x1234, 0x000F, 0x0005)
    assert read_before(pdu) == bytes.fromhex("03 12 34 00 01")
    assert write_after(pdu, 0x00FA, function) == bytes.fromhex(written)
    parse_request(write_after(pdu, 0x00FA, function))
