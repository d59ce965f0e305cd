"""`[fleet]`: the other sites, as long as the config names NATS servers. What knows them is loaded only then."""

import asyncio
import secrets
import time
from collections.abc import Callable, Iterable
from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

from gateway import events
from gateway.config.plan import FleetPlan
from gateway.errors import FleetError, PortError
from gateway.ports.port import OpenPort, Port, PortUser
from gateway.routing.router import Router
from gateway.service.libraries import not_installed
from gateway.service.password import read_password, read_secret
from gateway.tls.contexts import load
from gateway.tls.store import TlsStore

if TYPE_CHECKING:
    from gateway.fleet.connection import Bucket
    from gateway.fleet.exchange import Exchange
    from gateway.fleet.link import Link, Member
    from gateway.fleet.serving import Serving

#: The name of this process for deadlines.
_INSTANCE: Final = secrets.token_hex(6)


class Fleet:
    """The other sites, as long as the plan of a gateway names NATS servers. Requests from there take the way `sites`.

    Members know of each connection.
    """

    def __init__(
        self, sites: Router, emit: events.Emit, contexts: TlsStore, clock: Callable[[], float] | None = None
    ) -> None:
        """`clock` is the one that deadlines are told by."""
        self.clock = clock or _clock
        self._sites = sites
        self._emit = emit
        self._contexts = contexts
        self._members: list[Member] = []
        self._units: Callable[[], Iterable[int]] = tuple
        self._task: asyncio.Task[None] | None = None
        self.plan: FleetPlan | None = None
        #: Why no other site can be reached, if that is for longer.
        self.reason = "there is no [fleet]"
        #: What keeps the connection, asks other sites, and is asked by them; None without [fleet], or its library.
        self.link: Link | None = None
        self.exchange: Exchange | None = None
        self.serving: Serving | None = None

    def join(self, member: "Member") -> None:
        """Tell `member` of this connection, and of all later ones, until it leaves."""
        self._members.append(member)
        if self.link is not None:
            self.link.join(member)

    def leave(self, member: "Member") -> None:
        """Tell it nothing more."""
        self._members.remove(member)
        if self.link is not None:
            self.link.leave(member)

    def opener(self, site: str) -> OpenPort:
        """What opens the way to another site."""

        async def open_port(user: PortUser) -> Port:
            if self.exchange is None:
                raise PortError(f"fleet://{site}: {self.reason}")
            return await self.exchange.open(site, user)

        return open_port

    async def bucket(self, name: str) -> "Bucket":
        """A bucket of the key-value store.

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
            library = import_module("gateway.fleet.connection")
        except ModuleNotFoundError as error:
            self.reason = not_installed(error.name, "fleet")
            self._emit(events.FleetLost(str(plan.servers[0]), self.reason))
            return
        servers = [library.Server(each.host, each.port, each.scheme == "tls") for each in plan.servers]
        link: Link = import_module("gateway.fleet.link").Link(
            servers, _login(plan, self._contexts, library.Login), self._emit
        )
        self.link = link
        self.exchange = import_module("gateway.fleet.exchange").Exchange(plan.site, lambda: link.reason)
        self.serving = import_module("gateway.fleet.serving").Serving(
            plan.site, _INSTANCE, self._sites, self.clock, self._emit
        )
        for member in (self.exchange, self.serving, *self._members):
            link.join(member)
        self._task = asyncio.create_task(link.run(), name="fleet")
        await self.refresh()

    async def serve(self, units: Callable[[], Iterable[int]]) -> None:
        """From now on other sites reach the `units` that there are at the moment."""
        self._units = units
        await self.refresh()

    async def refresh(self) -> None:
        """The units that other sites reach may be others now."""
        if self.serving is not None:
            await self.serving.serve(self._units())

    async def finish(self) -> None:
        """Take no more requests from other sites; those under way may be answered."""
        await self.serve(tuple)

    @property
    def is_busy(self) -> bool:
        """Whether another site waits for a response."""
        return self.serving is not None and self.serving.owner.under_way > 0

    async def stop(self) -> None:
        """Send what waits, and leave."""
        task, self._task = self._task, None
        self.plan = self.link = self.exchange = self.serving = None
        self.reason = "there is no [fleet]"
        if task is not None:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)


def _clock() -> float:
    """It goes on while the machine sleeps, and nobody sets it."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


def _login(plan: FleetPlan, contexts: TlsStore, login: Callable[..., Any]) -> Callable[[], Any]:
    """What reads how to log in. Files are read for each connection, so that new ones count at once."""
    loop = asyncio.get_running_loop()

    def read() -> Any:
        context = None
        for secured in plan.secured:
            loaded = load(secured.settings)
            loop.call_soon_threadsafe(contexts.add, {secured: loaded})
            context = loaded.context
        return login(
            site=plan.site,
            user=plan.user,
            password=None if plan.password is None else read_password(plan.password, FleetError),
            credentials=None if plan.credentials is None else read_secret(plan.credentials, FleetError),
            context=context,
        )

    return read
