"""Requests to other sites, their answers, and the heartbeats of those sites."""

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

#: Time to open the port to a site: for the connection and the first heartbeat, in seconds.
OPENING_TIME: Final = 2.5
#: How long a lost port still passes on answers, in seconds: longer than any request may take.
_KEPT_FOR: Final = 600.0


class Asking(Protocol):
    """The sender of requests to another site."""

    def answered(self, number: int, pdu: bytes) -> None:
        """Take the response to request `number`, or a copy of it."""

    def unsent(self, number: int) -> None:
        """Learn that no gateway was subscribed, so that request `number` was not delivered."""


class Exchange:
    """The requests of `site` to others, over successive connections; a Member of the link."""

    def __init__(self, site: str, why_down: Callable[[], str]) -> None:
        """Create it without a connection. `why_down` returns why there is none."""
        self.site = site
        self._why_down = why_down
        self._connection: NatsConnection | None = None
        self._clocks: dict[str, Clocks] = {}
        #: When listening to each site began on this connection.
        self._listening_since: dict[str, float] = {}
        self._changed = asyncio.Event()
        #: Ports by the beginning of their reply subjects.
        self._ports: dict[str, SitePort] = {}

    async def connected(self, connection: "NatsConnection") -> None:
        """Subscribe to answers, and let waiting openers look again."""
        await connection.subscribe(all_answers(self.site), self._answered)
        self._listening_since.clear()
        self._connection = connection
        self._wake_all()

    def disconnected(self) -> None:
        """Lose all ports."""
        self._connection = None
        for port in tuple(self._ports.values()):
            port.lose(PortError(f"fleet://{port.site}: NATS cannot be reached: {self._why_down()}"))

    async def open(self, site: str, user: PortUser) -> "SitePort":
        """Open a port to `site`, once a heartbeat of it is heard.

        Raises:
            PortError: there is no connection, or no heartbeat within OPENING_TIME.
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
        # Only the owner learns this random part: no other site can have the server publish an answer there.
        folder = f"{answer_folder(self.site, site)}{os.urandom(8).hex()}"
        now = asyncio.get_running_loop().time()
        self._ports = {each: port for each, port in self._ports.items() if now - port.lost_at < _KEPT_FOR}
        opened = self._ports[folder] = SitePort(self.site, site, folder, user, clocks, self._publish)
        return opened

    def silence(self, site: str) -> float | None:
        """Return the seconds since `site` was heard; None if it is heard, or was not listened to long enough."""
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
        """Take a heartbeat. With headers it is data that another site has stored, published by JetStream."""
        if not message.headers and clocks.hear(message.body, asyncio.get_running_loop().time()):
            self._wake_all()

    def _wake_all(self) -> None:
        """Let all waiting openers look again."""
        self._changed.set()
        self._changed = asyncio.Event()

    def _answered(self, message: Message) -> None:
        """Take an answer, or the notice that nobody is subscribed. Gateways send answers without headers."""
        if message.headers and not message.has_no_responders:
            return
        folder, _, number = message.subject.rpartition(".")
        port = self._ports.get(folder)
        if port is not None and number.isdecimal():
            port.answered(int(number), message)


class SitePort:
    """A port to `site` that carries messages. It is lost with the connection, or when the site falls silent.

    The reply subject of a request is its number in `folder`, so an answer belongs to exactly one request.
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
        #: When it was lost, by the event loop's clock; infinite while open.
        self.lost_at = inf
        self._sender = sender
        #: The receiver of the answers; set before the first request.
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
        """Send a request. Return False if it cannot be sent."""
        subject = request_subject(self.site, unit, self._sender)
        return self.is_open and self._publish(Message(subject, pdu, f"{self._folder}.{number}", headers))

    def answered(self, number: int, message: Message) -> None:
        """Pass on the answer to request `number`, or that nobody got it."""
        if self.asking is None:
            return
        if message.has_no_responders:
            self.asking.unsent(number)
        else:
            self.asking.answered(number, message.body)

    def write(self, data: bytes) -> None:
        """Ignore bytes: this port carries messages."""

    def pause(self) -> bool:
        """Refuse to pause (see Port)."""
        return False

    def read_now(self) -> None:
        """Do nothing: messages are delivered as they come."""

    def change_baud(self, baud: int) -> None:
        """Do nothing: there is no rate."""

    def lose(self, error: PortError) -> None:
        """Report the port as lost. Answers that still come are passed on: sent requests keep their time."""
        if self.is_open:
            self.lost_at = self._loop.time()
            self._timer.cancel()
            self._user.lost(error)

    def close(self) -> None:
        """Close the port for good."""
        self.lose(PortClosed())

    async def wait_closed(self) -> None:
        """Return at once: nothing has to be closed."""

    def _listen(self) -> None:
        """Lose the port when the site has fallen silent."""
        now, deadline = self._loop.time(), self.clocks.deadline()
        if deadline is None or deadline <= now:
            self.lose(PortError(f"fleet://{self.site}: it is not heard any more"))
        else:
            self._timer = self._loop.call_at(deadline, self._listen)
