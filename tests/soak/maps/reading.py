"""What a read of a map may be answered.

- A value is one that its source told within `stale`, all registers of a row at one moment; after an acknowledged write
  through a map or a mirror, one that was told later.
- Another value only of a row that is not fresh, and as the row says: the last one, or a number.
- A fresh bit is 1 only if all rows of the device may be fresh, and 0 only if one may be stale. An age is that of the
  last answered poll.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import floor, inf
from typing import Final, Protocol

from gateway.modbus.codes import EXCEPTION_BIT, Area
from gateway.registers.items import unpack_bits
from soak.dated import Write
from soak.judge import NO_ANSWER, words
from soak.maps.devices import MapDevice
from soak.maps.polls_seen import A_MOMENT, DeviceSeen
from soak.maps.random_rows import RandomMap
from soak.maps.rows import BITS, Row

_READ: Final = {Area.COILS: 1, Area.DISCRETE: 2, Area.HOLDING: 3, Area.INPUT: 4}
_NEVER: Final = 0xFFFF
_NO_ADDRESS: Final = 2
#: So long ago nothing was seen, in seconds.
_LONG: Final = 100.0


class Own:
    """An own register: what it holds. Writes whose clients left may be done at any time, or never."""

    def __init__(self) -> None:
        self.value = 0
        self.lost: set[int] = set()


class Done(Protocol):
    """A write through a unit with a map, to this area."""

    meaning: "Meaning"
    area: Area
    write: Write


@dataclass(eq=False)
class Meaning:
    """What a unit with a map means, from one reload to the next: its rows, its devices and their polls, by name.

    Nothing need be fresh before it is `settled_at`, when all that a reload began is over, and after the next one.
    """

    map: RandomMap
    devices: Mapping[str, MapDevice]
    own: Mapping[int, Own]
    seen: Mapping[str, DeviceSeen] = field(default_factory=dict)
    settled_at: float = inf

    def __post_init__(self) -> None:
        self.pieces: dict[Area, dict[int, object]] = {area: {} for area in Area}
        for row in self.map.rows:
            self.pieces[row.area] |= dict.fromkeys(range(row.at, row.end), row)
        bits = len(self.map.devices) if self.map.bits_area in BITS else 1
        self.pieces[self.map.bits_area] |= dict.fromkeys(range(self.map.bits_at, self.map.bits_at + bits), "fresh")
        self.pieces[Area.HOLDING] |= dict.fromkeys(self.map.ages, "age")
        self.pieces[Area.HOLDING] |= self.own

    def rows_of(self, device: str) -> list[Row]:
        """The rows of a device."""
        return [row for row in self.map.rows if row.source.device == device]

    def is_surely_fresh(self, row: Row, now: float) -> bool:
        """Whether the gateway must have a fresh value of a row."""
        return self.seen[row.source.device].is_surely_fresh(row, self.map.stale, self.settled_at, now)

    def is_surely_stale(self, row: Row, asked_at: float, now: float) -> bool:
        """Whether the gateway cannot have a fresh value of a row for who has asked then."""
        return self.seen[row.source.device].is_surely_stale(row, self.map.stale, asked_at, now)

    def is_surely_held(self, row: Row, now: float) -> bool:
        """Whether the gateway must have a last value of a row."""
        return self.seen[row.source.device].held(row, self.settled_at, now) is not None


@dataclass
class MapReading:
    """A read that is under way, the `order`th request of its client."""

    meaning: Meaning
    area: Area
    first: int
    items: int
    order: int
    asked_at: float
    #: What was seen: how many rows were fresh, held, filled with a number.
    outcomes: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        #: When the items of each device were written last, as it is when the read is asked for.
        self._written_at = {
            (row.source.device, row.source.area): tuple(
                self.meaning.devices[row.source.device].written_at[row.source.area]
            )
            for row in self.rows
        }

    @property
    def pdu(self) -> bytes:
        """The request."""
        return words(_READ[self.area], self.first, self.items)

    @property
    def _addresses(self) -> range:
        return range(self.first, self.first + self.items)

    def trouble(self, response: bytes, own: Sequence[Done], now: float) -> str | None:
        """Say what is wrong with an answer that has come now; `own` are the client's writes."""
        pieces = self.meaning.pieces[self.area]
        exists = all(address in pieces for address in self._addresses)
        if response[0] & EXCEPTION_BIT:
            return self._trouble_with(response[1], exists=exists, now=now)
        if not exists:
            return "that is not all there"
        size = (self.items + 7) // 8 if self.area in BITS else 2 * self.items
        if response[:2] != bytes((_READ[self.area], size)) or len(response) != 2 + size:
            return "that is no answer to it"
        if self.area in BITS:
            values = list(unpack_bits(response[2:], self.items))
        else:
            values = [int.from_bytes(response[at : at + 2]) for at in range(2, 2 + size, 2)]
        return next(self._troubles(values, own, now), None)

    @property
    def rows(self) -> list[Row]:
        """The rows that it touches."""
        pieces = self.meaning.pieces[self.area]
        found = dict.fromkeys(pieces.get(address) for address in self._addresses)
        return [row for row in found if isinstance(row, Row)]

    def _trouble_with(self, code: int, *, exists: bool, now: float) -> str | None:
        if not exists:
            return None if code == _NO_ADDRESS else "it is 02"
        if code != NO_ANSWER:
            return "nobody answers that"
        if self.asked_at < self.meaning.settled_at or any(self._may_be_refused(row, now) for row in self.rows):
            return None
        return "all of that is fresh, or there is another value for it"

    def _may_be_refused(self, row: Row, now: float) -> bool:
        meaning = self.meaning
        if isinstance(row.when_stale, int) or meaning.is_surely_fresh(row, now):
            return False
        return row.when_stale == "exception" or not meaning.is_surely_held(row, now)

    def _troubles(self, values: list[int], own: Sequence[Done], now: float) -> Iterator[str]:
        """Say what is wrong with values."""
        filled = set()
        for row in self.rows:
            begin, end = max(row.at, self.first), min(row.end, self.first + self.items)
            part = tuple(values[begin - self.first : end - self.first])
            how = self._how(row, slice(begin - row.at, end - row.at), part, own, now)
            self.outcomes.append(how)
            if how == "filled":
                filled.add(row.source.device)
            if how not in ("fresh", "held", "filled"):
                yield f"{row.area} {begin}-{end - 1}, {list(part)}, of {row}: {how}"
        for address in self._addresses:
            piece, value = self.meaning.pieces[self.area][address], values[address - self.first]
            if isinstance(piece, Own) and value not in (piece.value, *piece.lost):
                yield f"own register {address} is {value}, not {piece.value}"
            if piece == "age":
                yield from self._trouble_with_age(self.meaning.map.ages[address], value, now)
            if piece == "fresh":
                yield from self._trouble_with_bits(address, value, filled, now)

    def _how(self, row: Row, of: slice, part: tuple[int, ...], own: Sequence[Done], now: float) -> str:
        """Say whether a part of a row is fresh, held, or filled with a number; if none of these, what it should be."""
        meaning, source = self.meaning, row.source
        device = meaning.devices[source.device]
        since, until = self._time(row, device, own, now)
        told = [row.shown(each) for each in device.between(source.area, since, until)]
        is_told = part in [shown[of] for shown in told if shown is not None]
        if is_told and not meaning.is_surely_stale(row, self.asked_at, now):
            return "fresh"
        if row.when_stale == "exception":
            return f"it was told {told} from {since:.6f} to {until:.6f} s"
        if meaning.is_surely_fresh(row, now):
            return f"it is fresh, and was told {told} from {since:.6f} to {until:.6f} s"
        if row.when_stale != "hold":
            return "filled" if set(part) == {row.when_stale} else f"not {row.when_stale}, and not one of {told}"
        return self._how_held(row, of, part, now) or f"it is not the last value, nor one of {told}"

    def _how_held(self, row: Row, of: slice, part: tuple[int, ...], now: float) -> str:
        """Say whether a part of a row is what was told to the last poll, or later."""
        meaning, source = self.meaning, row.source
        seen = meaning.seen[source.device]
        if not any(poll.shows(row) for poll in seen.of_row(row, 0.0, now + A_MOMENT)):
            return "there was no value yet"
        last = seen.held(row, meaning.settled_at, now)
        since = 0.0 if last is None else last.submitted_at - A_MOMENT
        for each in meaning.devices[source.device].between(source.area, since, now + A_MOMENT):
            shown = row.shown(each)
            if shown is not None and shown[of] == part:
                return "held"
        return ""

    def _time(self, row: Row, device: MapDevice, own: Sequence[Done], now: float) -> tuple[float, float]:
        """From when to when the device may have told what was read."""
        source = row.source
        read = range(source.first, source.first + source.count)
        written_at = self._written_at[source.device, source.area]
        since, until = max(now - self.meaning.map.stale, *(written_at[each] for each in read)), now
        for each in own:
            write = each.write
            if write.device is not device or write.done_at is None or source.area is not Area.HOLDING:
                continue  # coils do not tell whose write has set them
            if each.area is source.area and write.order > self.order and each.meaning is self.meaning:
                until = min(until, write.done_at)
        return since - A_MOMENT, until + A_MOMENT

    def _trouble_with_age(self, device: str, age: int, now: float) -> Iterator[str]:
        meaning, rows = self.meaning, self.meaning.rows_of(device)
        seen, since = meaning.seen[device], now - (_LONG if age == _NEVER else age + 2.0)
        answered = {poll.submitted_at for row in rows for poll in seen.of_row(row, since, now + A_MOMENT)}
        last = [poll.submitted_at for row in rows if (poll := seen.held(row, meaning.settled_at, now)) is not None]
        ages = {floor(now - each + moment) for each in answered for moment in (-A_MOMENT, A_MOMENT)}
        if age not in ages and (age != _NEVER or last):
            yield f"the age of {device} is {age}, not of {sorted(ages)}"
        if last and age > now - max(last) + A_MOMENT:
            yield f"the age of {device} is {age}, and it has answered to a poll of {now - max(last):.6f} s ago"

    def _trouble_with_bits(self, address: int, value: int, filled: set[str], now: float) -> Iterator[str]:
        meaning = self.meaning
        it = meaning.map
        if it.bits_area in BITS:
            bits = {it.devices[address - it.bits_at]: value}
        else:
            bits = {name: value >> bit & 1 for bit, name in enumerate(it.devices)}
            if value >> len(it.devices):
                yield f"the fresh bits are {value:04X}, of {len(it.devices)} devices"
        for name, bit in bits.items():
            rows = meaning.rows_of(name)
            stale = [row for row in rows if meaning.is_surely_stale(row, 0.0, now)]
            if bit and (stale or name in filled):
                yield f"{name} is said to be fresh, and {stale or 'one'} of its rows is not"
            if not bit and all(meaning.is_surely_fresh(row, now) for row in rows):
                yield f"{name} is said not to be fresh, and all of its rows are"
