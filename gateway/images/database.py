"""The file of the persistent images: an SQLite database with a row for each item that was ever written.

Each row has a checksum, because SQLite does not detect a bit that a worn flash card has flipped. A file that is damaged
or from another program is moved aside, never overwritten; what can still be read of it is kept.

All calls block.
"""

import os
import sqlite3
from collections.abc import Iterable, Iterator
from contextlib import closing, suppress
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from threading import Lock
from typing import Final, NamedTuple
from zlib import crc32

from gateway.errors import StateError
from gateway.modbus.codes import Area
from gateway.ports.ownership import give_to_owner_of_folder

FILE_NAME: Final = "images.sqlite"

#: "MBGW", the application ID in the header of the file.
_APPLICATION: Final = 0x4D424757
_VERSION: Final = 1
_SET_UP: Final = f"""
    BEGIN IMMEDIATE;
    CREATE TABLE IF NOT EXISTS items (
        image TEXT NOT NULL, area TEXT NOT NULL, address INTEGER NOT NULL,
        value INTEGER NOT NULL, check_sum INTEGER NOT NULL,
        PRIMARY KEY (image, area, address)
    ) WITHOUT ROWID;
    PRAGMA application_id = {_APPLICATION};
    PRAGMA user_version = {_VERSION};
    COMMIT;
"""
#: Only this process can open the database, and a finished transaction is on the disk.
_OURS_ALONE: Final = "PRAGMA locking_mode = EXCLUSIVE"
_MODES: Final = """
    PRAGMA journal_mode = WAL;
    PRAGMA synchronous = FULL;
"""
#: The suffixes of a database's files.
_PARTS: Final = ("", "-wal", "-shm", "-journal")


class Item(NamedTuple):
    """One coil, input or register of the image called `image`."""

    image: str
    area: Area
    address: int
    value: int

    @property
    def check_sum(self) -> int:
        """The checksum of the row."""
        return crc32(f"{self.image}/{self.area}/{self.address}={self.value}".encode())


class Database:
    """An open file. No second process can open it meanwhile."""

    def __init__(self, connection: sqlite3.Connection) -> None:
        self._connection = connection
        self._turn = Lock()

    def write(self, items: Iterable[Item]) -> None:
        """Write all of the items or none; they are on the disk when this returns.

        Raises:
            sqlite3.Error: the disk is full or fails.
        """
        rows = [(*item, item.check_sum) for item in items]
        with self._turn, self._connection:
            self._connection.execute("BEGIN IMMEDIATE")
            self._connection.executemany("INSERT OR REPLACE INTO items VALUES (?, ?, ?, ?, ?)", rows)

    def close(self) -> None:
        """Close the file."""
        with self._turn, suppress(sqlite3.Error):  # the next start repairs it
            self._connection.close()


class Opened(NamedTuple):
    """An open database and what it holds. `damage` says what was wrong with it, in words; empty if nothing was."""

    database: Database
    items: tuple[Item, ...]
    damage: str = ""


def open_database(folder: Path) -> Opened:
    """Open or create the database in `folder`. A damaged one is moved aside first.

    Raises:
        StateError: it is in use or from a later version, or it cannot be read, made or moved.
    """
    file = folder / FILE_NAME
    try:
        folder.mkdir(parents=True, exist_ok=True)
        return _open(file)
    except sqlite3.Error as error:
        raise StateError(_explain_permission(file) or f"{file}: {error}{_advice(error)}") from error
    except OSError as error:
        raise StateError(f"{file}: {error.strerror}; images that persist need a folder to write in") from error


def _advice(error: sqlite3.Error) -> str:
    """What an operator can do about it."""
    code = getattr(error, "sqlite_errorcode", 0) & 0xFF  # the high bits are the extended error code
    if code == sqlite3.SQLITE_BUSY:
        return "; is another modbus-gateway running?"
    if code in {sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_READONLY}:
        return "; images that persist need a folder to write in"
    return ""


def _explain_permission(file: Path) -> str:
    """The message if a permission is missing; empty otherwise."""
    for part in filter(Path.exists, _parts(file)):
        if not os.access(part, os.R_OK | os.W_OK, effective_ids=True):
            return f"{part}: no permission to read and write it; as root: chown --reference={part.parent} {part}"
    return ""


def _parts(file: Path) -> Iterator[Path]:
    return (Path(f"{file}{part}") for part in _PARTS)


def _open(file: Path) -> Opened:
    items: list[Item] = []
    try:
        database = _load(file, items)
    except sqlite3.OperationalError:  # in use, no permission, disk full: the file may be good
        raise
    except sqlite3.DatabaseError as error:
        return _recreate(file, items, str(error))
    return Opened(database, tuple(items))


def _recreate(file: Path, items: list[Item], damage: str) -> Opened:
    aside = _move_aside(file)
    database = _load(file, [])
    database.write(items)
    return Opened(database, tuple(items), f"{damage}; it is now {aside}; {len(items)} values of it could be read")


def _move_aside(file: Path) -> Path:
    aside = file.with_name(f"{file.name}.{datetime.now(UTC):%Y%m%d-%H%M%S}")
    for part, part_aside in zip(_parts(file), _parts(aside), strict=True):
        with suppress(FileNotFoundError):
            part.rename(part_aside)
    return aside


def _load(file: Path, items: list[Item]) -> Database:
    """Open `file` and read it into `items`.

    Raises:
        sqlite3.OperationalError: it cannot be opened at the moment.
        sqlite3.DatabaseError: it is damaged, or from another program; `items` has what could be read.
    """
    if file.exists() and not file.stat().st_size:
        raise sqlite3.DatabaseError("it is empty")
    connection = sqlite3.connect(file, timeout=0, isolation_level=None, check_same_thread=False)
    connection.text_factory = partial(str, encoding="utf-8", errors="replace")
    try:
        connection.execute(_OURS_ALONE)
        is_new = _is_new(connection, file)
        connection.executescript(_MODES)  # which changes the file, so it must be ours
        if is_new:
            connection.executescript(_SET_UP)
        for part in filter(Path.exists, _parts(file)):
            give_to_owner_of_folder(part)
        _read(connection, items)
    except BaseException:
        connection.close()
        raise
    return Database(connection)


def _is_new(connection: sqlite3.Connection, file: Path) -> bool:
    """Whether the file is still empty. Otherwise it must be of this program and version."""
    application, version, tables = (
        connection.execute(question).fetchone()[0]
        for question in ("PRAGMA application_id", "PRAGMA user_version", "SELECT count(*) FROM sqlite_master")
    )
    if application == _APPLICATION and version > _VERSION:
        raise StateError(f"{file} was written by a later version of modbus-gateway; move it away to start without it")
    if tables and application != _APPLICATION:
        raise sqlite3.DatabaseError("it is a database of another program")
    return not tables


def _read(connection: sqlite3.Connection, items: list[Item]) -> None:
    wrong = 0
    with closing(connection.execute("SELECT image, area, address, value, check_sum FROM items")) as rows:
        for image, area, address, value, check_sum in rows:
            item = Item(image, area, address, value)
            if item.check_sum == check_sum:
                items.append(item._replace(area=Area(area)))
            else:
                wrong += 1
    if wrong:
        raise sqlite3.DatabaseError(f"{wrong} values have a wrong checksum")
    (verdict,) = connection.execute("PRAGMA quick_check(1)").fetchone()
    if verdict != "ok":
        raise sqlite3.DatabaseError(verdict)
