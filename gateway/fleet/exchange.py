"""Requests to other sites, their answers, and what is heard of the other sites' clocks."""

import asyncio
import os
from collections.abc import Callable, Mapping
from functools import partial
from math import inf
from typing import TYPE_CHECKING, Final, Protocol

from gateway.errors import FleetError, PortClosed, PortError
from gateway.fleet.clock import SILENCE, Clocks
from gateway.fleet.messages import Message
from gateway.fleet.subjects import all_answers, answer_folder, clock_subject, request_subject
from gateway.ports.port import CharacterErrors, PortUser

if TYPE_CHECKING:
    from gateway.fleet.connection import NatsConnection

#: How long the port to a site is opened: the connection and the first heartbeat are waited for, in seconds.
OPENING_TIME: Final = 2.5
#: For how long a port that was lost passes answers on, in seconds: longer than requests have time.
_KEPT_FOR: Final = 600.0


class Asking(Protocol):
    """Who asks another site."""

    def answered(self, number: int, pdu: bytes) -> None:
        """The response to the request with this number, or a copy of it."""

    def unsent(self, number: int) -> None:
        """Nobody was there to get it."""


class Exchange:
    """The requests of `site` to others, over one connection after the other. It is a Member of the link."""

    def __init__(self, site: str, why_down: Callable[[], str]) -> None:
        """`why_down` says why there is no connection."""
        self.site = site
        self._why_down = why_down
        self._connection: NatsConnection | None = None
        self._clocks: dict[str, Clocks] = {}
        #: Since when each site is listened to over this connection.
        self._listening_since: dict[str, float] = {}
        self._changed = asyncio.Event()
        #: By how the reply subjects of their requests begin.
        self._ports: dict[str, SitePort] = {}

    async def connected(self, connection: "NatsConnection") -> None:
        """See Member."""
        await connection.subscribe(all_answers(self.site), self._answered)
        self._listening_since.clear()
        self._connection = connection
        self._wake_all()

    def disconnected(self) -> None:
        """See Member."""
        self._connection = None
        for port in tuple(self._ports.values()):
            port.lose(PortError(f"fleet://{port.site}: NATS cannot be reached: {self._why_down()}"))

    async def open(self, site: str, user: PortUser) -> "SitePort":
        """A port to a site that is there.

        Raises:
            PortError: there is no connection, or the site is not heard.
        """
        clocks = self._clocks.setdefault(site, Clocks())
        try:
            async with asyncio.timeout(OPENING_TIME):
                await self._until_heard(site, clocks)
        except TimeoutError:
            why = f"NATS cannot be reached: {self._why_down()}" if self._connection is None else "it is not heard"
            raise PortError(f"fleet://{site}: {why}") from None
        except FleetError as error:
            raise PortError(f"fleet://{site}: {error}") from error
        # Only the site that is asked learns it: no other one can have the server publish an answer there.
        folder = f"{answer_folder(self.site, site)}{os.urandom(8).hex()}"
        now = asyncio.get_running_loop().time()
        self._ports = {each: port for each, port in self._ports.items() if now - port.lost_at < _KEPT_FOR}
        opened = self._ports[folder] = SitePort(self.site, site, folder, user, clocks, self._publish)
        return opened

    def silence(self, site: str) -> float | None:
        """How long a site has not been heard, in seconds; None if it is heard, or nobody has listened for so long."""
        now = asyncio.get_running_loop().time()
        if self._connection is None or now - self._listening_since.get(site, now) < SILENCE:
            return None
        silence = self._clocks[site].silence(now)
        return min(silence, now - self._listening_since[site]) if silence >= SILENCE else None

    async def _until_heard(self, site: str, clocks: Clocks) -> None:
        time = asyncio.get_running_loop().time
        while True:
            connection = self._connection
            if connection is not None and site not in self._listening_since:
                await connection.subscribe(clock_subject(site), partial(self._heard, clocks))
                if connection is self._connection:
                    self._listening_since[site] = time()
            elif connection is not None and clocks.is_heard(time()):
                return
            else:
                await self._changed.wait()

    def _publish(self, message: Message) -> bool:
        return self._connection is not None and self._connection.publish(message)

    def _heard(self, clocks: Clocks, message: Message) -> None:
        """A heartbeat. One with headers is no gateway's: JetStream has published what another site has stored."""
        if not message.headers and clocks.hear(message.body, asyncio.get_running_loop().time()):
            self._wake_all()

    def _wake_all(self) -> None:
        """Whoever waits for a site looks again."""
        self._changed.set()
        self._changed = asyncio.Event()

    def _answered(self, message: Message) -> None:
        """An answer, or that there is nobody to answer. Gateways send no headers with one."""
        if message.headers and not message.has_no_responders:
            return
        folder, _, number = message.subject.rpartition(".")
        port = self._ports.get(folder)
        if port is not None and number.isdecimal():
            port.answered(int(number), message)


class SitePort:
    """A port to a `site`, which carries messages; it is lost when the connection is, or the site falls silent.

    The answer to a request comes to the subject in `folder` that has its number, so it is to this request and to no
    other.
    """

    latency = 0.0
    is_virtual = True
    baud: int | None = None
    has_arrived: Callable[[], bool] | None = None
    errors: CharacterErrors | None = None

    def __init__(
        self, sender: str, site: str, folder: str, user: PortUser, clocks: Clocks, publish: Callable[[Message], bool]
    ) -> None:
        self.site = site
        self.clocks = clocks
        #: When it was lost, by the clock of the event loop.
        self.lost_at = inf
        self._sender = sender
        #: Who gets the answers, from the first request on.
        self.asking: Asking | None = None
        self._folder = folder
        self._user = user
        self._publish = publish
        self._loop = asyncio.get_running_loop()
        self._timer = self._loop.call_later(0, self._listen)

    @property
    def is_open(self) -> bool:
        """Whether requests can be sent."""
        return self.lost_at == inf

    def ask(self, number: int, unit: int, pdu: bytes, headers: Mapping[str, str]) -> bool:
        """Send a request; False if it cannot be sent."""
        subject = request_subject(self.site, unit, self._sender)
        return self.is_open and self._publish(Message(subject, pdu, f"{self._folder}.{number}", headers))

    def answered(self, number: int, message: Message) -> None:
        """What came for the request with this number."""
        if self.asking is None:
            return
        if message.has_no_responders:
            self.asking.unsent(number)
        else:
            self.asking.answered(number, message.body)

    def write(self, data: bytes) -> None:
        """See Port: messages are not bytes."""

    def pause(self) -> bool:
        """See Port."""
        return False

    def read_now(self) -> None:
        """See Port."""

    def change_baud(self, baud: int) -> None:
        """See Port."""

    def lose(self, error: PortError) -> None:
        """Lose it. Answers that still come are passed on: requests that were sent have their time."""
        if self.is_open:
            self.lost_at = self._loop.time()
            self._timer.cancel()
            self._user.lost(error)

    def close(self) -> None:
        """See Port."""
        self.lose(PortClosed())

    async def wait_closed(self) -> None:
        """See Port."""

    def _listen(self) -> None:
        """Lose it when the site falls silent."""
        now, deadline = self._loop.time(), self.clocks.deadline()
        if deadline is None or deadline <= now:
            self.lose(PortError(f"fleet://{self.site}: it is not heard any more"))
        else:
            self._timer = self._loop.call_at(deadline, self._listen)
