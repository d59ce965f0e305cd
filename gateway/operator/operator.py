"""The running gateway, as operations see it."""

import time
from collections.abc import Callable
from typing import Any, Literal, TypeVar

from gateway.observe.last_events import LastEvents
from gateway.routing.router import Router
from gateway.runtime.gateway import Gateway
from gateway.runtime.reload import Reloader
from gateway.runtime.running import Running
from gateway.timing.history import History

K = TypeVar("K")

#: Where an operation is asked for; [[access]] can have rules for each.
Door = Literal["control", "web", "embedded"]


class Operator:
    """What operations work on: the `running` gateway, and the `reloader` of its config.

    `clock` gives seconds since 1970. `events` are the last ones. There is a `history` while `[web]` keeps one.
    """

    def __init__(
        self,
        running: Running,
        reloader: Reloader,
        clock: Callable[[], float] = time.time,
        events: LastEvents | None = None,
    ) -> None:
        self.running = running
        self.reloader = reloader
        self.clock = clock
        self.events = events or LastEvents(clock)
        self.history: History | None = None
        self._kept: dict[type[Any], Any] = {}

    @property
    def gateway(self) -> Gateway:
        """The present gateway: a reload makes another one."""
        return self.running.gateway

    def router(self, door: Door) -> Router:
        """Return the router for requests through this door."""
        router: Router = getattr(self.running.routers, door)
        return router

    def kept(self, kind: type[K]) -> K:
        """Return what an operation keeps between requests, one object per `kind`; made on first use."""
        if kind not in self._kept:
            self._kept[kind] = kind()
        found: K = self._kept[kind]
        return found
