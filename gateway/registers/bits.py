"""Coils and inputs in PDUs: eight in a byte."""


def pack_bits(bits: bytes) -> bytes:
    """Coils or inputs, one byte of 0 or 1 each, packed eight in a byte, the first one lowest (A 6.1)."""
    size = (len(bits) + 7) // 8
    return int(bits[::-1].translate(_AS_DIGIT) or b"0", 2).to_bytes(size, "little")


def unpack_bits(data: bytes, count: int) -> bytes:
    """The first `count` bits of `data`, one 0 or 1 each: the opposite of `pack_bits`."""
    digits = format(int.from_bytes(data, "little"), f"0{len(data) * 8}b").encode()
    return digits[::-1][:count].translate(_AS_BIT)


_AS_DIGIT = bytes([ord("0"), ord("1")]) + bytes(254)
_AS_BIT = bytes.maketrans(b"01", b"\0\1")
