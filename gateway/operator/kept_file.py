"""A database file that something is kept in: opened, read and written in threads, and trouble with it is told once.

A disk that hangs does not delay the lines. What could not be written is written later.
"""

import asyncio
import sqlite3
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final, Generic, ParamSpec, Protocol, TypeVar

from gateway.clock.threads import ThreadPerCall
from gateway.errors import StateError
from gateway.events import Emit, StateDamaged, StateKeptAgain, StateNotKept
from gateway.state.database import Database, Row, Table, is_damage, open_table

C = TypeVar("C")
P = ParamSpec("P")
T = TypeVar("T")

#: How long the disk may take at the end, in seconds.
CLOSING_DEADLINE: Final = 1.0


class Content(Protocol[C]):
    """What is kept in a file; `C` are changes that the file does not have yet.

    `save` is called in a thread, while the event loop goes on.
    """

    async def load(self, rows: Sequence[Row]) -> None:
        """Add the rows of the file, when it is opened for the first time."""

    def take(self) -> C | None:
        """Take what has changed since the last time; None if nothing has."""

    def put_back(self, changes: C) -> None:
        """Take back changes that could not be written."""

    def change_all(self) -> None:
        """Count all that is known as changed: nothing of it is in the file any more."""

    def save(self, database: Database, changes: C) -> None:
        """Write changes.

        Raises:
            sqlite3.Error: the disk is full or fails; then nothing of them is written.
        """


class KeptFile(Generic[C]):
    """The file of some content. It is written each time that `pause()` seconds have passed."""

    def __init__(
        self, file: Path, table: Table, content: Content[C], pause: Callable[[], float], emit: Emit
    ) -> None:
        self._file = file
        self._table = table
        self._content = content
        self._pause = pause
        self._emit = emit
        self._database: Database | None = None
        self._was_read = False
        self._fails = False

    async def keep_writing(self) -> None:
        """Read the file, and write changes from time to time, until cancelled."""
        while True:
            await self.write()
            await asyncio.sleep(self._pause())

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

    async def read(self, look: Callable[[Database | None], T]) -> T:
        """Call `look` in a thread, with the database, or None while it cannot be read."""
        database = self._database
        try:
            return await in_thread(look, database)
        except sqlite3.Error as error:
            await self._give_up(database, error)
            self._tell(str(error))
            return await in_thread(look, None)

    async def close(self) -> None:
        """Write the rest and close the file, if it is open; give up after CLOSING_DEADLINE."""
        if self._database is None:
            return
        try:
            async with asyncio.timeout(CLOSING_DEADLINE):
                await self._write(self._database)
                if self._database is not None:
                    await in_thread(self._database.close)
        except TimeoutError:
            self._tell("the disk takes too long")
        except sqlite3.Error as error:
            self._tell(str(error))

    async def _open(self) -> Database:
        opened = await in_thread(open_table, self._file, self._table)
        if opened.damage:
            self._emit(StateDamaged(str(self._file), opened.damage))
        if self._was_read:
            self._content.change_all()
        else:
            await self._content.load(opened.rows)
            self._was_read = True
        return opened.database

    async def _write(self, database: Database) -> None:
        changes = self._content.take()
        if changes is None:
            return
        try:
            await in_thread(self._content.save, database, changes)
        except BaseException as error:
            self._content.put_back(changes)
            await self._give_up(database, error)
            raise

    async def _give_up(self, database: Database | None, error: BaseException) -> None:
        """Close a file that is damaged: the next write sets it aside."""
        if database is not None and is_damage(error):
            if self._database is database:
                self._database = None
            await in_thread(database.close)

    def _tell(self, trouble: str) -> None:
        if trouble and not self._fails:
            self._emit(StateNotKept(str(self._file), trouble))
        if self._fails and not trouble:
            self._emit(StateKeptAgain(str(self._file)))
        self._fails = bool(trouble)


async def in_thread(call: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
    """Call it in a thread of its own."""
    loop = asyncio.get_running_loop()
    return await loop.run_in_executor(ThreadPerCall("history"), partial(call, *args, **kwargs))
