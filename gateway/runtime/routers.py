"""The routers of requests that come by no listener and no server line. Those of add-ons have theirs with them."""

from collections.abc import Callable
from typing import NamedTuple, Self

from gateway.config.values.reserved_names import CONTROL, WEB
from gateway.routing.access import EntryPoint
from gateway.routing.router import Router

#: Makes one without routes.
MakeRouter = Callable[[EntryPoint], Router]


class Routers(NamedTuple):
    """One for each other way into the gateway. A reload keeps them, and gives them other routes and rights."""

    #: That of the control socket: it has all rights until a row names it.
    control: Router
    #: That of requests over HTTP: it too has all rights until a row names it. What a user may do is checked before.
    web: Router

    @classmethod
    def without_routes(cls, router: MakeRouter) -> Self:
        """Make them; `Running.apply` gives them routes."""
        return cls(router(EntryPoint(CONTROL, "local")), router(EntryPoint(WEB, "local")))
