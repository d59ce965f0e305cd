"""Keeping a connection, in virtual time: what a broker does not confirm."""

import asyncio
import json
from contextlib import asynccontextmanager
from datetime import datetime
from typing import ClassVar

import pytest

from gateway.events import BrokerLost, BrokerRefused, BrokerUp
from gateway.plant import broker as module
from gateway.plant.broker import Broker
from gateway.plant.client import STEP_TIME
from gateway.plant.commands import CarriedOut
from gateway.plant.messages import Delivery
from gateway.plant.reasons import SubscriptionRefusedError
from gateway.plant.steadiness import HOLDS, LONGEST_PAUSE
from gateway.runtime.mqtt.publication import reading
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import gateway_bench

CONFIG = """
site = "plant"

[[line]]
name    = "hall"
port    = "/dev/hall"
baud    = 115200
devices = [{ unit = 1, name = "silo-1", profile = "scale" }]

[profile.scale]
points = [{ name = "weight", holding = 0 }, { name = "state", holding = 2, write = true }]

[mqtt]
broker  = "mqtt://broker"
publish = [{ device = "silo-1", every = "500 ms" }]
write   = true
"""


class FakeConnection:
    """A connection without a network, that confirms a message as soon as the loop runs, unless `refusal` is None."""

    made: ClassVar[list["FakeConnection"]] = []
    refusal = ""
    refused_topics = ""
    #: How long the broker takes for a subscription.
    hesitates = 0.01
    #: What comes from where upon a subscription to it.
    states: ClassVar[dict[str, tuple[str, bytes]]] = {}
    #: Where a command is sent upon the subscription to it.
    command: ClassVar[str | None] = None
    #: The last message before the first subscription.
    subscribed_behind = b""

    def __init__(self, settings, version, will, *, deliver, confirmed, unix) -> None:
        self.unconfirmed = []
        self.most_in_flight = 20
        self.largest = 65536
        self.deadline = None
        self.patience = STEP_TIME
        self.messages = []
        self.topics = []
        self.lost = asyncio.get_running_loop().create_future()
        self._deliver = deliver
        self._confirmed = confirmed
        self.made.append(self)

    @property
    def in_flight(self) -> int:
        """How many messages are not confirmed."""
        return len(self.unconfirmed)

    async def open(self) -> None:
        """It is open at once."""

    async def subscribe(self, topics) -> None:
        """Any topic, unless the broker refuses all; it takes a while."""
        if not topics:
            return
        if self.refused_topics:
            raise SubscriptionRefusedError(self.refused_topics)
        if not self.topics and self.messages:
            self.subscribed_behind = self.messages[-1].payload
        await asyncio.sleep(self.hesitates)
        self.topics += topics
        for topic in topics:
            if topic in self.states:
                where, what = self.states[topic]
                self._deliver(Delivery(where, what, asyncio.get_running_loop().time()))
        if self.command is not None:
            self._deliver(Delivery(self.command, b"7", asyncio.get_running_loop().time()))

    def publish(self, message) -> None:
        """Take a message."""
        loop = asyncio.get_running_loop()
        self.messages.append(message)
        if not self.in_flight:
            self.deadline = loop.time() + STEP_TIME
        self.unconfirmed.append(message)
        if self.refusal is not None:
            loop.call_soon(self._confirm, message)

    def _confirm(self, message) -> None:
        self.unconfirmed.remove(message)
        self.deadline = None
        self._confirmed(message, self.refusal, True)

    def end(self, *, with_will) -> None:
        """Log out."""
        self.lost.set_result("the connection was ended")

    def close(self) -> None:
        """Nothing to close."""


@pytest.fixture
def connections(monkeypatch):
    """The connections that were made."""
    monkeypatch.setattr(module, "BrokerConnection", FakeConnection)
    monkeypatch.setattr(FakeConnection, "made", [])
    return FakeConnection.made


@asynccontextmanager
async def publishing(config=CONFIG):
    async with gateway_bench(config) as bench:
        device = SimulatedDevice(1, delay=0.002)
        bench.attach("hall", SimulatedLine("rtu", device))
        loop, gateway = asyncio.get_running_loop(), bench.gateway
        driver = reading(
            gateway.plan.mqtt,
            gateway,
            bench.running.add_ons.mqtt.router,
            bench.running.builder.pollers,
            bench.events.append,
            CarriedOut(),
            loop.time,
        )
        broker = Broker("broker", lambda: None, driver, bench.events.append, loop.time)
        task = asyncio.create_task(broker.run())
        yield bench, device, broker
        task.cancel()


async def test_a_broker_that_confirms_nothing_is_left_although_new_values_come(connections, monkeypatch):
    async with publishing() as (bench, device, _):
        await asyncio.sleep(5.0)
        assert any(isinstance(event, BrokerUp) for event in bench.events)
        monkeypatch.setattr(FakeConnection, "refusal", None)
        for value in range(1, 13):
            device.holding[0] = value
            await asyncio.sleep(1.0)
        [lost] = [event for event in bench.events if isinstance(event, BrokerLost)]
        assert lost.reason == "it has not confirmed a message for 10 s"
        assert len(connections) == 2


async def test_what_a_broker_has_refused_for_want_of_room_is_published_after_the_next_read(connections, monkeypatch):
    async with publishing() as (_, device, broker):
        await asyncio.sleep(5.0)
        monkeypatch.setattr(FakeConnection, "refusal", "quota exceeded")
        device.holding[0] = 7
        await asyncio.sleep(2.0)
        assert 1 <= broker.counts.refused <= 15, "with each read, three messages"
        monkeypatch.setattr(FakeConnection, "refusal", "")
        [connection] = connections
        connection.messages.clear()
        await asyncio.sleep(2.0)
        values, availability = connection.messages
        assert json.loads(values.payload)["weight"] == 7
        assert availability.payload == b"online"
        assert 2.0 <= asyncio.get_running_loop().time() - broker.counts.refused_at <= 4.0


async def test_it_is_known_since_when_nothing_is_published(connections):
    async with publishing() as (_, _, broker):
        began = broker.down_since
        assert began is not None
        await asyncio.sleep(5.0)
        assert broker.down_since is None
        connections[-1].lost.set_result("the connection was lost")
        await asyncio.sleep(0.2)
        assert broker.down_since == pytest.approx(began + 5.0, abs=0.01)


async def test_values_are_published_although_the_broker_refuses_to_let_them_be_set(connections, monkeypatch):
    monkeypatch.setattr(FakeConnection, "refused_topics", "may not subscribe")
    async with publishing() as (bench, _, broker):
        await asyncio.sleep(5.0)
        told = [event for event in bench.events if isinstance(event, BrokerRefused | BrokerUp | BrokerLost)]
        assert [type(event) for event in told] == [BrokerRefused, BrokerUp]
        assert told[0].reason == "may not subscribe"
        assert broker.counts.confirmed > 0


async def test_nothing_is_subscribed_before_the_gateway_says_that_it_is_there(connections, monkeypatch):
    """Commands are, right behind that."""
    topic = "modbus/plant/silo-1/state"
    monkeypatch.setattr(FakeConnection, "command", f"{topic}/set")
    async with publishing() as (_, device, _):
        await asyncio.sleep(5.0)
        assert device.holding[2] == 7
        [connection] = connections
        said = [(message.topic, message.payload) for message in connection.messages]
        [result] = [payload for where, payload in said if where == f"{topic}/result"]
        assert json.loads(result)["result"] == "ok"
        assert said.index((f"{topic}/result", result)) > said.index(("modbus/plant/status", b"online"))
        assert connection.subscribed_behind == b"online"


async def test_a_birth_is_of_the_time_when_it_is_published(connections, monkeypatch):
    """Its values are the last ones: not those of when the broker was asked for a subscription, seconds before."""
    monkeypatch.setattr(FakeConnection, "hesitates", 5.0)
    async with publishing():
        began = asyncio.get_running_loop().time()
        await asyncio.sleep(12.0)
        values = next(message for message in connections[0].messages if message.topic == "modbus/plant/silo-1")
        assert datetime.fromisoformat(json.loads(values.payload)["time"]).timestamp() >= began + 5.0 - 0.5


async def test_nothing_is_born_when_the_primary_host_has_gone_before(connections, monkeypatch):
    """It goes while the commands are being subscribed to."""
    node, host = "spBv1.0/plant/NCMD/plant", "spBv1.0/STATE/scada"
    monkeypatch.setattr(
        FakeConnection,
        "states",
        {
            host: (host, b'{"online": true, "timestamp": 1}'),
            "spBv1.0/plant/DCMD/plant/silo-1": (host, b'{"online": false, "timestamp": 2}'),
        },
    )
    async with publishing(CONFIG + 'sparkplug = { group = "plant", primary_host = "scada" }\n') as (_, _, broker):
        await asyncio.sleep(0.5)
        assert broker.reason == "it is to be connected anew"
        assert connections[0].topics[:2] == [host, node]
        assert len(connections[0].topics) == 3
        assert connections[0].messages == []


async def test_a_primary_host_that_is_not_there_is_told_once(connections):
    """The connection is kept, and what is said is not that of a broker that cannot be reached."""
    async with publishing(CONFIG + 'sparkplug = { group = "plant", primary_host = "scada" }\n') as (bench, _, broker):
        await asyncio.sleep(60.0)
        assert broker.reason == "connected, but the primary host is not online"
        assert [event.reason for event in bench.events if isinstance(event, BrokerLost)] == [broker.reason]
        assert len(connections) == 1


async def test_a_primary_host_that_is_there_is_not_missed(connections, monkeypatch):
    host = "spBv1.0/STATE/scada"
    monkeypatch.setattr(FakeConnection, "states", {host: (host, b'{"online": true, "timestamp": 1}')})
    async with publishing(CONFIG + 'sparkplug = { group = "plant", primary_host = "scada" }\n') as (bench, _, broker):
        await asyncio.sleep(60.0)
        assert not broker.reason
        assert not [event for event in bench.events if isinstance(event, BrokerLost)]


@asynccontextmanager
async def taken_over(connections, reason):
    """Each connection is lost a second after it was made, as by another gateway of this name."""

    async def take_over() -> None:
        seen = 0
        while True:
            await asyncio.sleep(1.0)
            if len(connections) > seen:
                seen = len(connections)
                connections[-1].lost.set_result(reason)

    taking = asyncio.create_task(take_over())
    yield
    taking.cancel()


async def test_two_gateways_of_one_name_do_not_throw_each_other_out_each_second(connections):
    reason = "session taken over: another client uses the same name"
    async with publishing() as (bench, _, broker):
        async with taken_over(connections, reason):
            await asyncio.sleep(600.0)
            assert 600 / (1.2 * LONGEST_PAUSE + 2) < len(connections) < 32
            told = {event.reason for event in bench.events if isinstance(event, BrokerLost)}
            assert told == {reason}
        await asyncio.sleep(1.2 * LONGEST_PAUSE + 1.0)
        assert broker.reason == ""
        assert broker.unsteady.endswith(f"times in a row, each time soon after it was connected: {reason}")
        await asyncio.sleep(HOLDS)
        assert broker.unsteady == "", "it holds"
        connections[-1].lost.set_result("the connection was lost")
        await asyncio.sleep(1.5)
        assert broker.reason == "", "after one that has held the next one comes at once"


async def test_a_broker_that_cannot_say_that_another_client_has_the_name_is_helped(connections):
    async with publishing() as (bench, _, _), taken_over(connections, "the connection was lost"):
        await asyncio.sleep(60.0)
        reasons = [event.reason for event in bench.events if isinstance(event, BrokerLost)]
        assert reasons[0] == "the connection was lost"
        assert "perhaps another client uses the same name" in reasons[1]
