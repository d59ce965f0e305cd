"""`[fleet]`: the connection to NATS, as long as the config names one. What makes it is loaded only then."""

import asyncio
from collections.abc import Callable
from importlib import import_module
from typing import TYPE_CHECKING, Any

from gateway import events
from gateway.config.plan import FleetPlan
from gateway.errors import FleetError, PortError
from gateway.ports.port import OpenPort, Port, PortUser
from gateway.service.libraries import not_installed
from gateway.service.password import read_password, read_secret
from gateway.tls.contexts import load
from gateway.tls.store import TlsStore

if TYPE_CHECKING:
    from gateway.fleet.connection import Bucket
    from gateway.fleet.link import Link, Member


class Fleet:
    """The other gateways of a fleet, as long as the plan of a gateway says so. Members know of each connection."""

    def __init__(self, emit: events.Emit, contexts: TlsStore) -> None:
        self._emit = emit
        self._contexts = contexts
        self._members: list[Member] = []
        self._task: asyncio.Task[None] | None = None
        self.plan: FleetPlan | None = None
        #: What keeps the connection; None without [fleet], or without its library.
        self.link: Link | None = None
        #: Why there is no link, if one is wanted.
        self.reason = ""

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

        async def open_port(user: PortUser) -> Port:  # noqa: ARG001
            raise PortError(f"fleet://{site}: {self.reason or 'NATS cannot be reached'}")

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
            connection, link = (import_module(f"gateway.fleet.{name}") for name in ("connection", "link"))
        except ModuleNotFoundError as error:
            self.reason = not_installed(error.name, "fleet")
            self._emit(events.FleetLost(str(plan.servers[0]), self.reason))
            return
        servers = [connection.Server(each.host, each.port, each.scheme == "tls") for each in plan.servers]
        self.link = link.Link(servers, _login(plan, self._contexts, connection.Login), self._emit)
        for member in self._members:
            self.link.join(member)
        self._task = asyncio.create_task(self.link.run(), name="fleet")

    async def stop(self) -> None:
        """Send what waits, and leave."""
        task, self._task, self.plan, self.link, self.reason = self._task, None, None, None, ""
        if task is not None:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)


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
