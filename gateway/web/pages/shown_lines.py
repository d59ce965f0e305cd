"""Lines and other servers as the pages show them, with the units on them."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from gateway.web.answers import Status


@dataclass(frozen=True, slots=True)
class ShownLine:
    """A line, or another server, as a page shows it. `units` are numbers and names; another server has no `baud`."""

    name: str
    mode: str
    baud: int
    format: str
    port: str
    settings: str
    busy_share: float | None
    units: tuple[tuple[int, str], ...]
    status: Any


def shown_lines(status: Status) -> Iterator[ShownLine]:
    """All of them, in the order of the config."""
    for each in (*status.lines, *status.servers):
        settings = f"{each.mode.upper()} {each.baud} {each.format}"
        busy = getattr(each, "busy_share", None)
        units = _units_on(status, each.name)
        yield ShownLine(each.name, each.mode, each.baud, each.format, each.port, settings, busy, units, each)
    for each in status.upstreams:
        yield ShownLine(each.name, "tcp", 0, "", each.to, "Modbus TCP", None, _units_on(status, each.name), each)


def _units_on(status: Status, name: str) -> tuple[tuple[int, str], ...]:
    return tuple((each.unit, each.name) for each in status.units if each.line == name)
