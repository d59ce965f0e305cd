"""The virtual units of a config, as `check` shows them."""

from collections.abc import Iterator
from typing import Any, Final

from gateway.cli.kit.columns import align
from gateway.cli.show.limits import milliseconds, round_up
from gateway.cli.show.mapped import MappedLine, mapped_lines
from gateway.config.plan.forecast import waits_by_name
from gateway.config.plan.settings import Plan
from gateway.config.values.duration import show_duration
from gateway.images.virtual.settings import VirtualSettings, WhenStale
from gateway.registers.items import has_bits, reference

_HEADINGS: Final = ("ADDRESS", "REFERENCE", "DEVICE", "POINT", "THERE", "TYPE", "EVERY", "WRITE", "STALE", "MEANING")
_NOTHING: Final = "-"
#: What stands in the place of a device where there is no value of one, and what bits and ages mean.
_NO_DEVICE: Final = {"own": "its own", "gap": "nothing: 02", "fresh": "fresh"}
_MEANINGS: Final = {
    "fresh": "1 while its values are fresh, from bit 0 on: {}",
    "age": "seconds since its last answer; 65535: none yet",
}


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
