"""The listeners and the rights of a config, as `check` shows them, and what leads only to one line or upstream."""

from typing import Any, Final

from gateway.cli.kit.columns import align
from gateway.cli.show.devices import milliseconds
from gateway.config.plan.rights_in_words import addresses_by_area, own_numbers, right_in_words, rows_in_words, unnamed
from gateway.config.plan.settings import Plan
from gateway.config.values.duration import show_duration
from gateway.listeners.hosts import url
from gateway.listeners.settings import ListenSettings
from gateway.routing.access import DEFAULT_ROWS, AccessRow

ON_FAILURE_SILENT: Final = "no response instead of 06, 0A and 0B."
_HEADINGS: Final = ("FROM", "THROUGH", "UNITS", "ADDRESSES", "RIGHTS", "PRIORITY")
#: What rows for addresses mean.
_BY_ADDRESS: Final = (
    "  At each address of a request the first row that has it counts, and each of these rows must allow the function.",
    "  What may write and tells no addresses is also refused by an earlier row for addresses that does not allow it.",
)


def listeners_as_text(listeners: tuple[ListenSettings, ...]) -> str:
    """Show the listeners as a table."""
    if not listeners:
        return "Listeners: none, as listen = [] says"
    rows = [(one.name, _address(one), _places(one), _idle(one), str(one.unit0), _leads_to(one)) for one in listeners]
    table = align([("NAME", "ADDRESS", "CLIENTS", "IDLE", "UNIT 0", "LEADS TO"), *rows], "  ")
    silent = [f"  Through {one.name}: {ON_FAILURE_SILENT}" for one in listeners if one.on_failure == "silent"]
    return "\n".join(["Listeners", table, *silent])


def _leads_to(listener: ListenSettings) -> str:
    kind = "line" if listener.line else "upstream"
    return f"{kind} {listener.only}" if listener.only else "all units"


def _address(listener: ListenSettings) -> str:
    return url(listener.scheme, listener.host, listener.port)


def _places(listener: ListenSettings) -> str:
    return f"{listener.clients}, {listener.reserve} reserved" if listener.reserve else str(listener.clients)


def _idle(listener: ListenSettings) -> str:
    return show_duration(listener.idle) if listener.idle else "never"


def through(listeners: list[str], *, is_shared: bool) -> str:
    """Name the listeners that lead to one line or upstream; empty if none does."""
    names = ", ".join(f'"{name}"' for name in listeners)
    return names and f"  Through {names}{'' if is_shared else ' and no other listener'}"


def listeners_for(name: str, whole: Plan) -> list[str]:
    """List the names of the listeners that lead only to the line or upstream with this name."""
    return [one.name for one in whole.listeners if one.only == name]


def listeners_as_json(listeners: tuple[ListenSettings, ...]) -> list[dict[str, Any]]:
    """Make the listeners for programs."""
    return [
        {
            "name": one.name,
            "address": _address(one),
            "clients": one.clients,
            "reserve": one.reserve,
            "idle_ms": milliseconds(one.idle),
            "in_flight": one.in_flight,
            "unit0": one.unit0,
            "on_failure": one.on_failure,
            "line": one.line or None,
            "upstream": one.upstream or None,
        }
        for one in listeners
    ]


def rights_as_text(plan: Plan) -> str:
    """Show the table of rights, with rules that are not rows."""
    rows = rows_in_words(plan)
    has_addresses, has_priority = any(row.addresses for row in rows), any(row.priority for row in rows)
    table = [_columns(*_HEADINGS, has_addresses=has_addresses, has_priority=has_priority)]
    for row in rows:
        addresses = row.addresses or ("all" if row.units else "")
        cells = row.clients, row.through, row.units, addresses, row.may, row.priority
        table.append(_columns(*cells, has_addresses=has_addresses, has_priority=has_priority))
    silent = [f"  Through {name} (UDP) clients only read, as no row names it." for name in unnamed("udp", plan)]
    silent += [f"  Through {name} (TLS) {_by_certificate(plan)}." for name in unnamed("tls", plan)]
    rules = _BY_ADDRESS if has_addresses else ()
    return "\n".join(["Rights: first match wins", align(table, "  "), *rules, *silent])


def _columns(*cells: str, has_addresses: bool, has_priority: bool) -> list[str]:
    """Leave out the columns that are not needed."""
    shown = (True, True, True, has_addresses, True, has_priority)
    return [cell for cell, is_shown in zip(cells, shown, strict=True) if is_shown]


def _by_certificate(plan: Plan) -> str:
    if plan.access == DEFAULT_ROWS:
        return "clients only read, from everywhere, as there are no rows"
    return "only rows with a role apply, as no row names it"


def rights_as_json(plan: Plan) -> list[dict[str, Any]]:
    """Make the table of rights for programs; null means all."""
    return [
        {
            "from": None if row.networks is None else [*map(str, row.networks), *sorted(row.sites)],
            "role": row.role,
            "listen": None if row.listeners is None else sorted(row.listeners),
            "units": None if row.units is None else sorted(row.units),
            "by_address": bool(own_numbers(row, plan)),
            "addresses": None if row.addresses is None else _ranges(row),
            "may": right_in_words(row.right),
            "priority": row.priority,
            "source": row.source,
        }
        for row in plan.access
    ]


def _ranges(row: AccessRow) -> dict[str, list[tuple[int, int]]]:
    """List the first and last addresses of the ranges of a row, by area."""
    return {str(area): [(each.start, each.end - 1) for each in spans] for area, spans in addresses_by_area(row).items()}
