"""What surrounds a gateway that keeps readings: devices that know what they have answered, a broker, and a subscriber.

The gateway reaches the broker through a tap, which lets it connect only when the subscriber is there, and records what
it sends and when that is confirmed. A consumer that is not there has lost nothing.
"""

import asyncio
import signal
import threading
import time
from collections.abc import Coroutine
from pathlib import Path
from typing import Any, Self

from paho.mqtt.client import Client, MQTTMessage
from paho.mqtt.enums import CallbackAPIVersion, MQTTProtocolVersion
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties
from paho.mqtt.subscribeoptions import SubscribeOptions

from gateway.modbus.mbap import MbapFramer, TcpFrame, encode
from gateway.modbus.pdu import parse_request
from kit.free_port import free_port
from kit.mosquitto import Mosquitto
from kit.process import PATIENCE
from soak.kept_messages import Heard
from soak.kept_record import Answer
from soak.kept_tap import Tap

DEVICES = 4
#: The points of a device by the address of their first register: each has two.
POINTS = {0: "count", 2: "slow", 20: "other"}
EVERY = {"count": 0.25, "slow": 0.25, "other": 0.5}
#: So many answers have the same `slow`.
SLOW = 3
#: How long a device may take to answer, in seconds.
TIMEOUT = 1.0
PROFILE = "\n".join(
    [
        "[profile.counter]",
        "points = [",
        *(f'  {{ name = "{name}", holding = {at}, type = "uint32" }},' for at, name in POINTS.items()),
        "]",
    ]
)


def device_name(unit: int) -> str:
    return f"counter-{unit}"


class Loop:
    """An event loop in a thread of its own, for what must go on while faults happen."""

    def __enter__(self) -> Self:
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="devices and tap")
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    def do(self, step: Coroutine[Any, Any, Any]) -> Any:
        return asyncio.run_coroutine_threadsafe(step, self._loop).result(PATIENCE)


class Counters:
    """Devices that count their answers: `count` and `other` are the number of this one, `slow` changes sometimes.

    `answers` are all that they have given, `silent` the units that answer nothing.
    """

    def __init__(self) -> None:
        self.answers: list[Answer] = []
        self.silent: set[int] = set()
        self.port = free_port()
        self._numbers = dict.fromkeys(range(1, DEVICES + 1), 0)

    async def start(self) -> None:
        loop = asyncio.get_running_loop()
        self._server = await loop.create_server(lambda: _Answering(self), "127.0.0.1", self.port)

    async def stop(self) -> None:
        self._server.close()

    def respond(self, asked: TcpFrame) -> bytes | None:
        """The response; None if it gives none."""
        if asked.unit in self.silent or asked.unit not in self._numbers:
            return None
        span = parse_request(asked.pdu).read
        number = self._numbers[asked.unit] = self._numbers[asked.unit] + 1
        values = {"count": number, "slow": number // SLOW, "other": number}
        own = {name: values[name] for at, name in POINTS.items() if span.start <= at < span.end}
        words = [0] * span.count
        for at, name in POINTS.items():
            if name in own:
                words[at - span.start : at - span.start + 2] = divmod(own[name], 0x10000)
        self.answers.append(Answer(device_name(asked.unit), time.time(), own))
        return bytes((3, 2 * len(words))) + b"".join(word.to_bytes(2, "big") for word in words)


class _Answering(asyncio.Protocol):
    """A connection to the devices."""

    def __init__(self, counters: Counters) -> None:
        self._counters = counters
        self._framer = MbapFramer()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport: Any = transport

    def data_received(self, data: bytes) -> None:
        for asked in self._framer.cut(data):
            response = self._counters.respond(asked)
            if response is not None:
                self._transport.write(encode(asked.transaction, asked.unit, response))


class Consumer:
    """Subscribes to everything. `heard` are all messages that were published while it was there.

    It confirms none: who writes to a broker that has gone does not read what that has sent last.
    """

    def __init__(self, port: int) -> None:
        self.heard: list[Heard] = []
        self._port = port
        self._client: Client | None = None

    def connect(self) -> None:
        """Connect and subscribe anew; the broker has just started."""
        self.leave()
        client = self._client = Client(CallbackAPIVersion.VERSION2, "consumer", protocol=MQTTProtocolVersion.MQTTv5)
        subscribed = threading.Event()
        self._gone = gone = threading.Event()
        properties = Properties(PacketTypes.CONNECT)
        properties.ReceiveMaximum = 65535
        options = SubscribeOptions(qos=0, retainHandling=SubscribeOptions.RETAIN_DO_NOT_SEND)
        client.on_connect = lambda *_: client.subscribe("#", options=options)
        client.on_subscribe = lambda *_: subscribed.set()
        client.on_disconnect = lambda *_: gone.set()
        client.on_message = self._hear
        client.connect("127.0.0.1", self._port, keepalive=3600, properties=properties)
        client.loop_start()
        assert subscribed.wait(PATIENCE)

    def drain(self) -> None:
        """Wait until everything is here that a broker has sent which is gone by now."""
        assert self._gone.wait(PATIENCE)

    def leave(self) -> None:
        client, self._client = self._client, None
        if client is not None:
            client.disconnect()
            client.loop_stop()
            client.on_connect = client.on_subscribe = client.on_disconnect = client.on_message = None

    def _hear(self, _client: Client, _data: object, message: MQTTMessage) -> None:
        self.heard.append(Heard(time.time(), message.topic, message.payload))


class PlantBroker:
    """mosquitto, its subscriber and the tap before it, as one: what is away is away for the gateway too."""

    def __init__(self, folder: Path, loop: Loop) -> None:
        self.broker = Mosquitto(folder, "max_inflight_messages 0", "max_queued_messages 0", "log_type error")
        self.tap = Tap(self.broker.port)
        self.consumer = Consumer(self.broker.port)
        self._loop = loop

    def start(self) -> None:
        """Start it; the gateway can connect as soon as there is a subscriber."""
        self.broker.start()
        self.consumer.connect()
        self._loop.do(self.tap.open())

    def end(self, number: signal.Signals) -> None:
        """End it."""
        self._loop.do(self.tap.close())
        self.broker.signal(number)
        self.broker.wait()
        self.consumer.drain()

    def stop(self) -> None:
        """End all of it, for good."""
        self._loop.do(self.tap.close())
        self._loop.do(self.tap.cut())
        self.consumer.leave()
        self.broker.kill()

    def cut(self) -> None:
        """End the gateway's connection, and take none for now."""
        self._loop.do(self.tap.close())
        self._loop.do(self.tap.cut())

    def mend(self) -> None:
        self._loop.do(self.tap.open())
