"""Coils and inputs as messages carry them: eight in a byte."""

from hypothesis import given
from hypothesis import strategies as st

from gateway.registers.bits import pack_bits, unpack_bits


def test_bits_are_packed_lowest_first_and_padded_with_zeros():
    """Coils 20-38 of A 6.1: CD 6B 05."""
    bits = bytes(int(bit) for bit in "1011001111010110101")
    assert pack_bits(bits) == bytes.fromhex("CD 6B 05")
    assert unpack_bits(bytes.fromhex("CD 6B 05"), 19) == bits


def test_no_bits_are_no_bytes():
    assert pack_bits(b"") == unpack_bits(b"", 0) == b""


@given(st.lists(st.integers(0, 1), max_size=2000).map(bytes))
def test_unpacking_is_the_opposite_of_packing(bits):
    packed = pack_bits(bits)
    assert len(packed) == (len(bits) + 7) // 8
    assert unpack_bits(packed, len(bits)) == bits


@given(st.binary(max_size=250))
def test_packing_is_the_opposite_of_unpacking(data):
    assert pack_bits(unpack_bits(data, 8 * len(data))) == data
