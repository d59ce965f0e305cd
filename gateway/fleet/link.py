"""The lasting link to NATS: connects again after a loss, and tells its members."""

import asyncio
import random
from collections.abc import Callable, Sequence
from typing import Final, Protocol

from gateway.clock.threads import in_thread
from gateway.errors import FleetError, TlsError
from gateway.events import Emit, FleetBucketUnsafe, FleetLost, FleetRefused, FleetUp, PartFailed
from gateway.fleet.connection import NatsConnection
from gateway.fleet.counts import LostMessages
from gateway.fleet.settings import Login, Server

#: The first and the longest pause before connecting again, in seconds; each is twice the one before.
FIRST_PAUSE: Final = 0.25
LONGEST_PAUSE: Final = 2.0
#: After a connection that lasted this long, in seconds, the next pause is the first one again.
STEADY: Final = 10.0
#: The most refusals reported for one connection.
_MOST_REFUSALS: Final = 20


class Member(Protocol):
    """A user of NATS: the owner of units, the requests to other sites, the list of sites."""

    async def connected(self, connection: NatsConnection) -> None:
        """Use `connection` from now on.

        Raises:
            FleetError: no member can use it, so it is closed.
        """

    def disconnected(self) -> None:
        """Stop using the connection.

        Called once for each call of `connected`, perhaps before that has returned.
        """


class Link:
    """The link to one of `servers`. `login` reads the login settings, and may block."""

    def __init__(self, servers: Sequence[Server], login: Callable[[], Login], emit: Emit) -> None:
        #: The connection in use; None if there is none.
        self.connection: NatsConnection | None = None
        #: Why there is none; empty if there is one.
        self.reason = "not tried yet"
        #: Since when there is none, by the event loop's clock; None if there is one.
        self.down_since: float | None = asyncio.get_running_loop().time()
        #: Since when there is one; None if there is none.
        self.up_since: float | None = None
        self.server = servers[0]
        self.attempts = 0
        #: Lost messages of all its connections.
        self.messages = LostMessages()
        self._servers = servers
        self._first = random.randrange(len(servers))  # noqa: S311 - no secret
        self._login = login
        self._emit = emit
        self._pause = FIRST_PAUSE
        self._told = ""
        self._refusals: set[str] = set()

    async def run(self, *members: Member) -> None:
        """Keep a connection for these members, until cancelled."""
        loop = asyncio.get_running_loop()
        while True:
            began = loop.time()
            try:
                await self._connect(members)
            except (FleetError, TlsError) as error:
                self._lost(str(error))
            except Exception as error:  # noqa: BLE001 - an error boundary: all other parts go on
                self._emit(PartFailed.of("fleet", error))
                self._lost("a defect in the gateway")
            if loop.time() - began > STEADY:
                self._pause = FIRST_PAUSE
            await asyncio.sleep(self._pause * random.uniform(0.7, 1.3))  # noqa: S311 - no secret
            self._pause = min(2 * self._pause, LONGEST_PAUSE)

    async def _connect(self, members: Sequence[Member]) -> None:
        """Connect, and use the connection until it is lost.

        Raises:
            FleetError: it cannot be made, or is lost.
            TlsError: a file cannot be used.
        """
        login = await in_thread("read credentials", self._login)
        self.server = self._servers[(self._first + self.attempts) % len(self._servers)]
        self.attempts += 1
        self._refusals.clear()
        connection = NatsConnection(self.server, login, self._refused, self.messages, self._warn)
        try:
            await connection.open()
            await self._use(connection, members)
        finally:
            await connection.close()

    async def _use(self, connection: NatsConnection, members: Sequence[Member]) -> None:
        """Report the connection to the members, and then its loss.

        Raises:
            FleetError: a member cannot use it, or it is lost.
        """
        told: list[Member] = []
        try:
            for member in members:
                told.append(member)
                await member.connected(connection)
            self._up(connection)
            self.reason = await asyncio.shield(connection.lost)
            raise FleetError(self.reason)
        finally:
            self.connection = None
            for member in told:
                member.disconnected()

    def _refused(self, reason: str) -> None:
        """Report a refused subject, once per connection."""
        if reason not in self._refusals and len(self._refusals) < _MOST_REFUSALS:
            self._refusals.add(reason)
            self._emit(FleetRefused(str(self.server), reason))

    def _warn(self, reason: str) -> None:
        """Report an unsafe bucket."""
        self._emit(FleetBucketUnsafe(str(self.server), reason))

    def _up(self, connection: NatsConnection) -> None:
        self.connection = connection
        self.reason = self._told = ""
        self.down_since = None
        self.up_since = asyncio.get_running_loop().time()
        self._emit(FleetUp(str(self.server)))

    def _lost(self, reason: str) -> None:
        """Report a lost connection, once per reason."""
        self.reason = reason
        if self.down_since is None:
            self.down_since, self.up_since = asyncio.get_running_loop().time(), None
        if reason != self._told:
            self._told = reason
            self._emit(FleetLost(str(self.server), reason))
