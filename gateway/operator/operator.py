"""The running gateway, as operations see it."""

import time
from collections.abc import Callable
from functools import wraps
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
        self._made: tuple[Gateway | None, dict[Callable[[Operator], Any], Any]] = None, {}

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

    def made(self, make: Callable[["Operator"], K]) -> K:
        """Return what `make` makes of the present gateway; made again after a reload. Any thread may call this."""
        gateway, made = self._made
        if gateway is not self.gateway:
            self._made = self.gateway, (made := {})
        if make not in made:
            made[make] = make(self)
        found: K = made[make]
        return found


def until_reload(make: Callable[[Operator], K]) -> Callable[[Operator], K]:
    """Let a function remember what it returns until a reload makes another gateway."""

    @wraps(make)
    def remembered(operator: Operator) -> K:
        return operator.made(make)

    return remembered
