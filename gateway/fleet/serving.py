"""Keeps the units of this gateway within reach of other sites, and tells them what its clock shows."""

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

#: The most requests to a unit that wait to be looked at: several senders may send all that they may at once.
MOST_WAITING: Final = 4 * MOST_OF_SENDER


class Serving:
    """Serves the units that there are at the moment. It is a Member of the link.

    There is a subscription for each unit: who asks for another one learns at once that nobody has it.
    """

    def __init__(self, site: str, instance: str, router: Target, clock: Callable[[], float], emit: Emit) -> None:
        self.owner = Owner(site, instance, router, self._publish, clock, emit)
        self._clock = clock
        self._emit = emit
        self._loop = asyncio.get_running_loop()
        self._units: Callable[[], Iterable[int]] = tuple
        self._connection: NatsConnection | None = None
        self._subscribed: dict[int, Callable[[], Awaitable[None]]] = {}
        #: The connection that these are of.
        self._subscribed_at: NatsConnection | None = None
        self._subscribing = asyncio.Lock()
        self._timer: asyncio.TimerHandle | None = None
        self._task: asyncio.Task[None] | None = None

    async def connected(self, connection: "NatsConnection") -> None:
        """See Member."""
        self._connection = connection
        await self._subscribe()
        self._send_heartbeat()

    def disconnected(self) -> None:
        """See Member."""
        self._connection = None
        if self._timer is not None:
            self._timer.cancel()

    async def serve(self, units: Callable[[], Iterable[int]]) -> None:
        """Serve the `units` that there are at the moment, and no others."""
        self._units = units
        await self._subscribe()

    async def _subscribe(self) -> None:
        """Have the subscriptions that are needed, and no others. A connection that is lost meanwhile has none."""
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
        except Exception as error:  # noqa: BLE001 - an error boundary: the next request may be without the defect
            self._emit(PartFailed.of("fleet", error))

    def _publish(self, message: Message) -> bool:
        return self._connection is not None and self._connection.publish(message)

    def _send_heartbeat(self) -> None:
        body = heartbeat(self.owner.instance, self._clock())
        self._publish(Message(clock_subject(self.owner.site), body))
        if not self._subscribing.locked() and self._subscribed.keys() != frozenset(self._units()):
            self._task = asyncio.create_task(self._subscribe(), name="fleet: units")
        self._timer = self._loop.call_later(INTERVAL, self._send_heartbeat)
