"""A database with what a part of the gateway has in memory: read at the start, and written where that has changed.

The file is written from time to time and at a stop, in a thread, so that a disk which hangs does not delay the lines.
What could not be written is written later. A power cut loses what happened since the last write.
"""

import asyncio
import sqlite3
from collections.abc import AsyncIterator, Callable, Iterable, Sequence
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any, Final, Generic, ParamSpec, Protocol, TypeVar
from zlib import crc32

from gateway.clock.beside import Work, beside, guarded
from gateway.clock.threads import in_thread
from gateway.errors import StateError
from gateway.events import Emit, StateDamaged
from gateway.state.database import Database, Opened, Row, Table, is_damage, open_table
from gateway.state.file_trouble import FileTrouble

P = ParamSpec("P")
T = TypeVar("T")
E = TypeVar("E")
E_co = TypeVar("E_co", covariant=True)

#: How often the file is written, in seconds.
WRITE_EVERY: Final = 60.0
#: How long the disk may take at the end, in seconds.
CLOSING_DEADLINE: Final = 1.0


class Changes(Protocol[E_co]):
    """Entries that a file does not have yet, and the keys of those that it has no longer to keep."""

    @property
    def written(self) -> Sequence[E_co]:
        """The entries."""

    @property
    def gone(self) -> Iterable[int]:
        """The keys."""


class Entries(Protocol[E]):
    """What is kept, in memory."""

    def load(self, entries: Iterable[E], /) -> None:
        """Add what an earlier run has kept."""

    def changes(self) -> Changes[E]:
        """Take what has changed since the last time."""

    def put_back(self, changes: Any, /) -> None:
        """Take back changes that could not be written."""

    def change_all(self) -> None:
        """Count all of it as changed: nothing of it is in the file any more."""


def numbered_texts(name: str, application: int, needed_by: str) -> Table:
    """Describe a table of texts by number."""
    return Table(
        name=name,
        columns=(("number", "INTEGER"), ("content", "TEXT")),
        keys=1,
        check_sum=_check_sum,
        application=application,
        version=1,
        needed_by=needed_by,
    )


def _check_sum(row: Row) -> int:
    number, content = row
    return crc32(f"{number}={content}".encode())


class RowFile(Generic[E]):
    """The file of `kept`, written each `pause()` seconds. Trouble is reported when it begins and when it ends.

    `read` makes an entry of a row, and raises ValueError for one of another version; `row` makes its row. Both are
    called in a thread.
    """

    def __init__(
        self,
        file: Path,
        table: Table,
        kept: Entries[E],
        emit: Emit,
        *,
        read: Callable[..., E],
        row: Callable[[E], Row],
        pause: Callable[[], float] = lambda: WRITE_EVERY,
    ) -> None:
        self._file = file
        self._table = table
        self._kept = kept
        self._emit = emit
        self._read = read
        self._row = row
        self._pause = pause
        self._database: Database | None = None
        #: While it is being opened, and if that was cancelled.
        self._opening: asyncio.Future[Opened] | None = None
        self._was_read = False
        self._tell = FileTrouble(file, emit).tell

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

    async def look(self, call: Callable[[Database | None], T]) -> T:
        """Call it in a thread with the database, or with None while that cannot be read."""
        database = self._database
        try:
            return await self._in_thread(call, database)
        except sqlite3.Error as error:
            if database is not None and is_damage(error):  # the next write sets it aside
                await self._in_thread(database.close)
                self._database = None if self._database is database else self._database
            self._tell(str(error))
            return await self._in_thread(call, None)

    async def close(self) -> None:
        """Write the rest and close the file, if it is open; give up after CLOSING_DEADLINE."""
        if self._database is None:
            await self._close_again()
            return
        try:
            async with asyncio.timeout(CLOSING_DEADLINE):
                await self._write(self._database)
                await self._in_thread(self._database.close)
        except TimeoutError:
            self._tell("the disk takes too long")
        except sqlite3.Error as error:
            self._tell(str(error))

    async def _open(self) -> Database:
        self._opening = asyncio.ensure_future(self._in_thread(open_table, self._file, self._table))
        opened = await asyncio.shield(self._opening)
        if opened.damage:
            self._emit(StateDamaged(str(self._file), opened.damage))
        if self._was_read:
            self._kept.change_all()
        else:
            self._kept.load(await self._in_thread(self._entries, opened.rows))
            self._was_read = True
        self._opening = None
        return opened.database

    async def _close_again(self) -> None:
        """Close what was being opened: another gateway may open it next. Wait for CLOSING_DEADLINE at most."""
        if self._opening is None:
            return
        with suppress(TimeoutError, StateError, sqlite3.Error):
            async with asyncio.timeout(CLOSING_DEADLINE):
                opened = await self._opening
                await self._in_thread(opened.database.close)

    def _entries(self, rows: Iterable[Row]) -> list[E]:
        entries = []
        for row in rows:
            with suppress(ValueError):  # written by a version that kept something else
                entries.append(self._read(*row))
        return entries

    async def _write(self, database: Database) -> None:
        changes = self._kept.changes()
        if not changes.written and not changes.gone:
            return
        try:
            await self._in_thread(self.save, database, changes)
        except BaseException as error:
            self._kept.put_back(changes)
            if is_damage(error):
                self._database = None
            raise

    def save(self, database: Database, changes: Changes[E]) -> None:
        """Write changes; close a file that is found to be damaged. Blocks.

        Raises:
            sqlite3.Error: the disk is full or fails.
        """
        try:
            self.put(database, changes)
        except sqlite3.DatabaseError as error:
            if is_damage(error):
                database.close()
            raise

    def put(self, database: Database, changes: Changes[E]) -> None:
        """Make rows of changes, and write them. Blocks.

        Raises:
            sqlite3.Error: the disk is full or fails.
        """
        database.write([self._row(each) for each in changes.written], [(number,) for number in changes.gone])

    async def _in_thread(self, call: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
        return await in_thread(self._table.name, call, *args, **kwargs)


@asynccontextmanager
async def growing(part: str, grow: Work, finish: Work, file: RowFile[Any] | None, emit: Emit) -> AsyncIterator[None]:
    """Let a `part` of the gateway `grow` and write its file inside the context; then `finish` it, and write the rest.

    A defect in it ends this part and nothing else.
    """
    works = {part: grow} if file is None else {part: grow, f"file of {part}": file.keep_writing}
    try:
        async with beside(works, emit):
            yield
    finally:
        await guarded(part, finish, emit)
        if file is not None:
            await file.close()
