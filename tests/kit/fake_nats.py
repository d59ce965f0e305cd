"""NATS without a network, in virtual time: subjects, queue groups, no responders, a delay, a cut."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field

from gateway.errors import FleetError
from gateway.fleet.messages import Entry, Message


@dataclass(eq=False)
class Subscription:
    connection: "FakeConnection"
    subject: str
    queue: str
    deliver: Callable[[Message], None]

    def matches(self, subject: str) -> bool:
        mine, others = self.subject.split("."), subject.split(".")
        if mine[-1] == ">":
            return len(others) >= len(mine) and self._fit(mine[:-1], others)
        return len(mine) == len(others) and self._fit(mine, others)

    @staticmethod
    def _fit(mine: list[str], others: list[str]) -> bool:
        return all(one in ("*", other) for one, other in zip(mine, others, strict=False))


@dataclass
class FakeNats:
    """A server. Messages take `delay` seconds to it and from it; while it is `down`, nobody can connect.

    `sent` holds all that was published. What `spoils` says yes to is lost.
    """

    delay: float = 0.001
    down: bool = False
    spoils: Callable[[Message], bool] = lambda _: False
    sent: list[Message] = field(default_factory=list)
    connections: list["FakeConnection"] = field(default_factory=list)
    subscriptions: list[Subscription] = field(default_factory=list)
    _calls: int = 0

    def cut(self) -> None:
        """All connections are lost, and no new one can be made."""
        self.down = True
        for connection in tuple(self.connections):
            connection.lose("the connection was lost")

    def take(self, message: Message) -> None:
        """A message has come to the server."""
        self.sent.append(message)
        if self.spoils(message):
            return
        found = [each for each in self.subscriptions if each.matches(message.subject)]
        groups = {each.queue: each for each in found if each.queue}
        reached = [*(each for each in found if not each.queue), *groups.values()]
        if not reached and message.reply:
            self.take(Message(message.reply, has_no_responders=True))
        for each in reached:
            self.later(self._deliver, each, message)

    def later(self, call: Callable[..., None], *arguments: object) -> None:
        """Call it after the delay; what is sent together keeps its order, which timers do not."""
        self._calls += 1
        asyncio.get_running_loop().call_later(self.delay + 1e-9 * self._calls, call, *arguments)

    def _deliver(self, subscription: Subscription, message: Message) -> None:
        if subscription in self.subscriptions:
            subscription.deliver(message)


class FakeConnection:
    """A connection to `nats`, which stands in for gateway.fleet.connection.Connection."""

    nats: FakeNats
    server_version = "2.15.1"

    def __init__(self, server, login, refused=lambda _: None, messages=None, warn=lambda _: None) -> None:
        self.login = login
        self.lost: asyncio.Future[str] = asyncio.get_running_loop().create_future()
        self.is_full = False

    async def open(self) -> None:
        if self.nats.down:
            raise FleetError("connection refused")
        self.nats.connections.append(self)

    def publish(self, message: Message) -> bool:
        if self.lost.done() or self.is_full:
            return False
        self.nats.later(self._arrive, message)
        return True

    def _arrive(self, message: Message) -> None:
        if not self.lost.done():
            self.nats.take(message)

    async def subscribe(self, subject, deliver, queue="", most=4096):
        if self.lost.done():
            raise FleetError("it is lost")
        subscription = Subscription(self, subject, queue, deliver)
        self.nats.subscriptions.append(subscription)

        async def end() -> None:
            if subscription in self.nats.subscriptions:
                self.nats.subscriptions.remove(subscription)

        return end

    async def bucket(self, name):
        raise FleetError("it has no JetStream, or not for this account")

    def lose(self, reason: str) -> None:
        if not self.lost.done():
            self.lost.set_result(reason)
            self.nats.connections.remove(self)
            self.nats.subscriptions[:] = [each for each in self.nats.subscriptions if each.connection is not self]

    async def close(self) -> None:
        if self in self.nats.connections:
            self.lose("it was closed")


class FakeBucket:
    """A bucket of sites, and the connection to it."""

    def __init__(self) -> None:
        self.held: dict[str, Entry] = {}
        self.refuses = False
        self.offset = 1e6

    async def put(self, key, value):
        if self.refuses:
            raise FleetError("no right")
        self.held[key] = Entry(key, value, 1, asyncio.get_running_loop().time() + self.offset)
        return 1

    async def entries(self, only=None):
        return [each for each in self.held.values() if only is None or each.key in only]

    async def bucket(self, name):
        assert name == "mbgw-status"
        return self
