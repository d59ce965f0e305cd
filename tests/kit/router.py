"""A router for tests, of a listener that is called `scada`."""

from collections.abc import Iterable, Mapping

from gateway.events import Emit, Event
from gateway.request import Target
from gateway.routing.access import DEFAULT_ROWS, AccessRow, EntryPoint
from gateway.routing.rights import Rights
from gateway.routing.router import Router

_SCADA = EntryPoint("scada")


def _nobody_listens(event: Event) -> None:
    pass


def router(
    routes: Mapping[int, Target],
    emit: Emit = _nobody_listens,
    *,
    rows: Iterable[AccessRow] = DEFAULT_ROWS,
    entry: EntryPoint = _SCADA,
    now: float = 0.0,
    kind: type[Router] = Router,
) -> Router:
    """A router whose clock stands at `now`."""
    made = kind(entry, lambda: now, emit)
    made.routes = routes
    made.rights = Rights(rows, entry)
    return made


def to_everywhere(target: Target) -> Router:
    """A router that leads from every unit to the same target."""
    return router(dict.fromkeys(range(256), target))
