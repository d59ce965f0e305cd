"""The file of kept readings: a row for the records of a device in one interval. All calls block."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Self
from zlib import crc32

from gateway.plant.kept.records import Chunk
from gateway.state.database import Database, Row, Table, open_table

#: How many rows are read at once.
_ROWS: Final = 100
#: The share of these that is given up at once.
_GIVEN_UP: Final = 1 / 8
_PAGE: Final = 4096


def _check_sum(row: Row) -> int:
    number, device, at, readings, content = row
    content = content if isinstance(content, bytes) else b""  # a damaged one may be anything
    return crc32(content, crc32(f"{number} {device} {at} {readings}".encode()))


TABLE: Final = Table(
    name="kept",
    columns=(("number", "INTEGER"), ("device", "TEXT"), ("at", "REAL"), ("readings", "INTEGER"), ("content", "BLOB")),
    keys=1,
    check_sum=_check_sum,
    application=0x4D42474B,  # "MBGK"
    version=1,
    needed_by="kept readings",
    is_large=True,
)


@dataclass(frozen=True, slots=True)
class Totals:
    """What the file has: `readings`, the first of them at the Unix time `since`, numbers up to `end`, and its size."""

    readings: int = 0
    since: float | None = None
    end: int = 0
    size: int = 0


class KeptFile:
    """An open file that takes at most `most` bytes, its journal included."""

    def __init__(self, database: Database, most: int) -> None:
        self._database = database
        #: How many bytes its rows may take.
        self.room = most - most // 8
        #: Numbers are never used again while it is open.
        self._last: int = database.ends()[1] or 0
        database.limit_journal(max(1, most // 16 // _PAGE))

    @classmethod
    def open(cls, path: Path, most: int) -> tuple[Self, str]:
        """Open or make the file; the text says what was wrong with it, and is empty if nothing was.

        Raises:
            StateError: it cannot be opened or made.
            sqlite3.Error: it cannot be read.
        """
        opened = open_table(path, TABLE)
        return cls(opened.database, most), opened.damage

    def totals(self) -> Totals:
        """Look what it has.

        Raises:
            sqlite3.Error: the disk or the file fails.
        """
        first, last = self._database.ends()
        if first is None:
            return Totals(size=self._database.size)
        since = next((row[2] for row in self._database.find([(first,)])), None)
        return Totals(self._database.total("readings"), since, last, self._database.size)

    def write(self, chunks: Sequence[Chunk], gone: Collection[int]) -> int:
        """Give chunks a number and a row each, and delete rows; return how many old readings were given up for them.

        Raises:
            sqlite3.Error: the disk is full or fails.
        """
        numbered = list(enumerate(chunks, self._last + 1))
        rows = [(number, chunk.device, chunk.at, chunk.readings, chunk.pack()) for number, chunk in numbered]
        self._database.write(rows, [(number,) for number in gone])
        for number, chunk in numbered:
            self._last = chunk.number = number
        return self._give_up_oldest()

    def after(self, number: int) -> tuple[list[Chunk], int, int]:
        """Read the next chunks after this number; return them, up to which number, and how many readings are damaged.

        Raises:
            sqlite3.Error: the disk or the file fails.
        """
        chunks, damaged = [], 0
        for row, is_sound in self._database.after(number, _ROWS):
            number, device, _, readings, content = row
            try:
                chunks.append(Chunk.unpack(number, device, content if is_sound else b""))
            except ValueError:
                damaged += readings if isinstance(readings, int) else 0
        return chunks, number, damaged

    def close(self) -> None:
        """Close the file."""
        self._database.close()

    def _give_up_oldest(self) -> int:
        given_up = 0
        while self._database.size > self.room:
            oldest = self._database.after(0, _ROWS)
            if not oldest:
                break
            rows = [row for row, _ in oldest[: max(1, round(len(oldest) * _GIVEN_UP))]]
            self._database.write((), [(row[0],) for row in rows])
            given_up += sum(row[3] for row in rows)
        return given_up
