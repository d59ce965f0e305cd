"""The gateway at work, as operations see it."""

import time
from collections.abc import Callable
from typing import Any, Literal, TypeVar

from gateway.routing.router import Router
from gateway.runtime.gateway import Gateway
from gateway.runtime.reload import Reloader
from gateway.runtime.running import Running
from gateway.timing.history import History

K = TypeVar("K")

#: Where operations are asked for: what [[access]] says of this counts.
Door = Literal["control", "web"]


class Operator:
    """What operations are asked of: the `running` gateway, and what reads its config again.

    `clock` gives seconds since 1970. There is a `history` while `[web]` keeps one.
    """

    def __init__(self, running: Running, reloader: Reloader, clock: Callable[[], float] = time.time) -> None:
        self.running = running
        self.reloader = reloader
        self.clock = clock
        self.history: History | None = None
        self._kept: dict[type[Any], Any] = {}

    @property
    def gateway(self) -> Gateway:
        """Give the gateway as it is now: a reload makes another one."""
        return self.running.gateway

    def router(self, door: Door) -> Router:
        """Give the router of all who ask through this door."""
        routers = self.running.routers
        return routers.web if door == "web" else routers.control

    def kept(self, kind: type[K]) -> K:
        """Give what an operation keeps for those who ask later: made when it is needed for the first time."""
        if kind not in self._kept:
            self._kept[kind] = kind()
        found: K = self._kept[kind]
        return found
