"""`[mqtt]`: publishes values, while the config says so. Its code is loaded only then."""

import time
from collections.abc import Iterator
from importlib import import_module
from typing import TYPE_CHECKING, ClassVar

from gateway import events
from gateway.config.plan.settings import MqttPlan
from gateway.config.values.reserved_names import MQTT
from gateway.diagnosis.finding import Finding
from gateway.images.drivers.polls_driver import Pollers
from gateway.observe.families import Family
from gateway.plant.status import BrokerStatus
from gateway.routing.access import EntryPoint
from gateway.runtime.add_on import AddOn
from gateway.runtime.gateway import Gateway
from gateway.runtime.kept_state import KeptState
from gateway.runtime.mqtt.announced import FILE_NAME, AnnouncedDevices, is_entry
from gateway.runtime.mqtt.findings import findings_about
from gateway.runtime.mqtt.metrics import metrics_of
from gateway.runtime.routers import MakeRouter
from gateway.tls.store import TlsStore

if TYPE_CHECKING:
    from gateway.plant.commands import CarriedOut
    from gateway.plant.kept.keeper import Keeper
    from gateway.runtime.mqtt.publication import Publication


class Publishing(AddOn):
    """Publishes what the plan of a gateway says, while it says so.

    Its router carries reads, and writes that the broker delivers. It has all rights until a row names it: what may be
    written is checked before.
    """

    key: ClassVar = MQTT
    shown_as: ClassVar = "brokers"

    def __init__(
        self, router: MakeRouter, emit: events.Emit, contexts: TlsStore, kept: KeptState, pollers: Pollers
    ) -> None:
        super().__init__(router(EntryPoint(MQTT, "local")))
        self._emit = emit
        self._contexts = contexts
        self._pollers = pollers
        self._announced = AnnouncedDevices(kept.open_file(FILE_NAME, is_entry))
        self._folder = kept.folder
        self._keeper: Keeper | None = None
        self._carried_out: CarriedOut | None = None
        #: The present publication; None without [mqtt].
        self.part: Publication | None = None

    def rerouted(self, gateway: Gateway) -> None:
        """Take no more commands, unless the same devices are published by the routes that apply now."""
        if self.part is not None and not self.part.means(gateway.plan.mqtt):
            self.part.driver.close()

    async def serve(self, gateway: Gateway) -> None:
        """Publish what this gateway's plan says from now on. An unchanged connection is kept."""
        plan, part = gateway.plan.mqtt, self.part
        if part is not None and part.means(plan):
            return
        await self._stop_part(is_over=plan is None)
        await self._keep_for(plan)
        if plan is not None:
            announcing = await import_module("gateway.runtime.mqtt.announcing").Announcing.of(plan, self._announced)
            publication = import_module("gateway.runtime.mqtt.publication").Publication
            if self._carried_out is None:
                self._carried_out = import_module("gateway.plant.commands").CarriedOut()
            self.part = publication(
                plan,
                gateway,
                self.router,
                self._pollers,
                self._emit,
                self._contexts,
                announcing,
                self._carried_out,
                time.time,
                self._keeper,
            )

    async def stop(self) -> None:
        """Stop publishing, and write what is kept."""
        await self._stop_part()
        await self._keep_for(None)

    async def _keep_for(self, plan: MqttPlan | None) -> None:
        """Keep what this plan cannot publish, if it says so; what is kept outlives a reload."""
        most, every = (0, 0.0) if plan is None else (plan.keep, plan.keep_every)
        keeper = self._keeper
        if keeper is not None and (keeper.most, keeper.every) != (most, every):
            self._keeper = None
            await keeper.close()
        if self._keeper is None and most:
            keeper_of = import_module("gateway.plant.kept.keeper").Keeper
            self._keeper = keeper_of(self._folder, most, every, self._emit)

    async def _stop_part(self, *, is_over: bool = False) -> None:
        """Stop publishing, for good if it `is_over`."""
        part, self.part = self.part, None
        if part is not None:
            await part.stop(is_over=is_over)

    def status(self) -> BrokerStatus | None:
        """Return the state of the broker; None without [mqtt]."""
        return None if self.part is None else self.part.status()

    def metrics(self) -> Iterator[Family]:
        """Return the metrics of messages, commands and polls."""
        return metrics_of(self.status())

    def findings(self) -> Iterator[Finding]:
        """Check whether the broker accepts what is published."""
        return findings_about(self.status())
