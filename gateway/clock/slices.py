"""Long readings of counters, with pauses in which the lines work."""

import asyncio
from collections.abc import Iterable
from typing import Final, TypeVar

T = TypeVar("T")

#: The lines get a turn each time this many seconds have passed.
_SLICE: Final = 0.0005


async def in_slices(parts: Iterable[T]) -> list[T]:
    """Collect `parts`, which the iterable makes one by one; meanwhile the event loop gets its turns."""
    now = asyncio.get_running_loop().time
    made: list[T] = []
    until = now() + _SLICE
    for part in parts:
        made.append(part)
        if now() >= until:
            await asyncio.sleep(0)
            until = now() + _SLICE
    return made
