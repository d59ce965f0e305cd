"""What stands at the addresses of a virtual unit, in their order: rows, registers of its own, and gaps."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

from gateway.config.values.duration import show_duration
from gateway.images.virtual.settings import FreshBits, MappedValue, SourceAge, VirtualSettings, WhenStale
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.registers.items import has_bits

#: What stands at some addresses: the value of a row, the two other kinds of row, registers of the unit's own, nothing.
What = Literal["value", "fresh", "age", "own", "gap"]


@dataclass(frozen=True, slots=True)
class MappedLine:
    """What stands at `place`. Of a value: from which `device` and addresses `there`, which `point`, and how often.

    `bits` are those there that it is, if not all. `type` and `swap` are those here, empty for what is as it is. The
    value is the number times `scale` plus `offset`, in `unit`; before, it is multiplied by ten to the power of the
    number at the place `scale_at`.
    """

    place: Span
    what: What
    device: str = ""
    there: Span | None = None
    bits: str = ""
    point: str = ""
    type: str = ""
    swap: str = ""
    scale: float = 1.0
    offset: float = 0.0
    scale_at: str = ""
    unit: str = ""
    every: float | None = None
    write: bool = False
    when_stale: WhenStale | None = None

    @property
    def place_there(self) -> str:
        """Its addresses there, as text."""
        return "" if self.there is None else f"{self.there.area} {self.there.addresses}{self.bits}"

    @property
    def how_often(self) -> str:
        """How often it is read, as text: `heard` if only others do; nothing if nobody does."""
        return "" if self.every is None else show_duration(self.every) if self.every else "heard"

    @property
    def meaning(self) -> str:
        """What a number there means: `x 0.1 kW`; empty for a plain number."""
        scale = f"x {self.scale:g}" if self.scale != 1 else ""
        power = f"x 10^({self.scale_at})" if self.scale_at else ""
        offset = f"{self.offset:+g}" if self.offset else ""
        return " ".join(filter(None, (scale, power, offset, self.unit)))


def mapped_lines(unit: VirtualSettings) -> list[MappedLine]:
    """List all that a virtual unit has, by area and address, and what it does not have in between."""
    lines = [*map(_value, unit.values), *map(_bits, unit.fresh), *map(_age, unit.ages), *_own(unit)]
    order = list(Area)
    lines.sort(key=lambda each: (order.index(each.place.area), each.place.start))
    return [*_with_gaps(lines)]


def _value(value: MappedValue) -> MappedLine:
    line = MappedLine(
        value.place,
        "value",
        value.device,
        value.poll.span,
        type="bit" if has_bits(value.place.area) else "",
        swap=_order(value.swap),
        every=value.poll.every,
        write=value.write,
        when_stale=value.when_stale,
    )
    point, shown = value.point, value.target or value.point
    if point is None or shown is None:
        return line
    return replace(
        line,
        there=point.span,
        bits=point.bits_shown,
        point=point.name,
        type=line.type or shown.type,
        swap=_order(shown.swap),
        scale=shown.scale,
        offset=shown.offset,
        scale_at="" if point.scale_at is None or value.target else f"{point.area} {point.scale_at} there",
        unit=point.unit,
    )


def _order(swap: str) -> str:
    return "" if swap == "none" else swap


def _bits(bits: FreshBits) -> MappedLine:
    return MappedLine(bits.place, "fresh", ", ".join(bits.devices), type="bit" if has_bits(bits.place.area) else "bits")


def _age(age: SourceAge) -> MappedLine:
    return MappedLine(age.place, "age", age.device, type="uint16", unit="s")


def _own(unit: VirtualSettings) -> Iterator[MappedLine]:
    for area, ranges in unit.own.areas.items():
        for first, last in ranges:
            yield MappedLine(Span(area, first, last + 1 - first), "own", write=area in (Area.HOLDING, Area.COILS))


def _with_gaps(lines: list[MappedLine]) -> Iterator[MappedLine]:
    yield from lines[:1]
    for before, line in pairwise(lines):
        gap = Span(line.place.area, before.place.end, line.place.start - before.place.end)
        if before.place.area is line.place.area and gap.count > 0:
            yield MappedLine(gap, "gap")
        yield line
