"""Somebody who hears and says bytes at a broker, as Sparkplug needs it."""

import time
from collections.abc import Callable, Collection
from queue import Empty, Queue
from threading import Event
from typing import NamedTuple, Self

from paho.mqtt.client import Client, MQTTMessage
from paho.mqtt.enums import CallbackAPIVersion

from kit.mosquitto import Mosquitto
from kit.process import PATIENCE


class Heard(NamedTuple):
    """A message."""

    topic: str
    payload: bytes
    retain: bool
    qos: int


class Listener:
    """Hears everything below `topics`, and may say something. `heard` has all messages, in their order."""

    def __init__(self, broker: Mosquitto, *topics: str) -> None:
        self.heard: list[Heard] = []
        self._queue: Queue[Heard] = Queue()
        self._topics = topics
        self._port = broker.port
        self._client = Client(CallbackAPIVersion.VERSION2)
        self._subscribed = Event()
        self._client.on_connect = self._subscribe
        self._client.on_subscribe = lambda *_: self._subscribed.set()
        self._client.on_message = self._hear

    def __enter__(self) -> Self:
        self._client.connect("127.0.0.1", self._port)
        self._client.loop_start()
        assert self._subscribed.wait(PATIENCE)
        return self

    def __exit__(self, *_: object) -> None:
        self._client.disconnect()
        self._client.loop_stop()
        # The library closes the sockets with which it wakes its thread only when nobody has the client any more.
        self._client.on_connect = self._client.on_subscribe = self._client.on_message = None
        del self._client

    def say(self, topic: str, payload: bytes, *, qos: int = 1, retain: bool = False) -> None:
        """Publish a message; the broker has it once this returns."""
        self._client.publish(topic, payload, qos, retain).wait_for_publish(PATIENCE)

    def wait_for(self, topic: str, *, where: Callable[[bytes], object] = lambda _: True) -> bytes:
        """The payload of the next message with this topic (its end is enough) that is as it should be."""
        deadline = time.monotonic() + PATIENCE
        while True:
            try:
                message = self._queue.get(timeout=max(0.0, deadline - time.monotonic()))
            except Empty:
                raise AssertionError(f"nothing came for {topic}; heard: {self.heard[-20:]}") from None
            if message.topic.endswith(topic) and where(message.payload):
                return message.payload

    def wait_for_all(self, topics: Collection[str], payload: bytes) -> None:
        """Until each of `topics` has had this payload, earlier or from now on."""
        deadline = time.monotonic() + PATIENCE
        while missing := set(topics) - {each.topic for each in list(self.heard) if each.payload == payload}:
            assert time.monotonic() < deadline, f"never {payload!r} on {missing}; heard: {self.heard[-20:]}"
            time.sleep(0.02)

    def _subscribe(self, client: Client, *_: object) -> None:
        client.subscribe([(topic, 1) for topic in self._topics])

    def _hear(self, _client: Client, _data: object, message: MQTTMessage) -> None:
        heard = Heard(message.topic, message.payload, message.retain, message.qos)
        self.heard.append(heard)
        self._queue.put(heard)
