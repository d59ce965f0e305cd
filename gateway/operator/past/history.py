"""Keeps the history of lines and units: samples their counters, and has a file written."""

import asyncio
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path
from typing import Final

from gateway.events import Emit
from gateway.operator.past.uses import Look
from gateway.runtime.running import Running
from gateway.state.row_file import RowFile, growing, numbered_texts
from gateway.timing.history import History, Slot

FILE_NAME: Final = "history.sqlite"
#: How often the counters are sampled, in seconds.
LOOK_EVERY: Final = 10.0

_TABLE: Final = numbered_texts("slots", 0x4D424748, "pages with a history")  # "MBGH"


@asynccontextmanager
async def history_kept(
    running: Running, folder: Path | None, clock: Callable[[], float] = time.time
) -> AsyncIterator[History]:
    """Keep a history that grows inside the context; without a `folder` it is lost with the process.

    `clock` gives seconds since 1970.
    """
    history, look = History(), Look()

    async def add() -> None:
        uses = await look.take(running.gateway)
        history.add(clock(), uses.lines, uses.units)

    file = None if folder is None else _file(folder / FILE_NAME, history, running.emit)
    async with growing("history", partial(_keep_adding, add), add, file, running.emit):
        yield history


async def _keep_adding(add: Callable[[], Awaitable[None]]) -> None:
    while True:
        await asyncio.sleep(LOOK_EVERY)
        await add()


def _file(file: Path, history: History, emit: Emit) -> RowFile[Slot]:
    return RowFile(file, _TABLE, history, emit, read=Slot.read, row=lambda slot: (slot.number, slot.as_text()))
