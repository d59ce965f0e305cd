"""`[mqtt]`: what is published, as long as the config says so. What does it is loaded only then."""

import asyncio
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from importlib import import_module
from typing import TYPE_CHECKING

from gateway import events
from gateway.config.plan.settings import MqttPlan
from gateway.plant.status import BrokerStatus
from gateway.routing.router import Router
from gateway.runtime.announced import AnnouncedDevices
from gateway.runtime.gateway import Gateway
from gateway.tls.store import TlsStore

if TYPE_CHECKING:
    from gateway.plant.commands import CarriedOut
    from gateway.runtime.publication import Publication


class Publishing:
    """Publishes what the plan of a gateway says, as long as it says so.

    `router` has the routes of what is read, and of what the broker delivers. `announced` is what Home Assistant was
    told. `unix` is the time of the day.
    """

    def __init__(
        self,
        router: Router,
        emit: events.Emit,
        contexts: TlsStore,
        announced: AnnouncedDevices,
        unix: Callable[[], float] = time.time,
    ) -> None:
        self._router = router
        self._emit = emit
        self._contexts = contexts
        self._announced = announced
        self._unix = unix
        self._carried_out: CarriedOut | None = None
        #: What publishes; None without [mqtt].
        self.part: Publication | None = None

    def rerouted(self, plan: MqttPlan | None) -> None:
        """Take no more commands for what is published, unless it is the same by the routes that apply now."""
        if self.part is not None and not self.part.means(plan):
            self.part.driver.close()

    async def adopt(self, gateway: Gateway) -> None:
        """Publish what this gateway's plan says from now on. Without a change the connection is kept."""
        plan, part = gateway.plan.mqtt, self.part
        if part is not None and part.means(plan):
            return
        await self.stop(is_over=plan is None)
        if plan is not None:
            announcing = await import_module("gateway.runtime.announcing").Announcing.of(plan, self._announced)
            publication = import_module("gateway.runtime.publication").Publication
            if self._carried_out is None:
                self._carried_out = import_module("gateway.plant.commands").CarriedOut()
            self.part = publication(
                plan, gateway, self._router, self._emit, self._contexts, announcing, self._carried_out, self._unix
            )

    def status(self) -> BrokerStatus | None:
        """Tell the state of the broker; None without [mqtt]."""
        return None if self.part is None else self.part.status()

    @asynccontextmanager
    async def stopping(self) -> AsyncIterator[None]:
        """Stop, beside what is done in the context."""
        if self.part is None:  # a turn of the event loop would let lines open that were not tried yet
            yield
            return
        async with asyncio.TaskGroup() as group:
            group.create_task(self.stop(), name="mqtt: stop")
            yield

    async def stop(self, *, is_over: bool = False) -> None:
        """Stop publishing, for good if it `is_over`."""
        part, self.part = self.part, None
        if part is not None:
            await part.stop(is_over=is_over)
