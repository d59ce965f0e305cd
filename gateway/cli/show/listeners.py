"""The listeners of a config, as `check` shows them, and what leads only to one line or upstream."""

from typing import Any, Final

from gateway.cli.kit.columns import align
from gateway.cli.show.limits import milliseconds
from gateway.config.plan.settings import Plan
from gateway.config.values.duration import show_duration
from gateway.listeners.hosts import url
from gateway.listeners.settings import ListenSettings

ON_FAILURE_SILENT: Final = "no response instead of 06, 0A and 0B."


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
