"""Long work in slices, with pauses in which the lines work."""

import asyncio
from collections.abc import Iterable, Iterator
from time import sleep, thread_time
from typing import Final, TypeVar

T = TypeVar("T")

#: The lines get a turn each time this many seconds have passed.
_SLICE: Final = 0.0005
#: A thread works in slices of this time, in seconds, with pauses that are as many times longer: the lines need the
#: interpreter, and the work never takes more than a quarter of a processor.
_SLICE_OF_THREAD: Final = 0.00025
_PAUSES: Final = 3


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


def with_rests(parts: Iterable[T]) -> Iterator[T]:
    """Yield `parts`; the thread rests between slices of making and using them."""
    begun = thread_time()
    for part in parts:
        yield part
        if (spent := thread_time() - begun) >= _SLICE_OF_THREAD:
            sleep(_PAUSES * spent)
            begun = thread_time()
