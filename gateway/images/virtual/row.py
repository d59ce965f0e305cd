"""A row of a virtual unit: a part of what is polled, and its values as clients read them."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import inf
from typing import Literal, NamedTuple, Protocol

from gateway.images.polled_range import Part, Reader
from gateway.images.supply import Supply
from gateway.images.virtual.settings import MappedValue
from gateway.modbus.pdu import Span
from gateway.profiles.coding import arranged
from gateway.profiles.conversion import Conversion
from gateway.profiles.profile import Profile
from gateway.registers.items import REGISTER, has_bits
from gateway.request import Target

#: What the values of a row are. Those that are not fresh are not sent, unless the row says otherwise.
State = Literal["fresh", "stale", "unknown", "invalid"]
#: The registers that change places with one another in a range with a `swap`.
_PAIR = 2 * REGISTER


class Source(NamedTuple):
    """A device, or a local image, with its polls and its profile."""

    polls: Supply
    target: Target
    profile: Profile


class Changing(Protocol):
    """What a row tells of its changes: see Block."""

    changes: int


class Row(Part):
    """What a row maps, and its source. `items` are those that were read last, as the device sent them.

    `is_valid`: they have a value that fits the row. It `holds` a value if they ever had one. `is_refused`: the last
    answer to its poll was an exception.
    """

    __slots__ = (
        "_convert", "_of_device", "back", "holds", "is_refused", "is_valid", "items", "mapped", "place",
        "source",
    )  # fmt: skip

    def __init__(self, mapped: MappedValue, source: Source, reader: Reader, of_device: "DeviceRows") -> None:
        super().__init__(mapped.poll, reader)
        self._of_device = of_device
        self.mapped = mapped
        self.place = mapped.place
        self.source = source
        self.items: bytes | None = None
        self.is_valid = False
        self.holds = False
        self.is_refused = False
        self._convert = _conversion(mapped)
        point = mapped.point
        #: From what a client writes to what the device gets, for a value that takes writes.
        self.back: Conversion | None = None
        if point is not None and mapped.write:
            alone = Conversion(replace(point, scale_at=None), None)  # no client writes a scale register with it
            self.back = alone if mapped.target is None else Conversion(mapped.target, point)

    def take(self, items: bytes) -> bytes | None:
        """Take what was read. Return the items of its place if they are others than before."""
        if items == self.items:
            return None
        self.items = items
        found = self._convert(items)
        is_valid = found is not None
        self._of_device.block.changes += is_valid is not self.is_valid
        self.is_valid = is_valid
        self.holds |= is_valid
        return found

    def changed(self, writes: int) -> None:
        """See Part."""
        super().changed(writes)
        self._of_device.block.changes += 1
        self._of_device.note(self)

    def sampled(self, at: float, writes: int) -> None:
        """See Part."""
        super().sampled(at, writes)
        self._of_device.note(self)

    @property
    def is_sure(self) -> bool:
        """Whether it has a valid value that no write has changed since."""
        return self.sampled_at is not None and self.is_valid and self._sampled_after >= self._changed_by

    @property
    def changed_at(self) -> tuple[Span, ...]:
        """See Part. A point may be written at other addresses than it is read."""
        point = self.mapped.point
        return (self.span,) if point is None or point.write_at is None else (self.span, point.write_span)

    def take_over(self, old: "Row") -> None:
        """Have the values and the age of an equal row of the unit that this one replaces."""
        self.go_on_from(old)
        self.items, self.is_valid, self.holds = old.items, old.is_valid, old.holds
        self._of_device.note(self)

    def since(self, now: float, stale: float) -> float | None:
        """Return when its values were asked for, if they are fresh."""
        at = self.sampled_at
        return at if at is not None and self.is_sure and now - at <= stale else None

    def is_expected(self, now: float, stale: float) -> bool:
        """Tell whether its values are fresh, or will be when the poll after a write is answered."""
        at = self.sampled_at
        if at is None or not self.is_valid or now - at > stale:
            return False
        return self.is_awaited or self._sampled_after >= self._changed_by

    def is_missing(self, now: float, stale: float, writes: int) -> bool:
        """Tell whether there is nothing to wait for, and no fresh value that includes so many writes."""
        return self.is_lost(now, stale, writes) or (self.is_known(writes) and not self.is_valid)

    def state(self, now: float, stale: float) -> State:
        """Say what its values are."""
        age = self.age(now)
        if age is None:
            return "unknown"
        if age > stale:
            return "stale"
        return "fresh" if self.is_valid else "invalid"

    def trouble(self, now: float, stale: float) -> str:
        """Say why there is no fresh value: `meter-7 (holding 0-1) has not answered for too long`."""
        span = self.span
        where = f"{self.mapped.device} ({span.area} {span.addresses})"
        if self.state(now, stale) != "invalid" or self.items is None:
            return f"{where} {'is refused' if self.is_refused else self.source.polls.silence}"
        point = self.mapped.point
        has_value = point is None or Conversion(point, None).has_value(self.items)
        return f"the value of {where} does not fit its row" if has_value else f"{where} has no valid value"


class DeviceRows:
    """The `rows` of a `block` that are of one device: whether all are fresh, without looking at each of them."""

    __slots__ = ("_oldest", "_oldest_at", "_unsure", "block", "newest_at", "rows")

    def __init__(self, block: Changing) -> None:
        self.block = block
        self.rows: list[Row] = []
        #: When the newest of their values was asked for.
        self.newest_at: float | None = None
        self._unsure: dict[Row, None] = {}
        self._oldest: Row | None = None
        self._oldest_at = -inf

    def add(self, row: Row) -> None:
        """Add a row, which has no values yet."""
        self.rows.append(row)
        self._unsure[row] = None

    def note(self, row: Row) -> None:
        """Note that a row has changed."""
        if row.is_sure:
            self._unsure.pop(row, None)
        else:
            self._unsure[row] = None
        at = row.sampled_at
        if at is not None:
            self.newest_at = at if self.newest_at is None else max(at, self.newest_at)
            if at < self._oldest_at:
                self._oldest, self._oldest_at = row, at

    def since(self, now: float, stale: float) -> float | None:
        """Return when the oldest values were asked for, or an earlier time, if all are fresh."""
        return self._since(now, stale) if not self._unsure else None

    def are_expected(self, now: float, stale: float) -> bool:
        """Tell whether all are fresh, or will be when the poll after a write is answered."""
        return all(row.is_expected(now, stale) for row in self._unsure) and self._since(now, stale) is not None

    def _since(self, now: float, stale: float) -> float | None:
        """Return when the oldest values were asked for, or earlier, if that is not too long ago. All have some."""
        if now - self._oldest_at > stale and (self._oldest is None or self._oldest.sampled_at != self._oldest_at):
            self._oldest_at = inf
            for row in self.rows:
                at = row.sampled_at
                if at is not None and at < self._oldest_at:
                    self._oldest, self._oldest_at = row, at
        return self._oldest_at if now - self._oldest_at <= stale else None


class Freshness:
    """Whether all of some rows are fresh: most of the time one comparison tells."""

    __slots__ = ("_changes", "_oldest", "rows")

    def __init__(self, rows: "Sequence[Row | DeviceRows]") -> None:
        self.rows = rows
        #: When the oldest of their values was asked for, after so many changes.
        self._oldest = -inf
        self._changes = -1

    def lasts(self, now: float, stale: float, changes: int) -> bool:
        """Tell whether all are fresh; `changes` are those of their reader."""
        if changes == self._changes and now - self._oldest <= stale:
            return True
        oldest = inf
        for row in self.rows:
            since = row.since(now, stale)
            if since is None:
                return False
            oldest = min(oldest, since)
        self._oldest, self._changes = oldest, changes
        return True


def _conversion(mapped: MappedValue) -> Callable[[bytes], bytes | None]:
    if mapped.point is not None:
        return Conversion(mapped.point, mapped.target)
    poll = mapped.poll
    size = poll.span.count * (1 if has_bits(poll.area) else poll.width)
    return bytes if has_bits(poll.area) else arranged(mapped.swap, size, _PAIR)
