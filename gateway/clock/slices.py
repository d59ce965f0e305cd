"""Long readings of counters, with pauses in which the lines work."""

import asyncio
from collections.abc import Iterable
from typing import Final, TypeVar

T = TypeVar("T")

#: The lines never wait longer than this for a part of a reading, in seconds.
_SLICE: Final = 0.0005


async def in_slices(parts: Iterable[T]) -> list[T]:
    """The parts, each of which is made when it is its turn."""
    now = asyncio.get_running_loop().time
    made: list[T] = []
    until = now() + _SLICE
    for part in parts:
        made.append(part)
        if now() >= until:
            await asyncio.sleep(0)
            until = now() + _SLICE
    return made
