"""A running gateway: starts, switches to another config, drains, and stops."""

import asyncio
from collections.abc import AsyncIterator, Callable, Iterable, Mapping
from contextlib import asynccontextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Final

from gateway import events
from gateway.config.plan.settings import Plan
from gateway.config.values.reserved_names import CONTROL, EMBEDDED, WEB
from gateway.errors import PortError
from gateway.images.custom_unit import CustomUnit
from gateway.images.drivers.polls_driver import Pollers
from gateway.listeners.programs import ProgramListener
from gateway.listeners.serial import SerialListener
from gateway.listeners.sockets import OpenSockets
from gateway.listeners.tls import TlsListener
from gateway.ports.port import Opener
from gateway.routing.access import EntryPoint
from gateway.routing.rights import Rights
from gateway.routing.router import NamingRouter
from gateway.runtime.add_on import AddOn
from gateway.runtime.add_ons import AddOns
from gateway.runtime.build import Builder
from gateway.runtime.custom_images import CustomImages, MadeUnits
from gateway.runtime.draining import until
from gateway.runtime.gateway import Driver, Gateway, Listener
from gateway.runtime.kept_state import KeptState
from gateway.runtime.listening import Listening
from gateway.runtime.open_ports import OpenPorts
from gateway.runtime.reads import keep_reads
from gateway.runtime.recent import Recent
from gateway.runtime.routers import Routers
from gateway.runtime.self_state import show_itself
from gateway.tls.store import TlsStore
from gateway.trace.ring import Ring

#: How long commands, and clients at the start, wait for lines that were not tried yet, in seconds. One that has to be
#: silent for longer after connecting is no reason to refuse the clients of others.
LONGEST_START: Final = 10.0


class Running:
    """A running gateway, and what outlives its reloads: its other routers, ring, certificates and add-ons.

    `opener` opens ports, `kept` is the state that outlives the process, `sockets` are those that were bound before the
    process started. `units` are made by the program, by the number that clients use; modules with others may lie in
    `folder`, and `made` are those of them that were made before.
    """

    def __init__(
        self,
        plan: Plan,
        opener: Opener,
        emit: events.Emit,
        kept: KeptState | None = None,
        *,
        contexts: TlsStore | None = None,
        sockets: OpenSockets | None = None,
        units: Mapping[int, CustomUnit] | None = None,
        folder: Path | None = None,
        made: MadeUnits | None = None,
    ) -> None:
        loop, kept = asyncio.get_running_loop(), kept or KeptState()
        self.emit = emit
        #: The last transactions.
        self.ring = Ring()
        #: The certificates in use.
        self.contexts = contexts or TlsStore()
        make_router = partial(NamingRouter, clock=loop.time, emit=emit, ring=self.ring)
        self.routers = Routers(*(make_router(EntryPoint(name, "local")) for name in (CONTROL, WEB, EMBEDDED)))
        pollers = Pollers(loop, emit)
        self.add_ons = AddOns.without_plan(make_router, emit, self.contexts, kept, pollers)
        self.builder = Builder(
            loop=loop,
            emit=emit,
            ring=self.ring,
            memory=kept.memory,
            store=kept.store,
            contexts=self.contexts,
            opener=opener,
            open_site=self.add_ons.fleet.opener,
            buckets=self.add_ons.fleet.bucket,
            pollers=pollers,
            custom=CustomImages(loop, emit, self.ring, units, folder, made),
        )
        #: The address of the web page, or why there is none though the config has one.
        self.page = ""
        self.page_trouble = ""
        #: Set while clients can connect and no stop was ordered.
        self.ready = asyncio.Event()
        #: Whether the config was accepted when it was last read.
        self.reload_succeeded = True
        self.troubles = kept.troubles
        #: Held during a search for devices: two at once would disturb each other.
        self.examining = asyncio.Lock()
        self.ports = OpenPorts(emit, kept.left_behind)
        self._listening = Listening(sockets or OpenSockets())
        self.started = loop.time()
        #: Until when requests of operators wait for lines that were not tried yet.
        self._settles_by = 0.0
        self.gateway = self.builder.build(plan)
        self.recent = Recent(self.gateway, self.started)
        self.apply(self.gateway)

    def apply(self, gateway: Gateway) -> None:
        """Apply the plan of this gateway to all requests from now on: in one step, so that none sees a mixture.

        Images load their values before requests reach them. Add-ons come after that: they compare the devices that they
        use with the new routes.
        """
        self.ring.resize(gateway.plan.ring)
        gateway.load_images()
        self._route(gateway)
        gateway.adopt_plan()
        keep_reads(self.gateway, gateway)
        for each in self.add_ons:
            each.rerouted(gateway)
        self.gateway = gateway
        self.ports.present = gateway.parts
        self._settles_by = asyncio.get_running_loop().time() + LONGEST_START
        show_itself(self)

    def _route(self, gateway: Gateway) -> None:
        """Give each router its routes and rights."""
        others = ((router, gateway.everywhere) for router in (*self.routers, *(each.router for each in self.add_ons)))
        for router, reach in (*others, *gateway.routings):
            router.routes = dict(reach.routes)
            router.rights = Rights(gateway.plan.access, router.entry, reach.known_as)

    async def bind(self) -> None:
        """Bind the addresses of all listeners.

        Raises:
            ListenError: one of them cannot be used, or an inherited socket belongs to no listener.
        """
        await self._listening.bind(self.gateway.listeners)

    @asynccontextmanager
    async def lines_open(self) -> AsyncIterator[None]:
        """Open the port of every line and keep it open. At the end all are closed."""
        self.ports.start(self.gateway.parts)
        try:
            yield
        finally:
            try:
                await self.ports.end_all()
            finally:
                for each in self.gateway.polling_units:
                    each.close()
                await self.builder.custom.close()

    async def tried(self) -> None:
        """Wait as `settled` does, then start the polls of mirrors and virtual units."""
        await self.settled()
        self._start_units()

    async def settled(self) -> None:
        """Wait until every line was tried once, at most until LONGEST_START seconds after the last change of parts."""
        with suppress(TimeoutError):
            async with asyncio.timeout_at(self._settles_by):
                for part in self.gateway.parts:
                    await part.reconnector.tried.wait()

    def start_listening(self) -> None:
        """Accept clients.

        Raises:
            ListenError: another program has taken an address meanwhile.
        """
        for listener in self.gateway.listeners:
            listener.listen()
        self._listening.start(self.gateway.listeners)

    def stop_listening(self) -> None:
        """Drop all clients."""
        for listener in self._listening.all_with(self.gateway.listeners):
            listener.close()

    async def connect_add_ons(self) -> None:
        """Let each add-on connect as the plan says."""
        for each in self.add_ons:
            await each.connect(self.gateway)

    async def start_add_ons(self) -> None:
        """Let each add-on do what the plan says; other sites do not wait for a broker that is left, for a second."""
        for each in reversed(self.add_ons):
            await each.serve(self.gateway)

    async def drain(self, is_urgent: Callable[[], bool]) -> None:
        """Take no more clients and requests, and let those in progress finish, unless that becomes urgent.

        Requests that are not finished after DRAIN_TIME are answered as if their line was lost: 0B if sent, 0A if not.
        """
        listeners, drivers = self._listening.all_with(self.gateway.listeners), self.ports.drivers
        servers = [driver for driver in drivers if isinstance(driver, SerialListener | ProgramListener)]
        for end in (*listeners, *servers):
            end.finish()
        await until(lambda: is_urgent() or not (_any_under_way(listeners, servers, self.add_ons)))
        for driver in drivers:
            if driver not in servers:
                driver.port_down(PortError("the gateway is stopping"))
        self.builder.custom.keep(())

    async def switch(self, new: Gateway) -> None:
        """Switch to another gateway. Parts that both have are not interrupted.

        The new addresses come first, as they may be in use. Then, in one step, requests take the new routes. In the end
        removed parts finish what is in progress, and new ones open their ports as soon as these are free.

        Raises:
            ListenError: as `bind`; nothing has changed.
        """
        old = self.gateway
        gone = [listener for listener in old.listeners if listener not in new.listeners]
        come = [listener for listener in new.listeners if listener not in old.listeners]
        await self._listening.take_addresses(gone, come, new.listeners)
        self._listening.finish(gone)
        self.apply(new)
        _close_units(old, new)
        self.builder.custom.keep(new.images)
        self._listening.start(come)
        async with asyncio.TaskGroup() as group:
            self._listening.retire(gone, group)
            self.ports.replace(old.parts, new.parts, group)
            self._start_units()
            await self.connect_add_ons()
            await self.start_add_ons()

    def _start_units(self) -> None:
        """Start the polls of mirrors and virtual units; those that poll already go on."""
        for each in self.gateway.polling_units:
            each.start()

    def renew_certificates(self) -> None:
        """Make clients that may not be trusted any more show their certificates again, after a reload."""
        for listener in self.gateway.listeners:
            if isinstance(listener, TlsListener):
                listener.renew()


def _close_units(old: Gateway, new: Gateway) -> None:
    """Close the mirrors and virtual units that are gone. What virtual units had that are new goes to these."""
    before = {each.name: each for each in old.virtual}
    for one in new.virtual:
        same = before.get(one.name)
        if same is not None and same is not one:
            one.unit.take_over(same.unit)
    for each in old.polling_units:
        if each not in new.polling_units:
            each.close()


def _any_under_way(listeners: Iterable[Listener], drivers: Iterable[Driver], add_ons: Iterable[AddOn]) -> bool:
    """Return whether a client still waits for a response."""
    return any(one.has_clients for one in listeners) or any(one.is_busy for one in (*drivers, *add_ons))
