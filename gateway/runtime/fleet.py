"""`[fleet]`: the other sites, as long as the config names NATS servers. What knows them is loaded only then."""

import asyncio
import os
import time
from collections.abc import AsyncIterator, Callable, Iterable, Mapping
from contextlib import asynccontextmanager, suppress
from dataclasses import replace
from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

from gateway import events
from gateway.config.plan.settings import FleetPlan
from gateway.errors import FleetError, PortError
from gateway.fleet.counts import LostMessages, OwnerCounts
from gateway.fleet.settings import Login, Server
from gateway.fleet.status import FleetStatus
from gateway.ports.port import OpenPort, Port, PortUser
from gateway.readconfig.libraries import not_installed
from gateway.readconfig.password import read_password, read_secret
from gateway.routing.router import Router
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


class Fleet:
    """The other sites, as long as the plan of a gateway names NATS servers. Requests from there go to `sites`."""

    def __init__(
        self, sites: Router, emit: events.Emit, contexts: TlsStore, clock: Callable[[], float] | None = None
    ) -> None:
        """`clock` is the one that deadlines are told by."""
        self.clock = clock or _clock
        self._sites = sites
        self._emit = emit
        self._contexts = contexts
        self._units: Callable[[], Iterable[int]] = tuple
        self._tell: Callable[[], Mapping[str, Any]] = dict
        self._task: asyncio.Task[None] | None = None
        self.plan: FleetPlan | None = None
        #: Why no other site can be reached, if that is for longer.
        self.reason = "there is no [fleet]"
        #: What keeps the connection, asks other sites, and is asked by them; None without [fleet], or its library.
        self.link: Link | None = None
        self.exchange: Exchange | None = None
        self.serving: Serving | None = None
        self.presence: Presence | None = None

    def opener(self, site: str) -> OpenPort:
        """Make what opens the port to another site."""

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

    async def adopt(self, plan: FleetPlan | None) -> None:
        """Connect as the plan says. Without a change the connection is kept."""
        if plan == self.plan:
            return
        await self.stop()
        self.plan = plan
        if plan is None:
            return
        try:
            link = self._link(plan)
        except ModuleNotFoundError as error:
            self.reason = not_installed(error.name, "fleet")
            self._emit(events.FleetLost(str(plan.servers[0]), self.reason))
            return
        self.link = link
        self.exchange = import_module("gateway.fleet.exchange").Exchange(plan.site, lambda: link.reason)
        self.serving = import_module("gateway.fleet.serving").Serving(
            plan.site, _INSTANCE, self._sites, self.clock, self._emit
        )
        self.presence = import_module("gateway.fleet.presence").Presence(plan.site, self._told, self._emit, time.time)
        self._task = asyncio.create_task(link.run(self.exchange, self.serving, self.presence), name="fleet")
        await self.refresh()

    def _link(self, plan: FleetPlan) -> "Link":
        """Make the link. Raises ModuleNotFoundError without the library."""
        servers = [Server(each.host, each.port, each.scheme == "tls") for each in plan.servers]
        link: Link = import_module("gateway.fleet.link").Link(servers, _login(plan, self._contexts), self._emit)
        return link

    async def serve(
        self, units: Callable[[], Iterable[int]], tell: Callable[[], Mapping[str, Any]] | None = None
    ) -> None:
        """Let other sites reach the `units` that there are at the moment, and know what there is to `tell`."""
        self._units = units
        self._tell = tell or self._tell
        await self.refresh()

    async def refresh(self) -> None:
        """Look again which units other sites reach."""
        if self.serving is not None:
            await self.serving.serve(self._units)

    @asynccontextmanager
    async def stopping(self) -> AsyncIterator[None]:
        """Leave beside what is done in the context: take no more requests; those under way may be answered."""
        if self.serving is None:  # as in Publishing
            yield
            return
        async with asyncio.TaskGroup() as group:
            group.create_task(self._finish(), name="fleet: leave")
            yield

    async def _finish(self) -> None:
        """Say goodbye, unless NATS takes too long to hear it."""
        with suppress(TimeoutError):
            async with asyncio.timeout(_LEAVING_TIME):
                await self.serve(tuple)
                if self.presence is not None:
                    await self.presence.leave()

    def _told(self) -> Mapping[str, Any]:
        return self._tell()

    async def sites(self) -> "list[SiteStatus]":
        """List all sites, by name.

        Raises:
            FleetError: NATS cannot be reached, or has no list of them.
        """
        if self.presence is None or self.link is None or self.link.connection is None:
            raise FleetError(self.reason if self.link is None else f"NATS cannot be reached: {self.link.reason}")
        return [self._as_heard(each) for each in await self.presence.sites()]

    def _as_heard(self, status: "SiteStatus") -> "SiteStatus":
        """Show a site as silent when its units do not answer from here: its entry is too old only much later."""
        silence = None if self.exchange is None else self.exchange.silence(status.site)
        if silence is None or status.state != "up":
            return status
        return replace(status, state="silent", for_s=round(silence, 1))

    def status(self) -> FleetStatus | None:
        """Tell the state of the connection, and its counters; None without [fleet]."""
        plan, link = self.plan, self.link
        if plan is None:
            return None
        counts = OwnerCounts() if self.serving is None else self.serving.owner.counts
        messages = LostMessages() if link is None else link.messages
        down_since = None if link is None else link.down_since
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
        )

    @property
    def is_busy(self) -> bool:
        """Whether another site waits for a response."""
        return self.serving is not None and self.serving.owner.under_way > 0

    async def stop(self) -> None:
        """Send what waits, and leave."""
        task, self._task = self._task, None
        self.plan = self.link = self.exchange = self.serving = self.presence = None
        self.reason = "there is no [fleet]"
        if task is not None:
            task.cancel()
            await asyncio.wait((task,), timeout=_LEAVING_TIME)


def _clock() -> float:
    """Read the clock that goes on while the machine sleeps, and that is never set."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


def _login(plan: FleetPlan, contexts: TlsStore) -> Callable[[], Login]:
    """Make what reads how to log in: for each connection, so that new files count at once."""
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
