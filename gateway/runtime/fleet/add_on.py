"""`[fleet]`: the connection to other sites. Its code is loaded only if the config names NATS servers."""

import asyncio
import os
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from importlib import import_module
from typing import TYPE_CHECKING, Any, ClassVar, Final

from gateway import events
from gateway.config.plan.settings import FleetPlan
from gateway.config.values.reserved_names import FLEET
from gateway.diagnosis.finding import Finding
from gateway.errors import FleetError, PortError
from gateway.fleet.counts import LostMessages, OwnerCounts
from gateway.fleet.inventory import OwnInventory
from gateway.fleet.settings import Login, Server
from gateway.fleet.status import FleetStatus
from gateway.observe.families import Family
from gateway.ports.port import OpenPort, Port, PortUser, SiteSettings
from gateway.readconfig.libraries import not_installed
from gateway.readconfig.password import read_password, read_secret
from gateway.routing.access import EntryPoint
from gateway.runtime.add_on import AddOn
from gateway.runtime.fleet.findings import findings_about, findings_about_upstream
from gateway.runtime.fleet.known_sites import KnownSites
from gateway.runtime.fleet.metrics import metrics_of, metrics_of_sites
from gateway.runtime.fleet.presence import served_units, tell
from gateway.runtime.gateway import Gateway
from gateway.runtime.routers import MakeRouter
from gateway.tls.contexts import load
from gateway.tls.store import TlsStore

if TYPE_CHECKING:
    from gateway.fleet.bucket import Bucket
    from gateway.fleet.exchange import Exchange
    from gateway.fleet.link import Link
    from gateway.fleet.presence import Presence
    from gateway.fleet.serving import Serving
    from gateway.fleet.status import SiteStatus

#: How long each step of leaving may take, in seconds.
_LEAVING_TIME: Final = 1.0
#: The name of this process for deadlines.
_INSTANCE: Final = os.urandom(6).hex()


class Fleet(AddOn):
    """The connection to other sites, while the plan names NATS servers. They may only read until a row names them."""

    key: ClassVar = FLEET
    shown_as: ClassVar = "fleets"

    def __init__(self, router: MakeRouter, emit: events.Emit, contexts: TlsStore) -> None:
        super().__init__(router(EntryPoint(FLEET, "site")))
        #: The clock of deadlines.
        self.clock: Callable[[], float] = _clock
        self._emit = emit
        self._contexts = contexts
        self._started = asyncio.get_running_loop().time()
        #: The gateway that other sites reach; None until clients can connect.
        self._gateway: Gateway | None = None
        self._has_left = False
        #: What other sites are told beside the state of this one; None until somebody has looked.
        self.inventory: OwnInventory | None = None
        self._known = KnownSites(self._read_sites)
        self._task: asyncio.Task[None] | None = None
        self.plan: FleetPlan | None = None
        #: Why no other site can be reached while there is no `link`.
        self.reason = "there is no [fleet]"
        #: The connection, requests to other sites and from them, and their list; None without [fleet] or its library.
        self.link: Link | None = None
        self.exchange: Exchange | None = None
        self.serving: Serving | None = None
        self.presence: Presence | None = None

    def opener(self, site: str) -> OpenPort:
        """Make the function that opens the port to another site."""

        async def open_port(user: PortUser) -> Port:
            if self.exchange is None:
                raise PortError(f"fleet://{site}: {self.reason}")
            return await self.exchange.open(site, user)

        return open_port

    async def bucket(self, name: str) -> "Bucket":
        """Open a bucket of the key-value store.

        Raises:
            FleetError: NATS cannot be reached, or it has none.
        """
        link = self.link
        if link is None or link.connection is None:
            raise FleetError(f"NATS cannot be reached: {self.reason if link is None else link.reason}")
        return await link.connection.bucket(name)

    def rerouted(self, gateway: Gateway) -> None:
        """Report this gateway to other sites from now on, once clients can connect."""
        if self._gateway is not None:
            self._gateway = gateway

    async def connect(self, gateway: Gateway) -> None:
        """Connect as the plan says. An unchanged connection is kept; only the units that are served may change."""
        plan = gateway.plan.fleet
        if plan != self.plan:
            await self.stop()
            self.plan = plan
            if plan is not None:
                self._connect(plan)
        await self._refresh()

    def _connect(self, plan: FleetPlan) -> None:
        servers = [Server(each.host, each.port, each.scheme == "tls") for each in plan.servers]
        try:
            link: Link = import_module("gateway.fleet.link").Link(servers, _login(plan, self._contexts), self._emit)
        except ModuleNotFoundError as error:
            self.reason = not_installed(error.name, "fleet")
            self._emit(events.FleetLost(str(plan.servers[0]), self.reason))
            return
        self.link = link
        self.exchange = import_module("gateway.fleet.exchange").Exchange(plan.site, lambda: link.reason)
        self.serving = import_module("gateway.fleet.serving").Serving(
            plan.site, _INSTANCE, self.router, self.clock, self._emit
        )
        self.presence = import_module("gateway.fleet.presence").Presence(plan.site, self._told, self._emit, time.time)
        self._task = asyncio.create_task(link.run(self.exchange, self.serving, self.presence), name="fleet")

    async def serve(self, gateway: Gateway) -> None:
        """Let other sites reach the present units."""
        self._gateway = gateway
        await self._refresh()

    async def _refresh(self) -> None:
        """Update which units other sites reach."""
        if self.serving is not None:
            await self.serving.serve(self._units)

    def _units(self) -> Iterator[int]:
        return iter(()) if self._gateway is None or self._has_left else served_units(self._gateway, self.router)

    def _told(self) -> Mapping[str, Any]:
        if self._gateway is None:
            return {}
        now = asyncio.get_running_loop().time()
        return tell(self._gateway, self.router, now - self._started, self.inventory, now)

    @property
    def is_busy(self) -> bool:
        """Whether another site waits for a response."""
        return self.serving is not None and self.serving.owner.under_way > 0

    async def leave(self) -> None:
        """Take no more requests, and announce that this site leaves, unless NATS takes too long."""
        self._has_left = True
        with suppress(TimeoutError):
            async with asyncio.timeout(_LEAVING_TIME):
                await self._refresh()
                if self.presence is not None:
                    await self.presence.leave()

    async def stop(self) -> None:
        """Send what waits, and stop."""
        task, self._task = self._task, None
        self.plan = self.link = self.exchange = self.serving = self.presence = None
        self.reason = "there is no [fleet]"
        if task is not None:
            task.cancel()
            await asyncio.wait((task,), timeout=_LEAVING_TIME)

    @property
    def is_connected(self) -> bool:
        """Whether NATS is reached."""
        return self.link is not None and self.link.connection is not None

    async def sites(self, kept: float = 0.0) -> "Sequence[SiteStatus]":
        """List all sites, by name; the list may be `kept` seconds old.

        Raises:
            FleetError: NATS cannot be reached, or has no list of them.
        """
        return await self._known.all(kept)

    async def look(self) -> None:
        """Look at the sites that this one asks."""
        upstreams = () if self._gateway is None else self._gateway.plan.upstreams
        await self._known.look({each.port.site for each in upstreams if isinstance(each.port, SiteSettings)})

    async def _read_sites(self, only: Collection[str] | None = None) -> "Sequence[SiteStatus]":
        if self.presence is None or self.link is None or self.link.connection is None:
            raise FleetError(self.reason if self.link is None else f"NATS cannot be reached: {self.link.reason}")
        return tuple(self._as_heard(each) for each in await self.presence.sites(only))

    def _as_heard(self, status: "SiteStatus") -> "SiteStatus":
        """Show a site as silent if its units do not respond: its entry expires only much later."""
        silence = None if self.exchange is None else self.exchange.silence(status.site)
        if silence is None or status.state != "up":
            return status
        return replace(status, state="silent", for_s=round(silence, 1))

    def status(self) -> FleetStatus | None:
        """Return the state of the connection, and its counters; None without [fleet]."""
        plan, link = self.plan, self.link
        if plan is None:
            return None
        counts = OwnerCounts() if self.serving is None else self.serving.owner.counts
        messages = LostMessages() if link is None else link.messages
        down_since = None if link is None else link.down_since
        up_since = None if link is None else link.up_since
        reason = self.reason if link is None else link.reason
        now = asyncio.get_running_loop().time()
        return FleetStatus(
            server=str(plan.servers[0] if link is None else link.server),
            source=plan.source,
            site=plan.site,
            state="down" if reason else "up",
            reason=reason,
            unseen="" if self.presence is None else self.presence.reason,
            down_ms=None if down_since is None else 1000 * (now - down_since),
            attempts=0 if link is None else link.attempts,
            requests=counts.requests,
            responses=counts.responses,
            busy=counts.busy,
            expired=counts.expired,
            refused=counts.refused,
            dropped=counts.dropped,
            unreadable=messages.unreadable,
            overflowed=messages.overflowed,
            last_dropped_ms=1000 * (now - counts.dropped_at) if counts.dropped else None,
            up_ms=None if up_since is None else 1000 * (now - up_since),
            server_version="" if link is None or link.connection is None else link.connection.server_version,
        )

    def metrics(self) -> Iterable[Family]:
        """Return the metrics of requests from other sites, and of the sites that this one asks."""
        return (*metrics_of(self.status()), *metrics_of_sites(self._known.asked))

    def findings(self) -> Iterator[Finding]:
        """Check whether NATS is reached, and delivers only what it should."""
        return findings_about(self.status())

    def findings_about_upstream(self, name: str, site: str, error: object) -> Iterator[Finding]:
        """Say why the `site` of the upstream `name` is not reached."""
        return findings_about_upstream(self.status(), name, site, error)


def _clock() -> float:
    """Read the clock that is never set, and goes on while the machine sleeps."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


def _login(plan: FleetPlan, contexts: TlsStore) -> Callable[[], Login]:
    """Make the function that reads the login, for each connection: new files take effect at once."""
    loop = asyncio.get_running_loop()

    def read() -> Login:
        context = None
        for secured in plan.secured:
            loaded = load(secured.settings)
            loop.call_soon_threadsafe(contexts.add, {secured: loaded})
            context = loaded.context
        return Login(
            site=plan.site,
            user=plan.user,
            password=None if plan.password is None else read_password(plan.password, FleetError),
            credentials=None if plan.credentials is None else read_secret(plan.credentials, FleetError),
            context=context,
        )

    return read
