"""The routers of requests that come by no listener and no server line. Add-ons have their own."""

from collections.abc import Callable
from typing import NamedTuple

from gateway.routing.access import EntryPoint
from gateway.routing.router import Router

#: Makes one without routes.
MakeRouter = Callable[[EntryPoint], Router]


class Routers(NamedTuple):
    """A router for each other entrance of the gateway. A reload keeps them, and gives them other routes and rights."""

    #: Of the control socket: all rights until a row names it.
    control: Router
    #: Of requests over HTTP: all rights until a row names it. What a user may do is checked before.
    web: Router
    #: Of the program that the gateway is a part of, and of units made in Python: all rights until a row names it.
    embedded: Router
