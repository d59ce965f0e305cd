"""What lines and networks do to bytes: noise around them, holes in them, any cut into chunks."""

import random
from collections.abc import Iterator


def noise(size: int, seed: int = 0) -> bytes:
    """`size` bytes of noise, the same for the same seed."""
    return random.Random(seed).randbytes(size)


def chunkings(data: bytes) -> Iterator[list[bytes]]:
    """The ways in which `data` is worth receiving: whole, byte by byte, and cut in two at every place."""
    yield [data]
    yield [bytes((byte,)) for byte in data]
    for at in range(1, len(data)):
        yield [data[:at], data[at:]]


def random_chunks(data: bytes, seed: int = 0, longest: int = 16) -> list[bytes]:
    """`data` in chunks of 1 to `longest` bytes, the same for the same seed."""
    dice, chunks = random.Random(seed), []
    while data:
        size = dice.randint(1, longest)
        chunks.append(data[:size])
        data = data[size:]
    return chunks


def flipped(data: bytes, bit: int) -> bytes:
    """`data` with one bit wrong; bit 0 is the lowest of the first byte."""
    return bytes(byte ^ (1 << bit % 8 if at == bit // 8 else 0) for at, byte in enumerate(data))
