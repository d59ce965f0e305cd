"""Error checks of serial frames: CRC-16 for RTU, LRC for ASCII."""

from typing import Final

from fastcrc import crc16 as _crc16

_modbus_crc: Final = _crc16.modbus


def crc16(data: bytes) -> int:
    """CRC-16 of `data` (S 2.5.1.2): initial FFFF, polynomial A001 reflected. It goes on the line low byte first."""
    return _modbus_crc(data)


def with_crc(data: bytes) -> bytes:
    """`data` and its CRC, low byte first."""
    return data + _modbus_crc(data).to_bytes(2, "little")


def crc_fits(frame: bytes) -> bool:
    """Whether the last two bytes of `frame` are the CRC of those before: the CRC over both is then zero."""
    return _modbus_crc(frame) == 0


def lrc(data: bytes) -> int:
    """LRC of `data` (S 2.5.2.2): two's complement of the sum of its bytes, one byte."""
    return -sum(data) & 0xFF
