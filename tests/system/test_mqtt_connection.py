"""One connection to a broker, byte by byte: what it asks for, what counts as confirmed, what it does not take."""

import asyncio
import socket
import time

import pytest
from paho.mqtt.client import Client

from gateway.plant.client import LARGEST_PACKET
from gateway.plant.messages import Message
from kit.mqtt_peer import (
    CONNACK,
    CONNECT,
    PINGRESP,
    PUBACK,
    PUBLISH,
    UNSUBACK,
    UNSUBSCRIBE,
    closed,
    connected,
    packet,
    until,
)
from kit.process import PATIENCE

CLEAN = 0x02
MAXIMUM_PACKET_SIZE, RECEIVE_MAXIMUM = 0x27, 0x21


async def test_a_small_message_does_not_wait_for_the_acknowledgement_of_the_one_before():
    async with connected() as (connection, _):
        assert connection._client.socket().getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)


@pytest.mark.parametrize("version", ["5", "3.1.1"])
async def test_an_answer_confirms_the_messages_before_the_question(version):
    confirmed = []
    messages = [Message("value", str(number).encode(), qos=0) for number in range(30)]
    async with connected(version, confirmed=lambda *what: confirmed.append(what)) as (connection, peer):
        for message in messages:
            connection.publish(message)
        assert connection.in_flight == 30
        for left in (29, 0):  # the first question was sent after the first message, the second one after all
            number = (await peer.next(UNSUBSCRIBE))[:2]
            peer.say(packet(UNSUBACK, number + (b"\0\x11" if version == "5" else b"")))
            await until(lambda left=left: connection.in_flight == left)
        assert connection.deadline is None
        assert confirmed == [(message, "", False) for message in messages]


async def test_what_was_not_confirmed_is_not_told_as_confirmed_when_the_connection_is_lost():
    confirmed = []
    messages = [Message("value", str(number).encode(), qos=number % 2) for number in range(6)]
    async with connected(confirmed=lambda *what: confirmed.append(what)) as (connection, peer):
        for message in messages:
            connection.publish(message)
        peer.say(packet(PUBACK, peer.number(await peer.next(PUBLISH, b"3"))))
        await until(lambda: connection.in_flight == 5)
        peer.writer.close()
        await connection.lost
        connection.close()
        assert confirmed == [(messages[3], "", False)]


async def test_a_message_that_is_never_confirmed_is_due_some_time_whatever_else_is(monkeypatch):
    monkeypatch.setattr("gateway.plant.connection.LONGEST", 5.0)
    loop = asyncio.get_running_loop()
    async with connected() as (connection, peer):
        before = loop.time()
        for text in (b"1", b"2"):
            connection.publish(Message("value", text))
        peer.say(packet(PUBACK, peer.number(await peer.next(PUBLISH, b"2"))))
        await until(lambda: connection.in_flight == 1)
        assert connection.deadline - before == pytest.approx(5.0, abs=0.5)


async def test_the_broker_says_what_it_accepts():
    limits = bytes((RECEIVE_MAXIMUM, 0, 3, MAXIMUM_PACKET_SIZE, 0, 0, 8, 0))
    async with connected(connack=packet(CONNACK, bytes(2), limits)) as (connection, _):
        assert connection.most_in_flight == 3
        assert connection.largest == 2048
    async with connected() as (connection, _):
        assert connection.largest == LARGEST_PACKET


async def test_a_message_that_the_broker_would_not_take_is_refused_without_it():
    """It would end the connection for that, each time anew."""
    limit, answers, topic = 300, [], "value"
    connack = packet(CONNACK, bytes(2), bytes((MAXIMUM_PACKET_SIZE, *limit.to_bytes(4))))
    async with connected(connack=connack, confirmed=lambda *answer: answers.append(answer)) as (connection, peer):
        for length in (400, 250):
            connection.publish(Message(topic, bytes(length), expiry=3.0, correlation=b"7"))
        assert [(len(message.payload), *rest) for message, *rest in answers] == [
            (400, "value has 424 bytes, but the broker accepts no more than 300", False)
        ]
        assert connection.in_flight == 1
        assert 250 < len(await peer.next(PUBLISH)) < limit
        connection.publish(Message(topic, bytes(400), qos=0))  # of Sparkplug: none may be missing
        assert (await connection.lost).endswith("but the broker accepts no more than 300")
        assert len(answers) == 1


@pytest.mark.parametrize("version", ["5", "3.1.1"])
async def test_the_broker_keeps_nothing_of_earlier_sessions(version):
    async with connected(version) as (_, peer):
        assert (await peer.next(CONNECT))[len(b"\0\4MQTT5")] & CLEAN


async def test_it_asks_for_no_large_packets():
    async with connected() as (_, peer):
        assert bytes((MAXIMUM_PACKET_SIZE, *LARGEST_PACKET.to_bytes(4))) in await peer.next(CONNECT)


@pytest.mark.parametrize("version", ["5", "3.1.1"])
async def test_a_packet_that_is_too_large_ends_the_connection_before_it_is_read(version):
    deliveries = []
    async with connected(version, deliver=deliveries.append) as (connection, peer):
        small = b"\0\1t" + (b"\0" if version == "5" else b"")
        peer.say(bytes((PUBLISH, len(small))) + small)
        await until(lambda: deliveries)
        peer.say(bytes((PUBLISH, 0xFF, 0xFF, 0xFF, 0x7F)) + bytes(1000))
        async with asyncio.timeout(PATIENCE):
            assert await connection.lost == f"it has sent a message of more than {LARGEST_PACKET} bytes"
        for qos in (0, 1):
            connection.publish(Message("value", b"1", qos=qos))
        connection.end(with_will=False)
        assert connection.in_flight == 2


async def test_an_error_of_the_library_while_it_pings_ends_the_connection(monkeypatch):
    def fail(_client: Client) -> None:
        raise OSError("broken")

    async with connected() as (connection, _):
        monkeypatch.setattr(Client, "loop_misc", fail)
        async with asyncio.timeout(PATIENCE):
            assert "broken" in await connection.lost


class Decrypted:
    """A socket with a second packet that is decrypted already, as the library wraps one for WebSockets."""

    def __init__(self, sock: socket.socket) -> None:
        self.fileno = sock.fileno
        self.close = sock.close
        self._waiting = [1]

    def pending(self) -> int:
        """How many bytes select does not know of."""
        return self._waiting.pop() if self._waiting else 0


async def test_what_is_decrypted_already_is_read_too(monkeypatch):
    async with connected() as (connection, peer):
        reads, read = [], Client.loop_read
        client = connection._client
        wrapped = Decrypted(client.socket())
        monkeypatch.setattr(client, "socket", lambda: wrapped)
        monkeypatch.setattr(client, "loop_read", lambda: (reads.append(1), read(client)))
        peer.say(PINGRESP)
        await until(lambda: len(reads) == 2)


async def test_a_connection_that_was_given_up_does_not_log_in_later(monkeypatch):
    """It would end the session of the next one: both have the same name."""
    began, look_up = asyncio.Event(), socket.getaddrinfo
    loop = asyncio.get_running_loop()

    def slow(*names):
        loop.call_soon_threadsafe(began.set)
        time.sleep(0.3)
        return look_up(*names)

    async with closed() as (connection, peer):
        monkeypatch.setattr(socket, "getaddrinfo", slow)
        opening = asyncio.create_task(connection.open())
        await began.wait()
        opening.cancel()
        connection.close()
        await until(lambda: peer.writer is not None and peer.writer.transport.is_closing())
        assert peer.packets.empty()
