"""Offers the units of this gateway to other sites, and sends heartbeats."""

import asyncio
from collections.abc import Awaitable, Callable, Iterable
from typing import TYPE_CHECKING, Final

from gateway.errors import FleetError
from gateway.events import Emit, PartFailed
from gateway.fleet.clock import INTERVAL, heartbeat
from gateway.fleet.messages import Message
from gateway.fleet.owner import Owner
from gateway.fleet.slots import MOST_OF_SENDER
from gateway.fleet.subjects import GROUP, clock_subject, request_subject
from gateway.request import Target

if TYPE_CHECKING:
    from gateway.fleet.connection import NatsConnection

#: The most undelivered requests to a unit: several senders may send their maximum at once.
MOST_WAITING: Final = 4 * MOST_OF_SENDER


class Serving:
    """Serves the current units; a Member of the link.

    Each unit has its own subscription, so a request to any other unit fails at once: nobody is subscribed.
    """

    def __init__(self, site: str, instance: str, router: Target, clock: Callable[[], float], emit: Emit) -> None:
        self.owner = Owner(site, instance, router, self._publish, clock, emit)
        self._clock = clock
        self._emit = emit
        self._loop = asyncio.get_running_loop()
        self._units: Callable[[], Iterable[int]] = tuple
        self._connection: NatsConnection | None = None
        self._subscribed: dict[int, Callable[[], Awaitable[None]]] = {}
        #: The connection of these subscriptions.
        self._subscribed_at: NatsConnection | None = None
        self._subscribing = asyncio.Lock()
        self._timer: asyncio.TimerHandle | None = None
        self._task: asyncio.Task[None] | None = None

    async def connected(self, connection: "NatsConnection") -> None:
        """Subscribe to requests, and send heartbeats."""
        self._connection = connection
        await self._subscribe()
        self._send_heartbeat()

    def disconnected(self) -> None:
        """Stop the heartbeats."""
        self._connection = None
        if self._timer is not None:
            self._timer.cancel()

    async def serve(self, units: Callable[[], Iterable[int]]) -> None:
        """Serve exactly the units that `units` returns, now and at each heartbeat."""
        self._units = units
        await self._subscribe()

    async def _subscribe(self) -> None:
        """Make the subscriptions match the units. A connection lost meanwhile has none."""
        async with self._subscribing:
            connection, units = self._connection, frozenset(self._units())
            if connection is not self._subscribed_at:
                self._subscribed_at = connection
                self._subscribed.clear()
            for unit in set(self._subscribed).difference(units):
                await self._subscribed.pop(unit)()
            for unit in sorted(units.difference(self._subscribed)):
                if connection is None or connection is not self._connection:
                    return
                subject = request_subject(self.owner.site, unit, "*")
                try:
                    self._subscribed[unit] = await connection.subscribe(subject, self._received, GROUP, MOST_WAITING)
                except FleetError as error:
                    connection.lose(str(error))
                    return

    def _received(self, message: Message) -> None:
        try:
            self.owner.received(message, self._loop.time())
        except Exception as error:  # noqa: BLE001 - an error boundary: the next request may succeed
            self._emit(PartFailed.of("fleet", error))

    def _publish(self, message: Message) -> bool:
        return self._connection is not None and self._connection.publish(message)

    def _send_heartbeat(self) -> None:
        body = heartbeat(self.owner.instance, self._clock())
        self._publish(Message(clock_subject(self.owner.site), body))
        if not self._subscribing.locked() and self._subscribed.keys() != frozenset(self._units()):
            self._task = asyncio.create_task(self._subscribe(), name="fleet: units")
        self._timer = self._loop.call_later(INTERVAL, self._send_heartbeat)
