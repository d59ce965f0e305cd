"""The routers of requests that come by no listener and no server line."""

from collections.abc import Callable
from typing import Literal, NamedTuple, Self

from gateway.config.values.reserved_names import CONTROL, FLEET, MQTT, WEB
from gateway.events import Emit
from gateway.routing.access import EntryPoint
from gateway.routing.router import Router
from gateway.trace.ring import Ring


class Routers(NamedTuple):
    """One for each other way into the gateway. A reload keeps them, and gives them other routes and rights."""

    #: That of the control socket: it has all rights until a row names it.
    control: Router
    #: That of requests over HTTP: it too has all rights until a row names it. What a user may do is checked before.
    web: Router
    #: That of what a broker delivers: it has all rights until a row names it. What may be written is checked before.
    mqtt: Router
    #: That of requests from other sites: they only read until a row names it.
    sites: Router

    @classmethod
    def without_routes(cls, clock: Callable[[], float], emit: Emit, ring: Ring) -> Self:
        """Make them; `Running.apply` gives them routes."""

        def router(name: str, kind: Literal["local", "site"] = "local") -> Router:
            return Router(EntryPoint(name, kind), clock, emit, ring=ring)

        return cls(router(CONTROL), router(WEB), router(MQTT), router(FLEET, "site"))
