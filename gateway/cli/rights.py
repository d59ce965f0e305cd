"""The access rights as `check` prints them."""

from collections.abc import Iterator
from typing import Any

from gateway.cli.columns import align
from gateway.config.plan import Plan
from gateway.config.unitset import show_units
from gateway.routing.access import EVERYTHING, LOOPBACK, NOTHING, READING, WRITING, Network, Right, Row

_WORDS = {EVERYTHING: "read, write", READING: "read", WRITING: "write", NOTHING: "nothing"}


def rights_as_text(plan: Plan) -> str:
    """The table of rights, with rules that are not rows."""
    shown = [_show_row(row, plan) for row in plan.access]
    rows = [("FROM", "THROUGH", "UNITS", "RIGHTS"), *shown, *_rest(plan)]
    return "\n".join(["Rights: first match wins", align(rows, "  "), *_datagrams(plan)])


def rights_as_json(plan: Plan) -> list[dict[str, Any]]:
    """The table of rights; null means all."""
    return [
        {
            "from": None if row.networks is None else list(map(str, row.networks)),
            "listen": None if row.listeners is None else sorted(row.listeners),
            "units": None if row.units is None else sorted(row.units),
            "by_address": _is_by_address(row, plan),
            "may": _may(row.right),
            "source": row.source,
        }
        for row in plan.access
    ]


def _show_row(row: Row, plan: Plan) -> tuple[str, ...]:
    units = "all" if row.units is None else show_units(row.units)
    if row.units is not None and _is_by_address(row, plan):
        units += " on the wire"
    return _clients(row), _through(row), units, _may(row.right)


def _is_by_address(row: Row, plan: Plan) -> bool:
    """Whether the row names listeners for one line, where units are addresses."""
    return any(listener.line and listener.name in (row.listeners or ()) for listener in plan.listeners)


def _clients(row: Row) -> str:
    if row.networks is None:
        return "anywhere"
    return "this machine" if row.networks == LOOPBACK else ", ".join(map(_network, row.networks))


def _network(network: Network) -> str:
    return str(network if network.num_addresses > 1 else network.network_address)


def _through(row: Row) -> str:
    return "any listener" if row.listeners is None else ", ".join(sorted(row.listeners))


def _may(right: Right) -> str:
    return _WORDS.get(right) or "functions " + show_units(each if isinstance(each, int) else each[0] for each in right)


def _rest(plan: Plan) -> Iterator[tuple[str, ...]]:
    """The rights of clients that match no row."""
    if not any((row.networks, row.listeners, row.units) == (None, None, None) for row in plan.access):
        yield "all else", "", "", "nothing"
    for server in plan.servers:
        if not _is_named(server.line.name, plan):
            yield "the line", server.line.name, show_units(server.line.serves), "read, write, broadcast"


def _datagrams(plan: Plan) -> Iterator[str]:
    for listener in plan.listeners:
        if listener.scheme == "udp" and not _is_named(listener.name, plan):
            yield f"  Through {listener.name} (UDP) clients only read, as no row names it."


def _is_named(listener: str, plan: Plan) -> bool:
    return any(listener in (row.listeners or ()) for row in plan.access)
