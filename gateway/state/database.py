"""An SQLite database with one table in the state folder, for one process at a time.

Each row has a checksum, because SQLite does not detect a bit that a worn flash card has flipped. A file that is damaged
or from another program is moved aside as it is, never overwritten; rows that can still be read are kept.

All calls block.
"""

import os
import sqlite3
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from threading import Lock
from typing import Any, Final, NamedTuple

from gateway.errors import StateError
from gateway.state.files import give_to_owner_of_folder

#: Only this process can open the database, and a finished transaction is on the disk.
_OURS_ALONE: Final = "PRAGMA locking_mode = EXCLUSIVE"
_MODES: Final = """
    PRAGMA journal_mode = WAL;
    PRAGMA synchronous = FULL;
"""
#: The suffixes of a database's files.
_PARTS: Final = ("", "-wal", "-shm", "-journal")

#: The columns of a row, without its checksum.
Row = tuple[Any, ...]


@dataclass(frozen=True, slots=True)
class Table:
    """The one table of a database: name and SQL type of its `columns`, the first `keys` of which are the primary key.

    `check_sum` computes the checksum that is kept beside a row. `application` and `version` are in the header of the
    file. `needed_by` says in messages what the file is for, in the plural. The rows of one that `is_large` are not read
    when it is opened, and a damaged one is begun anew.
    """

    name: str
    columns: tuple[tuple[str, str], ...]
    keys: int
    check_sum: Callable[[Row], int]
    application: int
    version: int
    needed_by: str
    is_large: bool = False

    @property
    def set_up(self) -> str:
        """The statements that turn an empty file into this database."""
        columns = ", ".join(f"{name} {kind} NOT NULL" for name, kind in (*self.columns, ("check_sum", "INTEGER")))
        # Without a rowid a table is smaller, but a row of more than a fourth of a page then takes a page of its own.
        form = "" if self.is_large and self.keys == 1 else "WITHOUT ROWID"
        return f"""
            BEGIN IMMEDIATE;
            CREATE TABLE IF NOT EXISTS {self.name} ({columns}, PRIMARY KEY ({self._names(self.keys)})) {form};
            PRAGMA application_id = {self.application};
            PRAGMA user_version = {self.version};
            COMMIT;
        """

    @property
    def select(self) -> str:
        """The statement that reads all rows, with their checksums."""
        return f"SELECT {self._names()}, check_sum FROM {self.name}"  # noqa: S608 - the names are those of the program

    @property
    def insert(self) -> str:
        """The statement that writes a row and its checksum."""
        return f"INSERT OR REPLACE INTO {self.name} VALUES ({', '.join('?' * (len(self.columns) + 1))})"  # noqa: S608

    def select_by(self, parts: int) -> str:
        """Make the statement that reads the rows with these first parts of a key."""
        return f"{self.select} WHERE {self._key(parts)}"

    def delete_by(self, parts: int) -> str:
        """Make the statement that deletes the rows with these first parts of a key."""
        return f"DELETE FROM {self.name} WHERE {self._key(parts)}"  # noqa: S608 - as above

    @property
    def ends(self) -> str:
        """The statement that finds the least and the greatest first part of all keys."""
        key, table = self._names(1), self.name
        return f"SELECT (SELECT min({key}) FROM {table}), (SELECT max({key}) FROM {table})"  # noqa: S608 - as above

    @property
    def select_after(self) -> str:
        """The statement that reads the first rows whose first part of the key is greater."""
        return f"{self.select} WHERE {self._names(1)} > ? ORDER BY {self._names(1)} LIMIT ?"

    def sum_of(self, column: str) -> str:
        """Make the statement that adds up a column."""
        return f"SELECT sum({column}) FROM {self.name}"  # noqa: S608 - as above

    def _key(self, parts: int) -> str:
        return " AND ".join(f"{name} = ?" for name, _ in self.columns[:parts])

    def _names(self, count: int | None = None) -> str:
        return ", ".join(name for name, _ in self.columns[:count])


class Database:
    """An open database, which no second process can open."""

    def __init__(self, connection: sqlite3.Connection, table: Table) -> None:
        self._connection = connection
        self._table = table
        self._turn = Lock()

    def write(self, rows: Iterable[Row], gone: Iterable[Row] = ()) -> None:
        """Delete the rows with the keys `gone`, or with these first parts of a key, and write `rows`; or do nothing.

        It is on the disk on return.

        Raises:
            sqlite3.Error: the disk is full or fails.
        """
        written = [(*row, self._table.check_sum(row)) for row in rows]
        with self._turn, self._connection:
            self._connection.execute("BEGIN IMMEDIATE")
            for key in gone:
                self._connection.execute(self._table.delete_by(len(key)), key)
            self._connection.executemany(self._table.insert, written)

    def find(self, keys: Iterable[Row]) -> Iterator[Row]:
        """Yield the rows with these keys, or with these first parts of a key. Damaged ones are left out.

        Raises:
            sqlite3.Error: the disk or the file fails.
        """
        for key in keys:
            with self._turn:
                found = self._connection.execute(self._table.select_by(len(key)), key).fetchall()
            for *columns, check_sum in found:
                row = tuple(columns)
                if self._table.check_sum(row) == check_sum:
                    yield row

    def ends(self) -> tuple[Any, Any]:
        """Find the least and the greatest first part of all keys; None if there is no row.

        Raises:
            sqlite3.Error: the disk or the file fails.
        """
        with self._turn:
            least, greatest = self._connection.execute(self._table.ends).fetchone()
        return least, greatest

    def after(self, key: Any, most: int) -> list[tuple[Row, bool]]:
        """List the first rows, at most so many, whose first part of the key is greater, and whether each is sound.

        Raises:
            sqlite3.Error: the disk or the file fails.
        """
        with self._turn:
            found = self._connection.execute(self._table.select_after, (key, most)).fetchall()
        return [(tuple(row), self._table.check_sum(tuple(row)) == check_sum) for *row, check_sum in found]

    def total(self, column: str) -> int:
        """Add up a column of all rows.

        Raises:
            sqlite3.Error: the disk or the file fails.
        """
        with self._turn:
            (total,) = self._connection.execute(self._table.sum_of(column)).fetchone()
        return int(total or 0)

    def limit_journal(self, pages: int) -> None:
        """Write the journal into the file after so many pages.

        Raises:
            sqlite3.Error: the disk or the file fails.
        """
        with self._turn:
            self._connection.execute(f"PRAGMA wal_autocheckpoint = {pages:d}")

    @property
    def size(self) -> int:
        """The bytes that its rows take in the file.

        Raises:
            sqlite3.Error: the disk or the file fails.
        """
        questions = ("PRAGMA page_count", "PRAGMA freelist_count", "PRAGMA page_size")
        with self._turn:
            pages, free, size = (self._connection.execute(each).fetchone()[0] for each in questions)
        return int((pages - free) * size)

    def close(self) -> None:
        """Close the file."""
        with self._turn, suppress(sqlite3.Error):  # the next start repairs it
            self._connection.close()


class Opened(NamedTuple):
    """An open database and what it holds. `damage` says what was wrong with it, in words; empty if nothing was."""

    database: Database
    rows: tuple[Row, ...]
    damage: str = ""


def open_table(file: Path, table: Table) -> Opened:
    """Open or create the database `file`. A damaged one is moved aside first.

    Raises:
        StateError: it is in use or from a later version, or it cannot be read, made or moved.
    """
    for part in _parts(file):
        if part.is_symlink():  # SQLite would follow it, as root anywhere
            raise StateError(f"{part} is a symbolic link, which is not followed; remove it")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        return _open(file, table)
    except sqlite3.Error as error:
        raise StateError(_explain_permission(file) or f"{file}: {error}{_advice(error, table)}") from error
    except OSError as error:
        raise StateError(f"{file}: {error.strerror}; {table.needed_by} need a folder to write in") from error


def is_damage(error: BaseException) -> bool:
    """Tell whether a file is damaged or from another program, not just in use, without permission, or on a full disk.

    If the name of the table or of a column is damaged, SQLite finds no such name, or reports one that is not UTF-8.
    """
    if isinstance(error, sqlite3.OperationalError):
        return getattr(error, "sqlite_errorcode", None) == sqlite3.SQLITE_ERROR
    return isinstance(error, (sqlite3.DatabaseError, UnicodeDecodeError))


def _advice(error: sqlite3.Error, table: Table) -> str:
    """Say what an operator can do about it; empty if that is unknown."""
    code = getattr(error, "sqlite_errorcode", 0) & 0xFF  # the high bits are the extended error code
    if code == sqlite3.SQLITE_BUSY:
        return "; is another modbus-gateway running?"
    if code == sqlite3.SQLITE_FULL:
        return f"; {table.needed_by} need room on the disk"
    if code in {sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_READONLY}:
        return f"; {table.needed_by} need a folder to write in"
    return ""


def _explain_permission(file: Path) -> str:
    """Say which permission is missing; empty if none is."""
    for part in filter(Path.exists, _parts(file)):
        if os.statvfs(part).f_flag & os.ST_RDONLY:  # no owner could write there
            return f"{part}: its file system is read-only"
        if not os.access(part, os.R_OK | os.W_OK, effective_ids=True):
            return f"{part}: no permission to read and write it; as root: chown --reference={part.parent} {part}"
    return ""


def _parts(file: Path) -> Iterator[Path]:
    return (Path(f"{file}{part}") for part in _PARTS)


def _open(file: Path, table: Table) -> Opened:
    rows: list[Row] = []
    with ExitStack() as unless_used:
        try:
            database = _load(file, table, rows, unless_used)
        except (sqlite3.DatabaseError, UnicodeDecodeError) as error:
            if not is_damage(error):
                raise
            # Moved before it is closed: then SQLite does not write the log into it at the end.
            damage = f"{error}; it is now {_move_aside(file)}"
        else:
            unless_used.pop_all()
            return Opened(database, tuple(rows))
    return _recreate(file, table, rows, damage)


def _recreate(file: Path, table: Table, rows: list[Row], damage: str) -> Opened:
    with ExitStack() as unless_used:
        database = _load(file, table, [], unless_used)
        unless_used.pop_all()
    database.write(rows)
    kept = "it is begun anew" if table.is_large else f"{len(rows)} values of it could be read"
    return Opened(database, tuple(rows), f"{damage}; {kept}")


def _move_aside(file: Path) -> Path:
    aside = file.with_name(f"{file.name}.{datetime.now(UTC):%Y%m%d-%H%M%S}")
    for part, part_aside in zip(_parts(file), _parts(aside), strict=True):
        with suppress(FileNotFoundError):
            part.rename(part_aside)
    return aside


def _load(file: Path, table: Table, rows: list[Row], unless_used: ExitStack) -> Database:
    """Open `file` and read it into `rows`. `unless_used` closes it.

    Raises:
        sqlite3.DatabaseError: it is damaged, or from another program, as `is_damage` tells; `rows` has what could be
            read. Or it cannot be opened at the moment.
        StateError: a later version has written it.
        UnicodeDecodeError: it is damaged.
    """
    if not file.exists():
        unless_used.callback(_remove_empty, file)
    elif not file.stat().st_size:
        raise sqlite3.DatabaseError("it is empty")
    connection = sqlite3.connect(file, timeout=0, isolation_level=None, check_same_thread=False)
    unless_used.callback(connection.close)
    connection.text_factory = partial(str, encoding="utf-8", errors="replace")
    connection.execute(_OURS_ALONE)
    is_new = _is_new(connection, file, table)
    connection.executescript(_MODES)  # which changes the file, so it must be ours
    if is_new:
        connection.executescript(table.set_up)
    for part in filter(Path.exists, _parts(file)):
        give_to_owner_of_folder(part)
    _read(connection, table, rows)
    return Database(connection, table)


def _remove_empty(file: Path) -> None:
    """Remove a file that could not be made, because the disk is full: the next attempt would set it aside."""
    with suppress(OSError):
        if not file.stat().st_size:
            file.unlink()


def _is_new(connection: sqlite3.Connection, file: Path, table: Table) -> bool:
    """Tell whether the database is still empty; if not, check its program and version.

    Raises:
        StateError: a later version has written it.
        sqlite3.DatabaseError: it is from another program.
    """
    application, version, tables = (
        connection.execute(question).fetchone()[0]
        for question in ("PRAGMA application_id", "PRAGMA user_version", "SELECT count(*) FROM sqlite_master")
    )
    if application == table.application and version > table.version:
        raise StateError(f"{file} was written by a later version of modbus-gateway; move it away to start without it")
    if tables and application != table.application:
        raise sqlite3.DatabaseError("it is a database of another program")
    return not tables


def _read(connection: sqlite3.Connection, table: Table, rows: list[Row]) -> None:
    wrong = 0
    with closing(connection.execute(f"{table.select}{' LIMIT 0' if table.is_large else ''}")) as stored:
        for *columns, check_sum in stored:
            row = tuple(columns)
            if table.check_sum(row) == check_sum:
                rows.append(row)
            else:
                wrong += 1
    if wrong:
        raise sqlite3.DatabaseError(f"{wrong} values have a wrong checksum")
    (verdict,) = connection.execute("PRAGMA quick_check(1)").fetchone()
    if verdict != "ok":
        raise sqlite3.DatabaseError(verdict)
