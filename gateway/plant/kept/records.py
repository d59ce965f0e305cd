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
    """Records of one device in order, made under one setting of the clock: a row of the file, whose `number` it has.

    `is_loaded`: it is among those to be sent next. `is_sent`: all of it was confirmed, or given up. `is_in_file`: the
    file has it, and it counts no longer as in memory.
    """

    device: str
    clock: ClockSetting
    records: list[Record] = field(default_factory=list)
    number: int | None = None
    is_loaded: bool = False
    is_sent: bool = False
    is_in_file: bool = False

    @property
    def at(self) -> float:
        """The time of its first record."""
        return self.records[0].at

    @property
    def readings(self) -> int:
        """The number of its values."""
        return sum(len(record.values) for record in self.records)

    def add(self, readings: Readings) -> None:
        """Add readings, as one record for each time."""
        in_order = sorted(readings.items(), key=lambda item: item[1].at)
        for at, items in groupby(in_order, key=lambda item: item[1].at):
            self.records.append(Record(at, {name: reading.value for name, reading in items}))

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
        return cls(device, ClockSetting(str(boot), float(ahead), bool(is_set)), records, number)
