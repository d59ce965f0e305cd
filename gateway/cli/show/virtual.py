"""The virtual units of a config, as `check` shows them: what stands at their addresses, and in the gaps between."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Final, Literal

from gateway.cli.kit.columns import align
from gateway.cli.show.devices import milliseconds, round_up
from gateway.config.plan.forecast import waits_by_name
from gateway.config.plan.settings import Plan
from gateway.config.values.duration import show_duration
from gateway.images.virtual.settings import FreshBits, MappedValue, SourceAge, VirtualSettings, WhenStale
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.registers.items import has_bits, reference

_HEADINGS: Final = ("ADDRESS", "REFERENCE", "DEVICE", "POINT", "THERE", "TYPE", "EVERY", "WRITE", "STALE", "MEANING")
_NOTHING: Final = "-"
#: What stands in the place of a device where there is no value of one, and what bits and ages mean.
_NO_DEVICE: Final = {"own": "its own", "gap": "nothing: 02", "fresh": "fresh"}
_MEANINGS: Final = {
    "fresh": "1 while its values are fresh, from bit 0 on: {}",
    "age": "seconds since its last answer; 65535: none yet",
}
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


def virtual_as_text(plan: Plan) -> Iterator[str]:
    """Show a table of the rows of each virtual unit."""
    waits = waits_by_name(plan) if plan.virtual else {}
    for unit in plan.virtual:
        rows = [_row(line) for line in mapped_lines(unit)]
        stale = f"values older than {show_duration(unit.stale)} are stale"
        title = f"Virtual unit {unit.unit}, {unit.name}: profile {unit.profile.name}, {stale}"
        yield "\n".join([title, align([_HEADINGS, *rows], "  "), *_notes(unit, plan, waits[unit.name])])


def virtual_as_json(plan: Plan) -> list[dict[str, Any]]:
    """Make the virtual units for programs; times are in milliseconds."""
    waits = waits_by_name(plan) if plan.virtual else {}
    return [
        {
            "unit": unit.unit,
            "name": unit.name,
            "profile": unit.profile.name,
            "stale_ms": 1000 * unit.stale,
            "longest_wait_ms": milliseconds(waits[unit.name]),
            "map": [line_as_json(line) for line in mapped_lines(unit)],
        }
        for unit in plan.virtual
    ]


def line_as_json(line: MappedLine) -> dict[str, Any]:
    """Make what stands at some addresses for programs."""
    return {
        "area": line.place.area,
        "first": line.place.start,
        "last": line.place.end - 1,
        "what": line.what,
        "device": line.device,
        "there": line.place_there,
        "point": line.point,
        "type": line.type,
        "swap": line.swap,
        "scale": line.scale,
        "offset": line.offset,
        "scale_at": line.scale_at,
        "unit": line.unit,
        "every_ms": None if line.every is None else 1000 * line.every,
        "write": line.write,
        "when_stale": line.when_stale,
    }


def _row(line: MappedLine) -> tuple[str, ...]:
    is_value = line.what == "value"
    return (
        f"{line.place.area} {line.place.addresses}",
        reference(line.place.area, line.place.start),
        _NO_DEVICE.get(line.what, line.device),
        line.point or (_NOTHING if is_value else ""),
        line.place_there,
        " ".join(filter(None, (line.type, line.swap))) or ("as there" if is_value else ""),
        line.how_often,
        "yes" if line.write else "" if line.what == "gap" else _NOTHING,
        _when_stale(line.when_stale, is_bit=has_bits(line.place.area)) if is_value else "",
        _MEANINGS[line.what].format(line.device) if line.what in _MEANINGS else line.meaning,
    )


def _when_stale(when_stale: WhenStale | None, *, is_bit: bool) -> str:
    if isinstance(when_stale, int):
        return str(when_stale) if is_bit else f"0x{when_stale:04X}"
    return "hold" if when_stale == "hold" else "0B"


def _notes(unit: VirtualSettings, plan: Plan, longest_wait: float) -> Iterator[str]:
    """Say what is only heard, when reads wait, and what a device without an answer means for the others."""
    for name in unit.devices:
        if name in plan.heard_on:
            yield f"  {name} is heard on {plan.heard_on[name]}: a row is taken from one answer with all of it."
    if longest_wait:
        when = "of reads at the start and after a write, and of writes. All others wait for no line."
        yield f"  Longest wait {round_up(longest_wait)}: {when}"
    strict = {value.device for value in unit.values if value.when_stale == "exception"}
    if strict and len(unit.devices) > 1:
        yield "  One device that does not answer makes every read with values of it 0B, that of a whole block, too."
