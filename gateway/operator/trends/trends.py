"""The trends of all points: what is heard in the present slot, and the pieces that the file does not have yet."""

from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from hashlib import blake2b
from math import nan
from typing import Final, NamedTuple

from gateway.clock.slices import with_rests
from gateway.operator.trends.table import Entry, Key, Pieces, read
from gateway.profiles.point import Point
from gateway.state.database import Database
from gateway.timing.trend import Layout, Means, Piece, Slot, mean_of, merge, put

#: The most pieces in memory, while the disk fails or there is no file: the oldest blocks are dropped.
MOST_PIECES: Final = 20_000


class Trends:
    """What the file of trends does not have yet. A trend is known by the number that `key_of` makes."""

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        #: The time of the last look, in seconds since 1970.
        self.time = 0.0
        self._slot = 0
        #: By slot and trend: least, greatest, sum and number of values, of the present slot and of ended ones.
        self._heard: dict[int, dict[int, list[float]]] = {}
        self._fresh: dict[Key, Piece] = {}
        #: What was taken last: the file may not have it yet.
        self._taken: Pieces = {}

    def at(self, time: float) -> Iterator[None]:
        """Note the time, in seconds since 1970: what is added from now on was heard then.

        Yields while ended slots are put into their pieces.
        """
        self.time, self._slot = time, self.layout.slot_at(time)
        for slot in self._heard.keys() - {self._slot}:
            yield from self._end(slot)
        self._drop_oldest()

    def add(self, key: int, number: float) -> None:
        """Add a value to a trend."""
        values = self._heard.setdefault(self._slot, {}).get(key)
        if values is None:
            self._heard[self._slot][key] = [number, number, number, 1]
            return
        if number < values[0]:
            values[0] = number
        elif number > values[1]:
            values[1] = number
        values[2] += number
        values[3] += 1

    def add_past(self, time: float, key: int, numbers: Sequence[float]) -> None:
        """Add values that were heard of a trend in the slot at a `time` before now, in seconds since 1970."""
        piece = self._fresh.setdefault((self.layout.block_at(time), key), self.layout.piece())
        put(
            piece,
            self.layout.place(self.layout.slot_at(time)),
            _numbers((min(numbers), max(numbers), sum(numbers), len(numbers))),
        )

    def end(self) -> None:
        """Put all that was heard into its pieces, to be written."""
        for slot in tuple(self._heard):
            for _ in self._end(slot):
                pass

    def load(self, _entries: Iterable[Entry]) -> None:
        """Add nothing: what the file has stays there."""

    def change_all(self) -> None:
        """Change nothing: what a damaged file had is lost."""

    def changes(self) -> "Taken":
        """Take the pieces that the file does not have yet."""
        self._taken, self._fresh = self._fresh, {}
        return Taken(tuple(self._taken.items()))

    def put_back(self, taken: "Taken") -> None:
        """Take back pieces that could not be written."""
        fresh, self._fresh, self._taken = self._fresh, dict(taken.written), {}
        for key, piece in fresh.items():
            merge(self._fresh.setdefault(key, self.layout.piece()), piece)

    def newest(self) -> "Newest":
        """Return what the file may not have yet, up to the present; it may grow a little while it is read."""
        heard = {slot: dict(values) for slot, values in self._heard.items()}
        return Newest(self.layout, dict(self._taken), dict(self._fresh), heard)

    def _end(self, slot: int) -> Iterator[None]:
        """Put what was heard in a slot into its pieces, one by one."""
        block, place = self.layout.block_at(slot), self.layout.place(slot)
        for key, values in self._heard[slot].items():
            put(self._fresh.setdefault((block, key), self.layout.piece()), place, _numbers(values))
            yield
        del self._heard[slot]

    def _drop_oldest(self) -> None:
        while len(self._fresh) > MOST_PIECES and len(blocks := {block for block, _ in self._fresh}) > 1:
            oldest = min(blocks)
            self._fresh = {key: piece for key, piece in self._fresh.items() if key[0] != oldest}


class Taken(NamedTuple):
    """Pieces that a file does not have yet."""

    written: Sequence[Entry]
    gone: tuple[int, ...] = ()


class Newest(NamedTuple):
    """What a file of trends may not have yet: pieces that were taken, later ones, and values by slot and trend."""

    layout: Layout
    taken: Pieces
    fresh: Pieces
    heard: Mapping[int, Mapping[int, Sequence[float]]]

    def slots(self, database: Database | None, key: int, since: float, until: float) -> list[Slot]:
        """Collect the slots of a trend that begin from `since` on and before `until`; blocks.

        Raises:
            sqlite3.Error: the disk or the file fails.
        """
        blocks = range(self.layout.block_at(since), int(until) + 1, self.layout.block)
        pieces = sorted(self._pieces(database, [(block, key) for block in blocks]).items())
        found = (slot for (block, _), piece in pieces for slot in self.layout.within(block, piece))
        return [slot for slot in found if since <= slot.time < until]

    def means(self, database: Database | None, since: int, count: int) -> Mapping[int, Means]:
        """Collect the means of `count` slots from `since` on of all trends; blocks, and rests.

        They are no objects of their own: of 10 000 points there are 600 000 in an hour.

        Raises:
            sqlite3.Error: the disk or the file fails.
        """
        found: dict[int, Means] = {}
        for block in range(self.layout.block_at(since), since + count * self.layout.step, self.layout.block):
            for (_, key), piece in with_rests(self._pieces(database, [(block,)]).items()):
                for slot in self.layout.within(block, piece):
                    place = (slot.time - since) // self.layout.step
                    if 0 <= place < count:
                        found.setdefault(key, array("d", [nan]) * count)[place] = slot.mean
        return found

    def _pieces(self, database: Database | None, wanted: Sequence[tuple[int, ...]]) -> dict[Key, Piece]:
        """Collect the pieces with these keys or first parts of a key."""
        pieces = {} if database is None else dict(read(database, self.layout, wanted))
        for place, piece in with_rests(self._not_written(wanted)):
            merge(pieces.setdefault(place, self.layout.piece()), piece)
        return pieces

    def _not_written(self, wanted: Sequence[tuple[int, ...]]) -> Iterator[tuple[Key, Piece]]:
        """Yield the pieces with these keys or first parts of a key, earlier ones first."""
        is_other = frozenset(wanted).isdisjoint
        for pieces in (self.taken, self.fresh):
            yield from (each for each in pieces.items() if not is_other((each[0], each[0][:1])))
        for slot, values in self.heard.items():
            block, place = self.layout.block_at(slot), self.layout.place(slot)
            for key, heard in values.items():
                if not is_other(((block, key), (block,))):
                    piece = self.layout.piece()
                    put(piece, place, _numbers(heard))
                    yield (block, key), piece


def key_of(line: str, unit: int, device: str, point: Point) -> int:
    """Make the number of the trend of a point. One that means anything else begins another trend.

    `unit` is the one on the wire in the config.
    """
    meaning = (
        point.name,
        str(point.area),
        point.address,
        point.type,
        point.swap,
        point.count,
        point.scale,
        point.offset,
    )
    more = (point.unit, point.invalid, point.bits, point.scale_at, point.width, sorted(point.labels.items()))
    digest = blake2b(repr((line, unit, device, *meaning, *more)).encode(), digest_size=8).digest()
    return int.from_bytes(digest, "big", signed=True)


def _numbers(values: Sequence[float]) -> tuple[float, float, float]:
    """Compute least, mean and greatest value of a slot."""
    least, greatest, total, count = values
    return least, mean_of(total, count, least, greatest), greatest
