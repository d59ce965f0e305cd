"""The tiles of the overview: a figure for each part of the gateway, how good it is, and where it is explained."""

from collections.abc import Container, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Literal
from urllib.parse import quote

from gateway.operator.operations.answers.status import LineStatus, MonitorStatus, Status, UpstreamStatus
from gateway.operator.status.unit_states import ShownState

#: Where the page of the clients explains them.
_CONNECTIONS = "/clients#connections"
State = Literal["up", "failing", "down", "known"]


@dataclass(frozen=True, slots=True)
class Tile:
    """A tile: `count` of `total` are as they should be, or a `value` in milliseconds or per second.

    `about` says of what, or how it is; `kept` values wait for a broker.
    `link` is where it is explained. The state is `up` if all is well, `known` where nothing is good or bad.
    """

    kind: Literal["lines", "units", "requests", "p99", "clients", "broker", "fleet", "standby"]
    state: State
    link: str
    count: int = 0
    total: int = 0
    value: float | None = None
    about: str = ""
    kept: int = 0


def tiles_of(status: Status, states: Mapping[str, ShownState], with_page: Container[str]) -> tuple[Tile, ...]:
    """Make the tiles, without those of parts that the config does not have. Units not in `with_page` have no page."""
    return tuple(_tiles(status, states, with_page))


def _tiles(status: Status, states: Mapping[str, ShownState], with_page: Container[str]) -> Iterator[Tile]:
    active = [each for each in status.all_lines if each.state != "standby"]
    up = sum(each.state == "up" for each in active)
    yield Tile("lines", _all(up, len(active)), "/#lines", up, len(active))
    words = [state.word for state in states.values() if state.word != "not asked"]
    fine = words.count("fine")
    is_resting = "resting" in words
    yield Tile("units", "down" if is_resting else "failing" if fine < len(words) else "up", "/#units", fine, len(words))
    yield Tile("requests", "known", "/traffic", value=_per_second((*status.lines, *status.upstreams, *status.monitors)))
    slowest = max(status.units, key=lambda unit: unit.times.answer_p99_ms or 0.0, default=None)
    if slowest is not None and slowest.times.answer_p99_ms is not None:
        has_page = slowest.name in with_page
        link = f"/units/{quote(slowest.name, safe='')}" if has_page else f"/lines/{quote(slowest.line, safe='')}"
        yield Tile("p99", "known", link, value=slowest.times.answer_p99_ms, about=slowest.name)
    yield Tile("clients", "known", "/clients", len(status.clients))
    for broker in status.brokers:
        state: State = "down" if broker.state == "down" else "failing" if broker.available < broker.devices else "up"
        kept = 0 if broker.kept is None else broker.kept.values
        yield Tile("broker", state, _CONNECTIONS, broker.available, broker.devices, about=broker.state, kept=kept)
    for fleet in status.fleets:
        yield Tile("fleet", "failing" if fleet.unseen else fleet.state, _CONNECTIONS, about=fleet.state)
    if status.leases:
        held = sum(lease.is_held for lease in status.leases)
        yield Tile("standby", "known", _CONNECTIONS, held, len(status.leases))


def _all(count: int, total: int) -> Literal["up", "down"]:
    return "up" if count == total else "down"


def _per_second(lines: Iterable[LineStatus | UpstreamStatus | MonitorStatus]) -> float | None:
    """Add up the requests per second; None while none is known."""
    known = [each.requests_per_s for each in lines if each.requests_per_s is not None]
    return sum(known) if known else None
