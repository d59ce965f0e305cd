"""Readings of a device with their times, as they are kept. Times are Unix times in seconds."""

import json
import zlib
from dataclasses import dataclass, field
from itertools import groupby
from typing import Final, Self

from gateway.plant.messages import Readings, Record
from gateway.timing.clock_setting import ClockSetting

#: The beginning of November 2026: a clock that shows less was never set.
_PAST: Final = 1_793_491_200.0


@dataclass(slots=True, eq=False)
class Chunk:
    """Records of one device, made under one setting of the clock: a row of the file, whose `number` it has.

    `readings` counts its values that are not told yet; the first `told` records are. `is_loaded`: it is among those to
    be sent next. `is_over`: all of it was told, or given up.
    """

    device: str
    clock: ClockSetting
    records: list[Record] = field(default_factory=list)
    number: int | None = None
    readings: int = 0
    told: int = 0
    is_loaded: bool = False
    is_over: bool = False

    def __post_init__(self) -> None:
        self.readings = _values(self.records)

    @property
    def at(self) -> float:
        """The time of its first record."""
        return self.records[0].at

    @property
    def values(self) -> int:
        """How many values its records have."""
        return _values(self.records)

    def add(self, readings: Readings) -> None:
        """Add readings, as one record for each time."""
        in_order = sorted(readings.items(), key=lambda item: item[1].at)
        for at, items in groupby(in_order, key=lambda item: item[1].at):
            self.records.append(Record(at, {name: reading.value for name, reading in items}))
        self.readings += len(readings)

    def sort(self) -> None:
        """Put the records in order: what a lost connection did not confirm is older than what was kept before."""
        self.records.sort(key=lambda record: record.at)

    def tell(self, count: int) -> int:
        """Note that so many more records are told; return how many values they have."""
        values = _values(self.records[self.told : self.told + count])
        self.told += count
        self.readings -= values
        self.is_over = self.told == len(self.records)
        return values

    def shorten(self) -> None:
        """Leave out the records that are told."""
        del self.records[: self.told]
        self.told = 0

    def as_sent(self, record: Record, now: ClockSetting) -> Record:
        """Return a record of it with whether its time may be wrong, as the clock is set `now`."""
        is_unsure = record.at < _PAST or now.differs(self.clock)
        return Record(record.at, record.values, is_unsure)

    def pack(self) -> bytes:
        """Make the content of its row."""
        records = [[record.at, record.values] for record in self.records]
        return zlib.compress(json.dumps({"clock": self.clock, "records": records}, separators=(",", ":")).encode())

    @classmethod
    def unpack(cls, number: int, device: str, content: bytes) -> Self:
        """Read what `pack` has made.

        Raises:
            ValueError: it has not.
        """
        try:
            told = json.loads(zlib.decompress(content))
            boot, ahead, is_set = told["clock"]
            records = [Record(float(at), dict(values)) for at, values in told["records"]]
        except (zlib.error, KeyError, TypeError) as error:
            raise ValueError(f"row {number} is not understood: {error}") from None
        if not records:
            raise ValueError(f"row {number} has no records")
        return cls(device, ClockSetting(str(boot), float(ahead), bool(is_set)), records, number)


@dataclass(frozen=True, slots=True)
class Totals:
    """What the file has: the first reading of the Unix time `since`, None if it is empty, numbers up to `end`.

    `size` is what it takes, in bytes.
    """

    since: float | None = None
    end: int = 0
    size: int = 0


@dataclass(slots=True)
class Written:
    """What is on the disk now: chunks with their numbers, rows that are `gone` as asked for, and others given up.

    Of these there is the number and how many readings they had. `totals` is what the file has with all that.
    """

    totals: Totals

    chunks: list[tuple[Chunk, int]] = field(default_factory=list)
    gone: set[int] = field(default_factory=set)
    given_up: list[tuple[int, int]] = field(default_factory=list)


@dataclass(slots=True)
class Found:
    """Chunks of the file with numbers up to `end`, and the numbers of rows that are `damaged`, with their readings."""

    end: int
    chunks: list[Chunk] = field(default_factory=list)
    damaged: dict[int, int] = field(default_factory=dict)


def _values(records: list[Record]) -> int:
    return sum(len(record.values) for record in records)
