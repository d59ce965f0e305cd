"""Long work in slices, with pauses in which the lines work."""

import asyncio
from collections import deque
from collections.abc import Iterable, Iterator
from time import sleep, thread_time
from typing import Final, TypeVar
from weakref import WeakKeyDictionary

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
            await turn()
            until = now() + _SLICE
    return made


#: Who waits for a turn of its event loop.
_waiting: WeakKeyDictionary[asyncio.AbstractEventLoop, deque[asyncio.Future[None]]] = WeakKeyDictionary()


async def turn() -> None:
    """Let the lines work until it is the turn of the caller: one in each turn of the loop, however many wait."""
    loop = asyncio.get_running_loop()
    waiting = _waiting.setdefault(loop, deque())
    own = loop.create_future()
    waiting.append(own)
    if len(waiting) == 1:
        loop.call_soon(_next, loop, waiting)
    await own


def _next(loop: asyncio.AbstractEventLoop, waiting: deque[asyncio.Future[None]]) -> None:
    while waiting and waiting[0].done():  # given up
        waiting.popleft()
    if not waiting:
        return
    waiting[0].set_result(None)
    loop.call_soon(_next, loop, waiting)


def with_rests(parts: Iterable[T]) -> Iterator[T]:
    """Yield `parts`; the thread rests between slices of making and using them."""
    begun = thread_time()
    for part in parts:
        yield part
        if (spent := thread_time() - begun) >= _SLICE_OF_THREAD:
            sleep(_PAUSES * spent)
            begun = thread_time()
