"""Keeps the last events over a restart."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Final

from gateway.events import Emit, PartFailed
from gateway.observe.last_events import LastEvent, LastEvents, read_row
from gateway.state.row_file import RowFile, numbered_texts

FILE_NAME: Final = "events.sqlite"
_TABLE: Final = numbered_texts("events", 0x4D424745, "the last events")  # "MBGE"


@asynccontextmanager
async def events_kept(last: LastEvents, folder: Path, emit: Emit) -> AsyncIterator[None]:
    """Read the `last` events of earlier runs, and write those of this one, inside the context."""
    file = RowFile(folder / FILE_NAME, _TABLE, last, emit, read=read_row, row=LastEvent.row)

    async def keep() -> None:
        try:
            await file.keep_writing()
        except Exception as error:  # noqa: BLE001 - a defect here ends the file and nothing else
            emit(PartFailed.of("events", error))

    task = asyncio.create_task(keep(), name="events")
    try:
        yield
    finally:
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task
        last.count_now()
        await file.close()
