"""What publishes: the devices of a gateway, a form of messages, and the task that keeps the connection.

Loaded only if configured, and the library with it.
"""

import asyncio
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Final

from gateway import events
from gateway.clock.beside import end
from gateway.config.plan.settings import MqttPlan
from gateway.config.values.broker import HOME_ASSISTANT
from gateway.images.drivers.polls_driver import Pollers
from gateway.plant.commands import CarriedOut
from gateway.plant.driver import PublisherDriver
from gateway.plant.kept.history import History
from gateway.plant.kept.keeper import Keeper
from gateway.plant.messages import Form, Message
from gateway.plant.plain import PlainForm
from gateway.plant.publisher import PublisherSettings
from gateway.plant.sparkplug import Sparkplug
from gateway.plant.status import BrokerStatus
from gateway.plant.topics import Topics
from gateway.readconfig.libraries import not_installed
from gateway.readconfig.password import read_password
from gateway.request import Target
from gateway.routing.router import Router
from gateway.runtime.gateway import Gateway
from gateway.runtime.mqtt.announcing import Announcing
from gateway.runtime.polls import polls_of
from gateway.tls.contexts import load
from gateway.tls.store import TlsStore

#: How long the last messages may take at a stop, in seconds.
_STOPPING_TIME: Final = 1.2


def reading(
    plan: MqttPlan,
    gateway: Gateway,
    router: Router,
    pollers: Pollers,
    emit: events.Emit,
    carried_out: CarriedOut,
    unix: Callable[[], float] = time.time,
    announcements: Sequence[Message] = (),
    keeper: Keeper | None = None,
) -> PublisherDriver:
    """Begin to read what the plan publishes of a gateway, by the routes of `router`, with the polls of its units.

    `announcements` are sent with each birth. What cannot be published goes to the `keeper`.
    """
    polls = {name: polls_of(each, pollers) for name, each in _destinations(plan, router).items()}
    patience = gateway.longest_waits
    waits = {each.name: patience.get(each.name, 0.0) for each in plan.devices}
    settings = PublisherSettings(plan.devices, waits, plan.source)
    form = _form(plan, announcements)
    history = None if keeper is None else History(keeper, form)
    driver = PublisherDriver(settings, form, polls, router, emit, unix, carried_out, history)
    if keeper is not None:
        keeper.ready, keeper.before_write = driver.look, driver.hold_slow
    driver.start()
    return driver


class Publication:
    """What one plan needs: the devices of a gateway, and the task that keeps the connection."""

    def __init__(
        self,
        plan: MqttPlan,
        gateway: Gateway,
        router: Router,
        pollers: Pollers,
        emit: events.Emit,
        contexts: TlsStore,
        announcing: Announcing,
        carried_out: CarriedOut,
        unix: Callable[[], float],
        keeper: Keeper | None,
    ) -> None:
        self.plan = plan
        self._router = router
        self._announcing = announcing
        self._destinations = _destinations(plan, router)
        self._keeper = keeper
        self.driver = reading(plan, gateway, router, pollers, emit, carried_out, unix, announcing.messages, keeper)
        #: What keeps the connection; None if it cannot, because its library is missing.
        self.broker: Any = None
        self.reason = ""
        try:
            module = import_module("gateway.plant.broker")
        except ModuleNotFoundError as error:
            self.reason = not_installed(error.name, "mqtt")
            emit(events.BrokerLost(str(plan.broker), self.reason))
            return
        self.broker = module.Broker(
            str(plan.broker),
            _Access(plan, contexts, asyncio.get_running_loop()).settings,
            self.driver,
            emit,
            unix,
        )
        self._task = asyncio.create_task(self.broker.run(), name="broker")

    def means(self, plan: MqttPlan | None) -> bool:
        """Return whether it does what this plan asks for, with the devices that its units lead to now."""
        if plan != self.plan:
            return False
        new = _destinations(self.plan, self._router)
        return all(new[name] is each for name, each in self._destinations.items())

    def status(self) -> BrokerStatus:
        """Return the state of the connection, and the counters."""
        publisher, broker = self.driver.publisher, self.broker
        reason = self.reason if broker is None else broker.reason
        now = asyncio.get_running_loop().time()
        refused_at = broker.counts.refused_at if broker is not None and broker.counts.refused else None
        return BrokerStatus(
            broker=str(self.plan.broker),
            source=self.plan.source,
            state="down" if reason else "up",
            reason=reason,
            down_ms=self._down_ms(),
            version="" if broker is None else broker.version,
            attempts=0 if broker is None else broker.attempts,
            devices=len(publisher.watches),
            available=sum(watch.is_available for watch in publisher.watches.values()),
            points=sum(len(device.points) for device in self.plan.devices),
            messages=0 if broker is None else broker.counts.confirmed,
            refused_messages=0 if broker is None else broker.counts.refused,
            commands=publisher.commands.counts.received,
            refused_commands=publisher.commands.counts.refused,
            polls=self.driver.counts.polls,
            failed_polls=self.driver.counts.failed,
            last_refused_ms=None if refused_at is None else 1000 * (now - refused_at),
            unsteady="" if broker is None else broker.unsteady,
            up_ms=None if broker is None or broker.up_since is None else 1000 * (now - broker.up_since),
            messages_per_s=0.0 if broker is None else broker.counts.per_second(now),
            waiting=publisher.waiting,
            kept=None if self._keeper is None else self._keeper.status,
        )

    def _down_ms(self) -> float | None:
        since = None if self.broker is None else self.broker.down_since
        return None if since is None else 1000 * (asyncio.get_running_loop().time() - since)

    async def stop(self, *, is_over: bool = False) -> None:
        """Publish that it is offline, and stop. If it `is_over`, clear the announcements at the broker too."""
        self.driver.close()
        if self.broker is None:
            return
        is_up = self.broker.reason == ""
        self.broker.stop(self._announcing.withdrawal() if is_over else ())
        try:
            if is_up:
                await asyncio.wait((self._task,), timeout=_STOPPING_TIME)
                self._announcing.done()
        finally:
            await end(self._task)
        if is_over and self.broker.has_left:
            self._announcing.withdrawn()


@dataclass(frozen=True, slots=True)
class _Access:
    """How the broker is reached. Files are read for each connection, so that new ones count at once."""

    plan: MqttPlan
    contexts: TlsStore
    loop: asyncio.AbstractEventLoop

    def settings(self) -> Any:
        """Read the files. Blocks.

        Raises:
            BrokerError: the password cannot be read.
            TlsError: a certificate cannot be used.
        """
        plan, context = self.plan, None
        for secured in plan.secured:
            loaded = load(secured.settings)
            self.loop.call_soon_threadsafe(self.contexts.add, {secured: loaded})
            context = loaded.context
        address = plan.broker.address
        return import_module("gateway.plant.client").BrokerSettings(
            host=address.host,
            port=address.port,
            path=plan.broker.path,
            client=f"mbgw-{plan.site}",
            user=plan.user,
            password=None if plan.password is None else read_password(plan.password),
            context=context,
            server_name="" if plan.tls is None else plan.tls.server_name,
        )


def _destinations(plan: MqttPlan, router: Router) -> Mapping[str, Target]:
    """Find what answers for each published device."""
    return {device.name: router.routes[device.unit] for device in plan.devices}


def _form(plan: MqttPlan, announcements: Sequence[Message]) -> Form:
    if plan.sparkplug is None:
        return PlainForm(Topics(plan.site, plan.prefix), plan.devices, announcements, _hosts(plan.home_assistant))
    names = plan.sparkplug
    return Sparkplug(names.group, names.node or plan.site, plan.devices, names.primary_host or None, announcements)


def _hosts(prefix: str | None) -> Sequence[str]:
    """List the topics where Home Assistant may announce its start: its default does not follow the discovery prefix."""
    return () if prefix is None else tuple({f"{each}/status": None for each in (prefix, HOME_ASSISTANT)})
