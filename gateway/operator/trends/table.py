"""The file of trends: a row for the piece of a point in a block of time, in the order in which they are written.

All calls block, and rest between slices of work: they are made in a thread, and the lines need the interpreter.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from typing import Final
from zlib import crc32

from gateway.clock.slices import with_rests
from gateway.state.database import Database, Row, Table
from gateway.timing.trend import LOG_BYTES, MOST_BYTES, Layout, Piece, merge, pack, unpack

#: The block and the number of a trend.
Key = tuple[int, int]
Entry = tuple[Key, Piece]
Pieces = Mapping[Key, Piece]

#: How many old blocks are dropped at most when new ones are written: a clock that is wrong for a while spoils no more.
_MOST_DROPPED: Final = 6


def _check_sum(row: Row) -> int:
    block, key, content = row
    return crc32(content, crc32(f"{block} {key}".encode())) - 2**31  # as four bytes


TABLE: Final = Table(
    name="pieces",
    columns=(("block", "INTEGER"), ("trend", "INTEGER"), ("content", "BLOB")),
    keys=2,
    check_sum=_check_sum,
    application=0x4D424754,  # "MBGT"
    version=1,
    needed_by="trends",
    is_large=True,
)


def row_of(piece: Entry) -> Row:
    """Make the row of a piece."""
    return (*piece[0], pack(piece[1]))


def entry(layout: Layout, block: int, key: int, content: bytes) -> Entry:
    """Read what `row_of` has made.

    Raises:
        ValueError: it has not, or for another layout.
    """
    return (block, key), unpack(content, layout)


def read(database: Database, layout: Layout, keys: Iterable[Row]) -> Iterator[Entry]:
    """Yield the pieces with these keys, or of whole blocks.

    Raises:
        sqlite3.Error: the disk or the file fails.
    """
    for row in with_rests(database.find(keys)):
        with suppress(ValueError):  # written by a version with another layout
            yield entry(layout, *row)


def write(database: Database, layout: Layout, pieces: Sequence[Entry], now: float) -> None:
    """Write pieces, together with what the file has of the same blocks; then drop what is too old, or too much.

    Raises:
        sqlite3.Error: the disk is full, or fails.
    """
    merged = dict(read(database, layout, [key for key, _ in pieces]))
    for key, piece in with_rests(pieces):
        if key in merged:
            merge(merged[key], piece)
        else:
            merged[key] = piece
    database.write([row_of(each) for each in with_rests(sorted(merged.items()))])
    for _ in range(_MOST_DROPPED):
        block = _surplus(database, layout, now)
        if block is None:
            break
        database.write((), [(block,)])


def _surplus(database: Database, layout: Layout, now: float) -> int | None:
    """Find a block that is too old, or the oldest if there is no room; None if all can stay."""
    oldest, newest = database.ends()
    if oldest is None or oldest == newest:
        return None
    if oldest + layout.block <= now - layout.kept:
        return int(oldest)
    if database.size <= MOST_BYTES - LOG_BYTES:
        return None
    return int(newest if newest > now + layout.kept else oldest)
