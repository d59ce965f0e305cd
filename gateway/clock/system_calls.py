"""What the loop asks of the kernel for each request, without an error for what is usual. Nothing blocks but a wait.

Where it is compiled, `_system_calls.c` takes the place of these functions: docs/adr/0043-system-calls-in-c.md
"""

import os
import select
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from typing import Any, Final

#: Waits for at most so many seconds, for none or less not at all. Returns what a dict has for each ready descriptor, or
#: None, followed by its events; for MOST_FOUND at most. A signal may end it early.
Wait = Callable[[float, dict[int, Any]], tuple[Any, ...]]

#: The most bytes of one `read`.
MOST_READ: Final = 4096
#: The most descriptors that a wait finds; then it is time to look at the timers.
MOST_FOUND: Final = 64
#: `select` is used for the last part of a wait, in seconds. Silences and frames are shorter, most time limits longer.
EXACT_PART: Final = 0.06
#: `select` supports only descriptors below this number (select(2)).
SELECTABLE: Final = 1024


def read(descriptor: int, most: int) -> bytes | None:
    """Read `most` bytes at most, no more than MOST_READ. Return None if there are none yet, and nothing at the end.

    Raises:
        OSError: what is behind the descriptor is gone.
    """
    try:
        return os.read(descriptor, most)
    except BlockingIOError:
        return None


def read_into(descriptor: int, room: bytearray | memoryview) -> int:
    """Read what has room. Return the number of bytes: -1 if there are none yet, 0 at the end.

    Raises:
        OSError: what is behind the descriptor is gone.
    """
    try:
        return os.readv(descriptor, (room,))
    except BlockingIOError:
        return -1


def write(descriptor: int, data: bytes | bytearray | memoryview) -> int:
    """Write `data`. Return how many bytes were taken.

    Raises:
        OSError: what is behind the descriptor is gone.
    """
    try:
        return os.write(descriptor, data)
    except BlockingIOError:
        return 0


def wait_of(epoll: select.epoll) -> Wait:
    """Return what waits for the descriptors of `epoll`, as exactly as `select` counts: in microseconds.

    `epoll_wait` counts in milliseconds. So the last EXACT_PART is a wait for the descriptor of the epoll itself.
    """
    descriptor = epoll.fileno()

    def wait(seconds: float, known: dict[int, Any]) -> tuple[Any, ...]:
        if 0.0 < seconds <= EXACT_PART and descriptor < SELECTABLE:
            if not select.select((descriptor,), (), (), seconds)[0]:
                return ()
            seconds = 0.0
        elif seconds > EXACT_PART:
            seconds -= EXACT_PART
        found = epoll.poll(max(seconds, 0.0), MOST_FOUND)
        return tuple(each for number, events in found for each in (known.get(number), events))

    return wait


with suppress(ImportError):
    _compiled = import_module("gateway.clock._system_calls")
    read, read_into, write, wait_of = _compiled.read, _compiled.read_into, _compiled.write, _compiled.wait_of
