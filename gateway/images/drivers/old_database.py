"""The file of the persistent images of earlier versions, which had a row in a database for each value.

All calls block.
"""

import errno
import os
from pathlib import Path
from typing import Final, NamedTuple
from zlib import crc32

from gateway.modbus.codes import Area
from gateway.state.database import Row, Table, open_table


class Found(NamedTuple):
    """The file and its rows: image, area, address, value. `damage` says what was wrong with it."""

    file: Path
    rows: tuple[tuple[str, Area, int, int], ...]
    damage: str


def _check_sum(row: Row) -> int:
    image, area, address, value = row
    return crc32(f"{image}/{area}/{address}={value}".encode())


_TABLE: Final = Table(
    name="items",
    columns=(("image", "TEXT"), ("area", "TEXT"), ("address", "INTEGER"), ("value", "INTEGER")),
    keys=3,
    check_sum=_check_sum,
    application=0x4D424757,  # "MBGW"
    version=1,
    needed_by="images that persist",
)


def find(folder: Path) -> Found | None:
    """Read the file in `folder`, if there is one. A damaged one is moved aside first.

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
    database, rows, damage = open_table(file, _TABLE)
    database.close()
    return Found(file, tuple((image, Area(area), address, value) for image, area, address, value in rows), damage)
