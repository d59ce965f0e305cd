"""The file of kept readings: a row for the records of a device in one interval. All calls block."""

import sqlite3
from collections.abc import Collection, Iterable, Iterator
from pathlib import Path
from typing import Final, Self
from zlib import crc32

from gateway.clock.slices import with_rests
from gateway.plant.kept.records import Chunk, Found, Totals, Written
from gateway.state.database import Database, Row, Table, open_table

#: How many rows are read at once.
_ROWS: Final = 100
_PAGE: Final = 4096
#: What the journal takes at least, and the most bytes that are written at once.
_JOURNAL: Final = 40_960
_LARGEST_PART: Final = 262_144
#: How many pages change with a row that is deleted.
_PAGES_OF_ROW: Final = 2
#: What a row takes beside device and content, and more than any has of readings.
_ROW: Final = 40
_MOST_READINGS: Final = 100_000


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


class KeptFile:
    """An open file that takes at most `most` bytes, its journal included."""

    def __init__(self, database: Database, most: int) -> None:
        self._database = database
        #: The most bytes of its rows, of those that are written at once, and how many are deleted at once.
        self.room = most - max(most // 8, _JOURNAL)
        self._part = min(max(_PAGE, most // 32), _LARGEST_PART)
        self._rows = max(1, self._part // (_PAGES_OF_ROW * _PAGE))
        #: Numbers are never used again while it is open.
        self._last = _number(database.ends()[1])
        database.limit_journal(max(1, self._part // _PAGE))

    @classmethod
    def open(cls, path: Path, most: int) -> tuple[Self, str]:
        """Open or make the file; the text says what was wrong with it, and is empty if nothing was.

        Raises:
            StateError: it cannot be opened or made.
            sqlite3.Error: it cannot be read.
        """
        opened = open_table(path, TABLE)
        try:
            return cls(opened.database, most), opened.damage
        except sqlite3.Error:
            opened.database.close()
            raise

    def readings(self) -> int:
        """Add up the readings of all rows.

        Raises:
            sqlite3.Error: the disk or the file fails.
        """
        return self._database.total("readings")

    def totals(self) -> Totals:
        """Look what it has.

        Raises:
            sqlite3.Error: the disk or the file fails.
        """
        first, last = self._database.ends()
        if first is None:
            return Totals(size=self._database.size)
        since = next((row[2] for row in self._database.find([(first,)])), None)
        return Totals(since, _number(last), self._database.size)

    def write(self, chunks: Iterable[Chunk], gone: Collection[int], done: Written) -> None:
        """Give chunks a row each, which keep a number that they have; delete rows; and old ones if there is no room.

        `done` gets what is on the disk, also if this fails halfway.

        Raises:
            sqlite3.Error: the disk is full or fails.
        """
        numbers = sorted(gone)
        for begin in range(0, len(numbers), self._rows):
            part_gone = numbers[begin : begin + self._rows]
            self._database.write((), [(number,) for number in part_gone])
            done.gone.update(part_gone)
            done.totals = self.totals()
        self._shrink(done)
        for part in self._parts(chunks):
            rows = [row for _, row in part]
            oldest = self._oldest(sum(map(_size, rows)))
            self._database.write(rows, [(number,) for number in oldest])
            self._last = max([self._last, *(row[0] for row in rows)])
            done.given_up += oldest.items()
            done.chunks += [(chunk, row[0]) for chunk, row in part]
            done.totals = self.totals()

    def after(self, number: int) -> Found:
        """Read the next chunks after this number.

        Raises:
            sqlite3.Error: the disk or the file fails.
        """
        rows = self._database.after(number, _ROWS)
        found = Found(_number(rows[-1][0][0]) if len(rows) == _ROWS else self._last)
        for row, is_sound in with_rests(rows):
            number, device, _, readings, content = row
            try:
                found.chunks.append(Chunk.unpack(number, device, content if is_sound else b""))
            except ValueError:
                found.damaged[number] = _count(readings)
        return found

    def close(self) -> None:
        """Close the file."""
        self._database.close()

    def _parts(self, chunks: Iterable[Chunk]) -> Iterator[list[tuple[Chunk, Row]]]:
        """Yield the rows of chunks, so many at a time that they do not make the journal large; at least one time."""
        part: list[tuple[Chunk, Row]] = []
        size, last = 0, self._last
        for chunk in with_rests(chunks):
            number = chunk.number
            if number is None:
                number = last = last + 1
            row = (number, chunk.device, chunk.at, chunk.values, chunk.pack())
            if part and size + _size(row) > self._part:
                yield part
                part, size = [], 0
            part.append((chunk, row))
            size += _size(row)
        yield part

    def _shrink(self, done: Written) -> None:
        """Give up the oldest if the file may take less than before, a few at a time: only then is the room seen."""
        while (excess := self._database.size - self.room) > 0:
            oldest = self._oldest(min(excess, _LARGEST_PART) - excess)
            if not oldest:
                return
            self._database.write((), [(number,) for number in oldest])
            done.given_up += oldest.items()
            done.totals = self.totals()

    def _oldest(self, needed: int) -> dict[int, int]:
        """Return the oldest rows that must go to have room for so many bytes, with their readings."""
        oldest: dict[int, int] = {}
        room, last = self.room - self._database.size, 0
        while room < needed and (rows := self._database.after(last, _ROWS)):
            for row, _ in rows:
                last = row[0]
                if room < needed:
                    oldest[last] = _count(row[3])
                    room += _size(row) - _ROW
        return oldest


def _number(value: object) -> int:
    return value if isinstance(value, int) else 0


def _count(readings: object) -> int:
    """Return the readings of a row, which may be damaged."""
    return readings if isinstance(readings, int) and 0 < readings < _MOST_READINGS else 0


def _size(row: Row) -> int:
    """Return about how many bytes a row takes."""
    return _ROW + len(row[1]) + len(row[4])
