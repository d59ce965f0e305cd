"""Function 22 (A 6.16): `(register AND and_mask) OR (or_mask AND NOT and_mask)`; a read and a write that do it too."""

from gateway.modbus.codes import Area, FunctionCode
from gateway.modbus.pdu import Span
from gateway.registers.items import read_request


def mask_request(address: int, mask: int, bits: int) -> bytes:
    """Make the request PDU that sets the bits of a register that are 1 in `mask` to those of `bits`."""
    words = b"".join(word.to_bytes(2, "big") for word in (address, mask ^ 0xFFFF, bits & mask))
    return bytes((FunctionCode.MASK_WRITE_REGISTER,)) + words


def written_bits(pdu: bytes) -> tuple[int, int]:
    """Return the mask of the bits that a request PDU sets, whatever the register holds, and their values."""
    mask = int.from_bytes(pdu[3:5], "big") ^ 0xFFFF
    return mask, masked(pdu, 0)


def masked(pdu: bytes, before: int) -> int:
    """Compute what a request PDU makes of a register that holds `before`."""
    and_mask, or_mask = int.from_bytes(pdu[3:5], "big"), int.from_bytes(pdu[5:7], "big")
    return (before & and_mask) | (or_mask & ~and_mask)


def read_before(pdu: bytes) -> bytes:
    """Make the request PDU that reads the register of a request PDU."""
    return read_request(Span(Area.HOLDING, int.from_bytes(pdu[1:3], "big"), 1))


def write_after(pdu: bytes, before: int, function: int) -> bytes:
    """Make the request PDU with `function`, 06 or 16, that does the same to a register that holds `before`."""
    count = b"" if function == FunctionCode.WRITE_SINGLE_REGISTER else b"\0\1\2"
    return bytes((function,)) + pdu[1:3] + count + masked(pdu, before).to_bytes(2, "big")
