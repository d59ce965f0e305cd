"""Lines and upstreams as the pages show them, with the units on them."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from gateway.operator.operations.answers.status import LineStatus, MonitorStatus, ServerStatus, Status, UpstreamStatus


@dataclass(frozen=True, slots=True)
class ShownLine:
    """A line or upstream as a page shows it. `units` are numbers and names; an upstream has no `baud`.

    On a line that `is_asked`, an outside client asks the gateway; on one that `is_heard`, it only listens.
    """

    name: str
    mode: str
    baud: int
    format: str
    port: str
    settings: str
    busy_share: float | None
    units: tuple[tuple[int, str], ...]
    status: Any
    is_asked: bool = False
    is_heard: bool = False


def shown_lines(status: Status) -> Iterator[ShownLine]:
    """Yield all lines and upstreams, in the order of the config."""
    names = {each.unit: each.name for each in status.units}
    lines: tuple[LineStatus | ServerStatus | MonitorStatus, ...] = (*status.lines, *status.servers, *status.monitors)
    for each in lines:
        settings = f"{each.mode.upper()} {each.baud} {each.format}"
        busy = getattr(each, "busy_share", None)
        serves = getattr(each, "serves", None)
        units = _units_on(status, each.name) if serves is None else tuple((it, names.get(it, "")) for it in serves)
        is_asked = serves is not None
        is_heard = isinstance(each, MonitorStatus)
        yield ShownLine(
            each.name, each.mode, each.baud, each.format, each.port, settings, busy, units, each, is_asked, is_heard
        )
    for upstream in status.upstreams:
        spoken = "NATS" if is_site(upstream) else "Modbus TCP"
        yield ShownLine(
            upstream.name,
            "tcp",
            0,
            "",
            upstream.to,
            spoken,
            upstream.busy_share,
            _units_on(status, upstream.name),
            upstream,
        )


def is_site(upstream: UpstreamStatus) -> bool:
    """Tell whether an upstream is another site of the fleet."""
    return upstream.to.startswith("fleet://")


def _units_on(status: Status, name: str) -> tuple[tuple[int, str], ...]:
    """List the units on a line, by the numbers that frames are shown with."""
    there = (each for each in status.units if each.line == name)
    return tuple((each.on_the_wire if each.unit is None else each.unit, each.name) for each in there)
