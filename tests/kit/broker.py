"""A broker without a network: takes what a publisher has, and keeps what is retained."""

import asyncio
import json
from collections.abc import Sequence
from dataclasses import dataclass, field

from gateway.plant.commands import CarriedOut
from gateway.plant.driver import PublisherDriver
from gateway.plant.kept.keeper import Keeper
from gateway.plant.messages import Delivery, Message
from gateway.runtime.mqtt.publication import reading
from kit.gateway_bench import GatewayBench

#: The Unix time at the begin of a test with a keeper.
BEGIN = 1_800_000_000.0


@dataclass
class FakeBroker:
    """A broker that is connected when a test says so. `messages` are all that came, `retained` the last by topic."""

    driver: PublisherDriver
    messages: list[Message] = field(default_factory=list)
    retained: dict[str, bytes] = field(default_factory=dict)

    @classmethod
    def of(
        cls, bench: GatewayBench, announcements: Sequence[Message] = (), keeper: Keeper | None = None
    ) -> "FakeBroker":
        """The broker of a gateway; its devices are read from now on. Times of messages are those of the loop."""
        gateway, running, time = bench.gateway, bench.running, asyncio.get_running_loop().time
        router, pollers, plan = running.add_ons.mqtt.router, running.builder.pollers, gateway.plan.mqtt
        unix = time if keeper is None else lambda: BEGIN + time()
        emit, done = bench.events.append, CarriedOut()
        return cls(reading(plan, gateway, router, pollers, emit, done, unix, announcements, keeper))

    def connect(self) -> list[str]:
        """Connect and take the birth; the topics of commands that are subscribed to."""
        publisher = self.driver.publisher
        publisher.will(self.driver.now())
        publisher.connected(self.driver.now())
        topics = list(publisher.form.command_subscriptions())
        self.take()
        self.driver.begin_history(1_000_000)
        return topics

    def lose(self) -> None:
        """The connection is lost, and the gateway does not know whether the broker has what it has not confirmed."""
        self.driver.publisher.disconnected()

    def take(self, *, confirmed: bool = True) -> list[Message]:
        """Take all that there is to publish, and confirm it."""
        found = []
        while messages := self.driver.take():
            found += messages
            for message in messages if confirmed else ():
                self.driver.confirmed(message)
        self.messages += found
        for message in found:
            if message.retain:
                self.retained[message.topic] = message.payload
        return found

    def said(self) -> dict[str, object]:
        """What was published since, by topic, JSON without its time."""
        return {message.topic: content(message) for message in self.take()}

    def send(self, topic: str, payload: str, **options: object) -> dict[str, object]:
        """Deliver a message, and wait for all that follows."""
        self.send_bytes(topic, payload.encode(), **options)
        return self.said()

    def send_bytes(self, topic: str, payload: bytes, **options: object) -> None:
        """Deliver a message."""
        self.driver.received(Delivery(topic, payload, self.driver.now(), **options))


def content(message: Message) -> object:
    """A payload: text, or JSON without its time."""
    text = message.payload.decode()
    if not text.startswith("{"):
        return text
    return {key: value for key, value in json.loads(text).items() if key != "time"}
