"""The file of the persistent images: a database with a row for each item that was ever written. All calls block."""

from pathlib import Path
from typing import Final, NamedTuple
from zlib import crc32

from gateway.modbus.codes import Area
from gateway.ports.database import Database, Row, Table, open_table

FILE_NAME: Final = "images.sqlite"


class Item(NamedTuple):
    """One coil, input or register of the image called `image`."""

    image: str
    area: Area
    address: int
    value: int


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
    database, rows, damage = open_table(folder / FILE_NAME, _TABLE)
    items = (Item(image, Area(area), address, value) for image, area, address, value in rows)
    return Opened(database, tuple(items), damage)
