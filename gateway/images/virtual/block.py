"""The block of registers of a virtual unit: its rows write there when they are polled, all else is put in when read."""

from collections.abc import Mapping, Sequence
from typing import Final

from gateway.images.image import Image
from gateway.images.polled_range import Reader
from gateway.images.tables import make_tables
from gateway.images.virtual.layout import Own, Touched, layout
from gateway.images.virtual.row import DeviceRows, Freshness, Row, Source
from gateway.images.virtual.settings import FreshBits, SourceAge, VirtualSettings
from gateway.modbus.pdu import Span
from gateway.registers.items import REGISTER, has_bits, pack_bits, unpack_bits

#: The age of a source that has not answered yet, in its register; greater ages are one less.
NO_ANSWER: Final = 0xFFFF


class Block:
    """The values of `rows`, which `reader` polls of `sources`, and the registers of the image `own`.

    The rows of each source are in `by_device`. `changes` grows whenever values that were fresh may not be so any more,
    but for their age.
    """

    def __init__(self, settings: VirtualSettings, sources: Mapping[str, Source], own: Image, reader: Reader) -> None:
        self.own = own
        self.stale = settings.stale
        self.changes = 0
        self.by_device = {name: DeviceRows(self) for name in sources}
        self.rows = tuple(
            Row(each, sources[each.device], reader, self.by_device[each.device]) for each in settings.values
        )
        for row in self.rows:
            self.by_device[row.mapped.device].add(row)
        self._tables = make_tables(settings.areas, {})
        self._layout = layout(settings, self.rows)
        #: By the place of fresh bits: of all of their devices, and the items while these are fresh.
        self._all_fresh = {
            each.place: (
                Freshness(tuple(self.by_device[name] for name in each.devices)),
                _bits(b"\1" * len(each.devices), each.place),
            )
            for each in settings.fresh
        }

    def has(self, span: Span) -> bool:
        """Tell whether all addresses of `span` exist."""
        return self._tables[span.area].has(span)

    def missing(self, span: Span) -> Span:
        """Find the first addresses of `span` that do not exist; at least one of them does not."""
        exist = [self.has(Span(span.area, address, 1)) for address in range(span.start, span.end)]
        start = exist.index(False)
        count = exist.index(True, start) - start if True in exist[start:] else len(exist) - start
        return Span(span.area, span.start + start, count)

    def touched(self, span: Span, head: bytes = b"") -> Touched:
        """Find what a read of `span` touches, whose response begins with `head`."""
        return Touched(span, head, self._layout.touched(span))

    def take(self, row: Row, items: bytes) -> None:
        """Take what was read for a row."""
        found = row.take(items)
        if found is not None:
            self._tables[row.place.area].write(row.place, pack_bits(found) if has_bits(row.place.area) else found)

    def take_over(self, old: "Block") -> None:
        """Have the values and ages of rows that the block which this one replaces has too, from the same polls."""
        before = {row.place: row for row in old.rows}
        for row in self.rows:
            same = before.get(row.place)
            if same is not None and same.mapped == row.mapped and same.source.polls is row.source.polls:
                row.take_over(same)
                area, place = row.place.area, row.place
                self._tables[area].write(place, old._tables[area].read(place))  # noqa: SLF001 - of its own kind
        self.changes += 1

    def are_fresh(self, read: Touched, now: float) -> bool:
        """Tell whether all rows that a read touches are fresh."""
        return read.freshness.lasts(now, self.stale, self.changes)

    def is_device_fresh(self, device: str, now: float) -> bool:
        """Tell whether all rows of a source are fresh, or will be when the poll after a write is answered."""
        return self.by_device[device].are_expected(now, self.stale)

    def age_of(self, device: str, now: float) -> float | None:
        """Return the seconds since the last answer of a source; None if there was none."""
        newest_at = self.by_device[device].newest_at
        return None if newest_at is None else now - newest_at

    def values(self, read: Touched, now: float, fills: Sequence[tuple[Span, bytes]] = ()) -> bytes:
        """Return what a read gets, encoded as in a response: the values of rows, with some `fills`, and all else.

        Whether they are known and fresh is up to the caller.
        """
        span = read.span
        data = self._tables[span.area].read(span)
        if not read.others and not fills:
            return data
        are_bits, size = has_bits(span.area), 1 if has_bits(span.area) else REGISTER
        items = bytearray(unpack_bits(data, span.count) if are_bits else data)
        for place, own in (*fills, *((each.place, self._computed(each, now)) for each in read.others)):
            start, end = max(place.start, span.start), min(place.end, span.end)
            part = own[size * (start - place.start) : size * (end - place.start)]
            items[size * (start - span.start) : size * (end - span.start)] = part
        return pack_bits(bytes(items)) if are_bits else bytes(items)

    def _computed(self, piece: FreshBits | SourceAge | Own, now: float) -> bytes:
        """Make the items at what is no row."""
        place = piece.place
        if isinstance(piece, Own):
            data = self.own.tables[place.area].read(place)
            return unpack_bits(data, place.count) if has_bits(place.area) else data
        if isinstance(piece, SourceAge):
            age = self.age_of(piece.device, now)
            return (NO_ANSWER if age is None else min(int(age), NO_ANSWER - 1)).to_bytes(REGISTER, "big")
        freshness, items = self._all_fresh[place]
        if freshness.lasts(now, self.stale, self.changes):
            return items
        return _bits(bytes(self.is_device_fresh(each, now) for each in piece.devices), place)


def _bits(bits: bytes, place: Span) -> bytes:
    """Make coils of bits, or registers, the lowest bits in the first."""
    if has_bits(place.area):
        return bits
    number = int.from_bytes(pack_bits(bits), "little")
    return b"".join((number >> 16 * at & 0xFFFF).to_bytes(REGISTER, "big") for at in range(place.count))
