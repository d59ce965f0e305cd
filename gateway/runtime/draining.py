"""How long parts that stop may take to finish what is in progress."""

import asyncio
from collections.abc import Callable
from typing import Final

#: How long requests in progress and their clients may take when their part stops, in seconds. With CLOSING_TIME of
#: `runtime/open_ports.py`, the process ends in less than 5 s. Only a disk that hangs adds to it: 1 s for the files of
#: the state folder, or 2 s with persistent images, and 1 s each for the history and the trends of the
#: web page. What is kept for the broker is written while others finish, and is waited for 1 s.
DRAIN_TIME: Final = 3.0
#: How often this is checked, in seconds.
_DRAIN_STEP: Final = 0.02


async def until(is_done: Callable[[], bool], longest: float = DRAIN_TIME) -> None:
    """Wait until `is_done`, at most `longest` seconds."""
    loop = asyncio.get_running_loop()
    end = loop.time() + longest
    while loop.time() < end and not is_done():
        await asyncio.sleep(_DRAIN_STEP)
