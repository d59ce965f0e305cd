"""Keeps a connection to the broker, and publishes there the messages of the publisher."""

import asyncio
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

from gateway.clock.threads import in_thread
from gateway.errors import BrokerError, TlsError
from gateway.events import BrokerLost, BrokerRefused, BrokerUp, Emit, PartFailed
from gateway.plant.client import VERSIONS, BrokerSettings, Version
from gateway.plant.connection import BrokerConnection
from gateway.plant.driver import PublisherDriver
from gateway.plant.messages import Message
from gateway.plant.reasons import SubscriptionRefusedError, WrongVersionError
from gateway.plant.steadiness import Steadiness
from gateway.timing.measured import NEVER

#: How long the last messages may take at a stop, in seconds.
ENDING_TIME: Final = 1.0
#: How long after the subscription the retained state of a primary host may take, in seconds.
HOST_TIME: Final = 2.0
#: After this many messages, lines and clients get a turn.
_SLICE: Final = 10
#: Messages are counted in steps of so many seconds.
STEP: Final = 10.0


@dataclass(slots=True)
class MessageCounts:
    """Messages that the broker has confirmed, and those that it has refused, the last one at `refused_at`."""

    confirmed: int = 0
    refused: int = 0
    refused_at: float = NEVER
    #: The present step of time, and what was confirmed by its begin and by that of the one before it.
    _step: int = 0
    _begins: tuple[int, int] = (0, 0)

    def per_second(self, now: float) -> float:
        """Return how many messages were confirmed in each second of the last whole step."""
        self._look(now)
        earlier, later = self._begins
        return (later - earlier) / STEP

    def confirm(self, now: float) -> None:
        """Count a message that the broker has confirmed."""
        self._look(now)
        self.confirmed += 1

    def _look(self, now: float) -> None:
        step = int(now // STEP)
        if step != self._step:
            self._begins = (self._begins[1] if step == self._step + 1 else self.confirmed, self.confirmed)
            self._step = step


class Broker:
    """A broker, and the connection to it. `settings` returns its address and login, and may block."""

    def __init__(
        self,
        name: str,
        settings: Callable[[], BrokerSettings],
        driver: PublisherDriver,
        emit: Emit,
        unix: Callable[[], float],
    ) -> None:
        self.name = name
        #: Why nothing is published; empty while values are.
        self.reason = "not tried yet"
        #: Since when, by the clock of the event loop; None while values are published.
        self.down_since: float | None = asyncio.get_running_loop().time()
        #: Since when values are published; None while they are not.
        self.up_since: float | None = None
        self.version: Version = VERSIONS[0]
        #: How many times the gateway has tried to connect.
        self.attempts = 0
        self.counts = MessageCounts()
        self._settings = settings
        self._driver = driver
        self._emit = emit
        self._unix = unix
        self._steadiness = Steadiness()
        #: The messages to publish before the end; None until `stop`.
        self._last: Sequence[Message] | None = None
        #: Whether everything was published at the stop, the last messages too.
        self.has_left = False
        self._told = ""
        self._has_told_refusal = False
        #: The topic of the will, and why the broker refuses messages on it; empty if it does not.
        self._status = self._refusal = ""

    @property
    def unsteady(self) -> str:
        """Why connections were lost again and again, while one is open; empty once it has held."""
        return "" if self.down_since is not None else self._steadiness.trouble(asyncio.get_running_loop().time())

    @property
    def _is_stopping(self) -> bool:
        return self._last is not None

    async def run(self) -> None:
        """Connect, publish, and connect again, until `stop`."""
        while not self._is_stopping:
            try:
                await self._serve()
            except WrongVersionError as error:
                self._lost(str(error))
                self.version = VERSIONS[1 - VERSIONS.index(self.version)]
            except (BrokerError, TlsError) as error:
                self._lost(str(error))
            except Exception as error:  # noqa: BLE001 - an error boundary: all other parts go on
                self._emit(PartFailed.of("broker", error))
                self._lost("a defect in the gateway")
            if not self._is_stopping:
                await asyncio.sleep(self._steadiness.next_pause())

    def stop(self, last: Sequence[Message] = ()) -> None:
        """Publish the `last` messages, log off, and end."""
        self._last = last
        self._driver.wake.set()

    async def _serve(self) -> None:
        """Make a connection, and publish until it is lost or must be ended.

        Raises:
            BrokerError: the connection cannot be made, or is lost.
            TlsError: a file cannot be used.
        """
        driver, publisher, form = self._driver, self._driver.publisher, self._driver.publisher.form
        settings = await in_thread("read password", self._settings)
        self.attempts += 1
        will = publisher.will(driver.now())
        self._status, self._refusal = will.topic, ""
        connection = BrokerConnection(
            settings,
            self.version,
            will,
            deliver=driver.received,
            confirmed=self._has_confirmed,
            unix=self._unix,
        )
        connection.lost.add_done_callback(lambda _: driver.wake.set())
        try:
            await connection.open()
            await connection.subscribe(form.early_subscriptions())
            publisher.connected(driver.now())
            await self._until_born(connection)
            if form.takes_commands_first:
                await self._take_commands(connection, form.command_subscriptions())
            await self._publish(connection, lambda: publisher.has_birth and not publisher.must_leave)
            if not form.takes_commands_first:
                await self._take_commands(connection, form.command_subscriptions())
            await self._until(connection, lambda: connection.in_flight == 0 or self._is_stopping)
            self._up()
            driver.begin_history(connection.largest)
            while not (self._is_stopping or publisher.must_leave):
                await self._publish(connection, lambda: True)
                await self._wait(connection)
            await self._leave(connection, (*(self._last or ()), *publisher.ended(driver.now())))
        finally:
            connection.close()
            publisher.disconnected()

    async def _until_born(self, connection: BrokerConnection) -> None:
        """Wait until something may be published; say it if the primary host is not there for that."""
        publisher = self._driver.publisher
        with suppress(TimeoutError):
            async with asyncio.timeout(HOST_TIME):
                await self._until(connection, lambda: publisher.is_born or self._is_stopping)
                return
        self._lost("connected, but the primary host is not online")
        await self._until(connection, lambda: publisher.is_born or self._is_stopping)

    async def _take_commands(self, connection: BrokerConnection, topics: Sequence[str]) -> None:
        """Subscribe to commands. If the broker refuses that, values are still published."""
        try:
            await connection.subscribe(topics)
        except SubscriptionRefusedError as refusal:
            self._tell_refusal(str(refusal))

    async def _publish(self, connection: BrokerConnection, goes_on: Callable[[], bool]) -> None:
        """Publish what waits, as long as `goes_on` returns True."""
        sent = 0
        while goes_on():
            if connection.in_flight >= connection.most_in_flight:
                await self._wait(connection)
                continue
            messages = self._driver.take()
            if not messages:
                if not self._driver.publisher.has_messages:
                    return
                continue
            for message in messages:
                connection.publish(message)
            sent += len(messages)
            if sent >= _SLICE:
                sent = 0
                await asyncio.sleep(0)
            self._raise_if_lost(connection)

    async def _until(self, connection: BrokerConnection, is_so: Callable[[], bool]) -> None:
        while not is_so():
            await self._wait(connection)

    async def _wait(self, connection: BrokerConnection) -> None:
        """Wait until something happens.

        Raises:
            BrokerError: the connection is lost, or the broker does not confirm what was published.
        """
        with suppress(TimeoutError):
            async with asyncio.timeout_at(connection.deadline):
                await self._driver.wake.wait()
        self._driver.wake.clear()
        self._raise_if_lost(connection)
        if connection.deadline is not None and asyncio.get_running_loop().time() >= connection.deadline:
            raise BrokerError(f"it has not confirmed a message for {connection.patience:g} s")

    def _raise_if_lost(self, connection: BrokerConnection) -> None:
        if connection.lost.done():
            raise BrokerError(connection.lost.result())
        if self._refusal:
            raise BrokerError(self._refusal)

    async def _leave(self, connection: BrokerConnection, messages: Sequence[Message]) -> None:
        """Publish the last messages and log out, within ENDING_TIME."""
        try:
            async with asyncio.timeout(ENDING_TIME):
                for message in messages:
                    await self._until(connection, lambda: connection.in_flight < connection.most_in_flight)
                    connection.publish(message)
                await self._until(connection, lambda: connection.in_flight == 0)
                self.has_left = True
                connection.end(with_will=self._driver.publisher.form.leaves_with_will)
                await asyncio.shield(connection.lost)
        except TimeoutError:
            pass
        if not self._is_stopping:
            self._steadiness.begin_anew()
            self.reason = "it is to be connected anew"
            self._note_down()

    def _has_confirmed(self, message: Message, refusal: str, is_passing: bool) -> None:  # noqa: FBT001 - a callback
        now = asyncio.get_running_loop().time()
        if not refusal:
            self.counts.confirm(now)
            self._driver.confirmed(message)
        else:
            self.counts.refused += 1
            self.counts.refused_at = now
            if message.topic == self._status:
                self._refusal = refusal
            else:
                self._driver.refused(message, is_passing=is_passing)
            self._tell_refusal(refusal)
        self._driver.wake.set()

    def _tell_refusal(self, refusal: str) -> None:
        """Emit a refusal, but no further one until a connection that was up is lost."""
        if not self._has_told_refusal:
            self._has_told_refusal = True
            self._emit(BrokerRefused(self.name, refusal))

    def _up(self) -> None:
        if self._is_stopping:
            return
        self.reason = self._told = ""
        self.down_since = None
        self.up_since = asyncio.get_running_loop().time()
        self._steadiness.connected(asyncio.get_running_loop().time())
        self._emit(BrokerUp(self.name, self.version))

    def _lost(self, reason: str) -> None:
        """Note that there is no connection; emit the reason once, and again when it changes."""
        if not self.reason:
            self._has_told_refusal = False
            reason = self._steadiness.lost(reason, asyncio.get_running_loop().time())
        self.reason = reason
        self._note_down()
        if reason != self._told and not self._is_stopping:
            self._told = reason
            self._emit(BrokerLost(self.name, reason))

    def _note_down(self) -> None:
        if self.down_since is None:
            self.down_since, self.up_since = asyncio.get_running_loop().time(), None
