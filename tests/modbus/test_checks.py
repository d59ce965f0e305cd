import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.modbus.checks import crc16, crc_fits, lrc, with_crc


def crc_of_the_specification(data: bytes) -> int:
    """Bit by bit, as S 6.2.2 describes it."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return crc


@pytest.mark.parametrize(
    ("data", "crc"),
    [
        pytest.param(b"123456789", 0x4B37, id="check value of CRC-16/MODBUS"),
        pytest.param(bytes.fromhex("02 07"), 0x1241, id="example of S 6.2.2"),
        pytest.param(b"", 0xFFFF, id="nothing"),
    ],
)
def test_crc(data, crc):
    assert crc16(data) == crc


def test_the_crc_goes_low_byte_first():
    assert with_crc(bytes.fromhex("02 07")) == bytes.fromhex("02 07 41 12")


@pytest.mark.parametrize(
    ("data", "value"),
    [
        pytest.param("02 03 00 1D", 0xDE, id="example of the Mint application note"),
        pytest.param("", 0x00, id="nothing"),
        pytest.param("80 80", 0x00, id="the sum wraps"),
        pytest.param("FF FF", 0x02, id="two's complement"),
    ],
)
def test_lrc(data, value):
    assert lrc(bytes.fromhex(data)) == value


@given(st.binary(max_size=260))
def test_the_crc_is_that_of_the_specification(data):
    assert crc16(data) == crc_of_the_specification(data)


@given(st.binary(max_size=254))
def test_the_sum_over_data_and_lrc_is_zero(data):
    assert (sum(data) + lrc(data)) % 256 == 0


@given(st.binary(min_size=1, max_size=254), st.integers(1, 255), st.data())
def test_a_crc_fits_its_data_and_no_data_with_a_wrong_byte(data, error, choice):
    frame = bytearray(with_crc(data))
    assert crc_fits(bytes(frame))
    frame[choice.draw(st.integers(0, len(frame) - 1))] ^= error
    assert not crc_fits(bytes(frame))
