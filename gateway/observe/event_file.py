"""Keeps the last events over a restart."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Final

from gateway.events import Emit
from gateway.observe.last_events import LastEvent, LastEvents, read_row
from gateway.state.row_file import RowFile, growing, numbered_texts

FILE_NAME: Final = "events.sqlite"
_TABLE: Final = numbered_texts("events", 0x4D424745, "the last events")  # "MBGE"


@asynccontextmanager
async def events_kept(last: LastEvents, folder: Path, emit: Emit) -> AsyncIterator[None]:
    """Read the `last` events of earlier runs, and write those of this one, inside the context."""

    async def grow() -> None:
        """Do nothing: they come by themselves."""

    async def finish() -> None:
        last.count_now()

    file = RowFile(folder / FILE_NAME, _TABLE, last, emit, read=read_row, row=LastEvent.row)
    async with growing("events", grow, finish, file, emit):
        yield
