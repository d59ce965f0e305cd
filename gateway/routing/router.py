"""From a request to its target: one look-up for the route, one for the right."""

from collections.abc import Mapping
from dataclasses import dataclass

from gateway import errors, events
from gateway.request import Request, Target
from gateway.routing.access import allows


@dataclass(slots=True)
class Counts:
    """Requests that reached no target: without a route, without a right."""

    no_route: int = 0
    denied: int = 0


class Router:
    """The routes of one listener. Its policy for unit 0 is a route too: none, a broadcast, or that of another unit."""

    def __init__(self, routes: Mapping[int, Target], emit: events.Emit) -> None:
        self.routes = routes
        self.counts = Counts()
        self._emit = emit

    def submit(self, request: Request, now: float) -> None:
        """Hand the request to its unit's target. Without a route it is answered 0A, without a right 01."""
        target = self.routes.get(request.unit)
        if target is None:
            self.counts.no_route += 1
            refusal = errors.NoRoute("no such unit")
            self._emit(events.RequestRefused.of(request, refusal))
            request.fail(refusal)
        elif not allows(request.origin.may_write, request.pdu):
            self.counts.denied += 1
            self._emit(events.AccessDenied(request.origin.client, request.unit, request.pdu[0]))
            request.fail(errors.AccessDenied())
        else:
            target.submit(request, now)
