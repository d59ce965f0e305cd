"""The values of persistent images on the disk, also in the file of an earlier version. All calls block."""

import errno
import json
import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final, NamedTuple
from zlib import crc32

from gateway.modbus.codes import Area
from gateway.state.database import Row, Table, open_table
from gateway.state.page_log import PageLog

_NAME: Final = "images"
#: The file that each write changes.
LOG: Final = f"{_NAME}.log"
#: The most values in a record: with the longest name of an image it fits into a page.
_MOST_IN_A_RECORD: Final = 128

#: Values by image and area, then by address.
Values = dict[tuple[str, Area], dict[int, int]]


def add(to: Values, *more: Values) -> Values:
    """Add values to `to`, and return it; later ones replace earlier ones."""
    for each in more:
        for table, values in each.items():
            to.setdefault(table, {}).update(values)
    return to


class SavedValues:
    """The open files, locked against other processes."""

    def __init__(self, log: PageLog, old: Path | None) -> None:
        """Use this log; `old` is the file of an earlier version with these values."""
        self._log = log
        self._old = old

    def write(self, values: Values, kept: Values) -> None:
        """Write all of the values or none; on return they are on the disk. `kept` are all earlier values.

        Raises:
            OSError: they cannot be written.
            StateError: another process has the files open.
        """
        self._log.write(_records(values, {}), lambda: _records(kept, values))
        if self._old is not None:
            self._old.rename(f"{self._old}.old")
            self._old = None

    def close(self) -> None:
        """Close the files."""
        self._log.close()


class Opened(NamedTuple):
    """Open files and their values. `damage` describes a fault of the files; empty if there was none."""

    saved: SavedValues
    values: Values
    damage: str = ""


def open_saved(folder: Path) -> Opened:
    """Read the values in `folder`, else those of an earlier version. Nothing is written yet.

    Raises:
        StateError: another process has them open, or a later version has written them.
        OSError: they cannot be read.
    """
    log = PageLog(folder / _NAME)
    records, damage = log.open()
    old = None if records or damage else find_old(folder)
    values: Values = {}
    if old is None:
        for record in records:
            image, area, start, content = json.loads(record)
            add(values, {(image, Area(area)): dict(enumerate(content, start))})
        return Opened(SavedValues(log, None), values, damage)
    for image, area, address, value in old.rows:
        add(values, {(image, area): {address: value}})
    return Opened(SavedValues(log, old.file), values, old.damage)


def _records(kept: Values, changed: Values) -> Iterator[bytes]:
    """Encode each run of neighbours as a record: `["shift-data","holding",5,[7,8,9]]` from address 5 on."""
    for image, area in sorted(kept.keys() | changed.keys()):
        values = kept.get((image, area), {}) | changed.get((image, area), {})
        for run in _runs(sorted(values)):
            content = [image, area, run[0], [values[address] for address in run]]
            yield json.dumps(content, ensure_ascii=False, separators=(",", ":")).encode()


def _runs(addresses: Iterable[int]) -> Iterator[list[int]]:
    run: list[int] = []
    for address in addresses:
        if run and (address != run[-1] + 1 or len(run) == _MOST_IN_A_RECORD):
            yield run
            run = []
        run.append(address)
    if run:
        yield run


class OldFile(NamedTuple):
    """The file of an earlier version: a database with a row for each value: image, area, address, value.

    `damage` describes its fault; empty if there was none.
    """

    file: Path
    rows: tuple[tuple[str, Area, int, int], ...]
    damage: str


def _check_sum(row: Row) -> int:
    image, area, address, value = row
    return crc32(f"{image}/{area}/{address}={value}".encode())


#: The table of earlier versions.
OLD_TABLE: Final = Table(
    name="items",
    columns=(("image", "TEXT"), ("area", "TEXT"), ("address", "INTEGER"), ("value", "INTEGER")),
    keys=3,
    check_sum=_check_sum,
    application=0x4D424757,  # "MBGW"
    version=1,
    needed_by="images that persist",
)


def find_old(folder: Path) -> OldFile | None:
    """Read the file of an earlier version in `folder`, if there is one. A damaged one is moved aside first.

    Raises:
        StateError: it is in use or from a later version, or it cannot be read or moved.
        OSError: it is a link, or cannot be written: SQLite writes to what it opens.
    """
    file = folder / "images.sqlite"
    if not file.is_file():
        return None
    if file.is_symlink():
        raise OSError(errno.ELOOP, f"{file} is a symbolic link, which is not followed; remove it")
    for place in (folder, file):
        if not os.access(place, os.R_OK | os.W_OK, effective_ids=True):
            raise OSError(errno.EACCES, f"the values of {file} cannot be taken over: {place} cannot be written")
    database, rows, damage = open_table(file, OLD_TABLE)
    database.close()
    return OldFile(file, tuple((image, Area(area), address, value) for image, area, address, value in rows), damage)
