"""Keeps the history of lines and units: samples their counters, and writes what has changed to a file.

The file is written once a minute and at a stop, in a thread, so that a disk which hangs does not delay the lines. What
could not be written is written later. A power cut loses what happened since the last write.
"""

import asyncio
import sqlite3
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable
from contextlib import asynccontextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Final, ParamSpec, TypeVar
from zlib import crc32

from gateway.clock.threads import ThreadPerCall
from gateway.errors import StateError
from gateway.events import Emit, PartFailed, StateDamaged, StateKeptAgain, StateNotKept
from gateway.operator.uses import Look
from gateway.runtime.running import Running
from gateway.state.database import Database, Row, Table, is_damage, open_table
from gateway.timing.history import Changes, History, Slot

P = ParamSpec("P")
T = TypeVar("T")

FILE_NAME: Final = "history.sqlite"
#: How often the counters are sampled, and how often the file is written, in seconds.
LOOK_EVERY: Final = 10.0
WRITE_EVERY: Final = 60.0
#: How long the disk may take at the end, in seconds.
CLOSING_DEADLINE: Final = 1.0


def _check_sum(row: Row) -> int:
    number, content = row
    return crc32(f"{number}={content}".encode())


_TABLE: Final = Table(
    name="slots",
    columns=(("number", "INTEGER"), ("content", "TEXT")),
    keys=1,
    check_sum=_check_sum,
    application=0x4D424748,  # "MBGH"
    version=1,
    needed_by="pages with a history",
)


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

    file = None if folder is None else HistoryFile(folder / FILE_NAME, history, running.emit)
    works: list[Callable[[], Awaitable[None]]] = [partial(_keep_adding, add)]
    if file is not None:
        works.append(file.keep_writing)
    tasks = [asyncio.create_task(_guarded(work, running.emit), name="history") for work in works]
    try:
        yield history
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.wait(tasks)
        await _guarded(add, running.emit)
        if file is not None:
            await file.close()


async def _keep_adding(add: Callable[[], Awaitable[None]]) -> None:
    while True:
        await asyncio.sleep(LOOK_EVERY)
        await add()


async def _guarded(work: Callable[[], Awaitable[None]], emit: Emit) -> None:
    try:
        await work()
    except Exception as error:  # noqa: BLE001 - a defect here ends the history and nothing else
        emit(PartFailed.of("history", error))


class HistoryFile:
    """The file of a history. Trouble is reported when it begins and when it ends."""

    def __init__(self, file: Path, history: History, emit: Emit) -> None:
        self._file = file
        self._history = history
        self._emit = emit
        self._database: Database | None = None
        self._was_read = False
        self._fails = False

    async def keep_writing(self) -> None:
        """Read the file, and write changes every minute, until cancelled."""
        while True:
            await self.write()
            await asyncio.sleep(WRITE_EVERY)

    async def write(self) -> None:
        """Write changes; open and read the file first if it is not open."""
        try:
            if self._database is None:
                self._database = await self._open()
            await self._write(self._database)
        except (StateError, sqlite3.Error) as error:
            self._tell(str(error))
        else:
            self._tell("")

    async def close(self) -> None:
        """Write the rest and close the file, if it is open; give up after CLOSING_DEADLINE."""
        if self._database is None:
            return
        try:
            async with asyncio.timeout(CLOSING_DEADLINE):
                await self._write(self._database)
                await _in_thread(self._database.close)
        except TimeoutError:
            self._tell("the disk takes too long")
        except sqlite3.Error as error:
            self._tell(str(error))

    async def _open(self) -> Database:
        opened = await _in_thread(open_table, self._file, _TABLE)
        if opened.damage:
            self._emit(StateDamaged(str(self._file), opened.damage))
        if self._was_read:
            self._history.change_all()
        else:
            self._history.load(await _in_thread(_slots, opened.rows))
            self._was_read = True
        return opened.database

    async def _write(self, database: Database) -> None:
        changes = self._history.changes()
        if not changes.written and not changes.gone:
            return
        try:
            await _in_thread(_save, database, changes)
        except BaseException as error:
            self._history.put_back(changes)
            if is_damage(error):
                self._database = None
            raise

    def _tell(self, trouble: str) -> None:
        if trouble and not self._fails:
            self._emit(StateNotKept(str(self._file), trouble))
        if self._fails and not trouble:
            self._emit(StateKeptAgain(str(self._file)))
        self._fails = bool(trouble)


def _slots(rows: Iterable[Row]) -> list[Slot]:
    slots = []
    for number, content in rows:
        with suppress(ValueError):  # written by a version that counted something else
            slots.append(Slot.read(number, content))
    return slots


def _save(database: Database, changes: Changes) -> None:
    try:
        database.write([(slot.number, slot.as_text()) for slot in changes.written], [(each,) for each in changes.gone])
    except sqlite3.DatabaseError as error:
        if is_damage(error):
            database.close()
        raise


async def _in_thread(call: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
    loop = asyncio.get_running_loop()
    return await loop.run_in_executor(ThreadPerCall("history"), partial(call, *args, **kwargs))
