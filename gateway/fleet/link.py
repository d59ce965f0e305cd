"""Keeps a connection to NATS, and tells those who use it when there is one."""

import asyncio
import random
from collections.abc import Callable, Sequence
from typing import Final, Protocol

from gateway.clock.threads import ThreadPerCall
from gateway.errors import FleetError, TlsError
from gateway.events import Emit, FleetBucketUnsafe, FleetLost, FleetRefused, FleetUp, PartFailed
from gateway.fleet.connection import NatsConnection
from gateway.fleet.counts import LostMessages
from gateway.fleet.settings import Login, Server

#: The first pause before the gateway connects again, and the longest; each is twice the one before. In seconds.
FIRST_PAUSE: Final = 0.25
LONGEST_PAUSE: Final = 2.0
#: A connection that lasted this long, in seconds, makes the next pause the first one again.
STEADY: Final = 10.0
#: The most refusals of one connection that are told.
_MOST_REFUSALS: Final = 20


class Member(Protocol):
    """Something that needs NATS: the owner of units, what asks other sites, the list of sites."""

    async def connected(self, connection: NatsConnection) -> None:
        """There is a connection from now on. Raises FleetError if no member can use it: then it is closed."""

    def disconnected(self) -> None:
        """It is lost. Called once for each time that `connected` was called, perhaps before that has returned."""


class Link:
    """The connection to one of `servers`. `login` reads how to log in, and may block."""

    def __init__(self, servers: Sequence[Server], login: Callable[[], Login], emit: Emit) -> None:
        #: The connection in use; None if there is none.
        self.connection: NatsConnection | None = None
        #: Why there is none; empty if there is one.
        self.reason = "not tried yet"
        #: Since when, by the clock of the event loop; None if there is one.
        self.down_since: float | None = asyncio.get_running_loop().time()
        self.server = servers[0]
        self.attempts = 0
        #: Of all its connections.
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
        """One connection, until it is lost.

        Raises:
            FleetError: it cannot be made, or is lost.
            TlsError: a file cannot be used.
        """
        loop = asyncio.get_running_loop()
        login = await loop.run_in_executor(ThreadPerCall("read credentials"), self._login)
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
        """Tell the members of the connection, and that it is lost.

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
        """The server refuses a subject. Each is told once for each connection."""
        if reason not in self._refusals and len(self._refusals) < _MOST_REFUSALS:
            self._refusals.add(reason)
            self._emit(FleetRefused(str(self.server), reason))

    def _warn(self, reason: str) -> None:
        """A bucket is not as it must be."""
        self._emit(FleetBucketUnsafe(str(self.server), reason))

    def _up(self, connection: NatsConnection) -> None:
        self.connection = connection
        self.reason = self._told = ""
        self.down_since = None
        self._emit(FleetUp(str(self.server)))

    def _lost(self, reason: str) -> None:
        """It is told once, and again when the reason is another one."""
        self.reason = reason
        if self.down_since is None:
            self.down_since = asyncio.get_running_loop().time()
        if reason != self._told:
            self._told = reason
            self._emit(FleetLost(str(self.server), reason))
