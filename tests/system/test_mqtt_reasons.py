"""The reasons that a broker gives for what it refuses and for an end, in words."""

import asyncio

import pytest
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.reasoncodes import ReasonCode

from gateway.errors import BrokerError
from gateway.plant.messages import Message
from gateway.plant.reasons import UNTOLD, SubscriptionRefusedError, WrongVersionError
from gateway.plant.reasons import lost as lost_without_a_word
from kit.mqtt_peer import CONNACK, DISCONNECT, PUBACK, PUBLISH, SUBACK, SUBSCRIBE, closed, connected, packet, until
from kit.process import PATIENCE

SERVER_REFERENCE, REASON_STRING = 0x1C, 0x1F
LOGIN = "user or password is wrong, or this user may not connect"
#: Reason codes that do not concern what this gateway sends; their names are told.
NOT_OURS = {
    0x8F: "topic filter invalid",
    0x90: "topic name invalid",
    0x91: "packet identifier in use",
    0x94: "topic alias invalid",
    0x99: "payload format invalid",
    0x9E: "shared subscription not supported",
    0xA1: "subscription identifiers not supported",
    0xA2: "wildcard subscription not supported",
}


def codes(kind: int) -> list[int]:
    """The reason codes that MQTT 5 has for a failure in such a packet."""
    return [
        code for code, names in ReasonCode.names.items() if code >= 0x80 and any(kind in of for of in names.values())
    ]


def text(which: int, content: str) -> bytes:
    """A property."""
    return bytes((which, 0, len(content.encode()))) + content.encode()


async def lost(reason: bytes, properties: bytes = b"") -> str:
    """Why a connection was lost that the broker has ended so."""
    async with connected() as (connection, peer):
        peer.say(packet(DISCONNECT, reason, properties))
        async with asyncio.timeout(PATIENCE):
            return await connection.lost


async def refused(version: str, connack: bytes) -> BrokerError:
    """The error of a login that the broker has refused."""
    async with closed(version, connack) as (connection, _):
        with pytest.raises(BrokerError) as caught:
            await connection.open()
    return caught.value


@pytest.mark.parametrize(
    ("code", "words"),
    [
        (0x00, "it has ended the connection"),
        (0x87, "it says that this user has no right"),
        (0x89, "it is busy"),
        (0x8B, "it is shutting down"),
        (0x8D, "keep alive timeout: it has heard nothing from this gateway for too long"),
        (
            0x8E,
            "session taken over: another client uses the same name; two gateways must not have the same site",
        ),
        (0x93, "receive maximum exceeded: more messages are unconfirmed than it allows"),
        (0x95, "packet too large: a message is larger than it allows"),
        (0x96, "message rate too high: messages come faster than it allows"),
        (0x97, "quota exceeded: it has a limit for this client or user"),
        (0x98, "administrative action: somebody has ended the connection at the broker"),
        (0x9C, "it wants this gateway to use another server"),
        (0x9D, "it has moved to another server for good"),
        (0xA0, "maximum connect time: it allows no longer connection"),
    ],
)
async def test_a_broker_says_why_it_ends_a_connection(code, words):
    assert await lost(bytes((code,))) == words


async def test_each_reason_for_an_end_has_words():
    found = {code: await lost(bytes((code,))) for code in codes(PacketTypes.DISCONNECT)}
    named = {code: words.removeprefix("it says: ") for code, words in found.items() if words.startswith("it says: ")}
    assert named.items() <= NOT_OURS.items()
    assert len(found) == 28


async def test_what_a_broker_adds_is_told_without_what_a_terminal_would_obey():
    moved = await lost(b"\x9d", text(REASON_STRING, "to the new \x1b[2Jhall") + text(SERVER_REFERENCE, "b2.plant:1883"))
    assert moved == 'it has moved to another server for good ("to the new [2Jhall; b2.plant:1883")'
    assert len(await lost(b"\x97", bytes((REASON_STRING, 0, 90)) + b"x" * 90)) < 200


@pytest.mark.parametrize("reason", [b"\xff", b"\x84"])
async def test_a_reason_that_does_not_exist_ends_the_connection_too(reason):
    assert (await lost(reason)).startswith("what it sends is not understood")


def test_a_broker_that_no_longer_answers_is_told_from_one_that_has_gone():
    silent, gone = (ReasonCode(PacketTypes.DISCONNECT, name) for name in ("Keep alive timeout", "Unspecified error"))
    assert (lost_without_a_word(silent), lost_without_a_word(gone)) == ("it does not answer a ping", UNTOLD)


@pytest.mark.parametrize(
    ("code", "words"),
    [
        (0x84, "it does not have this version of MQTT"),
        (0x85, "it refuses this client identifier"),
        (0x86, LOGIN),
        (0x87, LOGIN),
        (0x88, "it is not available"),
        (0x8A, "it has banned this client"),
        (0x8C, "it wants another kind of login than user and password"),
        (0x9A, "it keeps no retained messages, but this gateway publishes some"),
        (0x9B, "it does not have QoS 1, which this gateway needs"),
        (0x9F, "connection rate exceeded: connections come faster than it allows"),
    ],
)
async def test_a_broker_says_why_it_refuses_a_login(code, words):
    error = await refused("5", packet(CONNACK, bytes((0, code)), b""))
    assert str(error) == words
    assert isinstance(error, WrongVersionError) == (code == 0x84)


@pytest.mark.parametrize(
    ("code", "words"), [(2, "it refuses this client identifier"), (3, "it is not available"), (4, LOGIN), (5, LOGIN)]
)
async def test_one_with_mqtt_3_1_1_says_less(code, words):
    assert str(await refused("3.1.1", packet(CONNACK, bytes((0, code))))) == words


async def test_each_reason_for_a_refused_login_has_words():
    found = {
        code: str(await refused("5", packet(CONNACK, bytes((0, code)), b""))) for code in codes(PacketTypes.CONNACK)
    }
    named = {code: words.removeprefix("it says: ") for code, words in found.items() if words.startswith("it says: ")}
    assert named.items() <= NOT_OURS.items()
    assert len(found) == 20


@pytest.mark.parametrize("code", codes(PacketTypes.SUBACK))
async def test_a_broker_says_why_it_refuses_a_subscription(code):
    async with connected() as (connection, peer):
        subscribing = asyncio.create_task(connection.subscribe(["a/set", "b/set"]))
        number = (await peer.next(SUBSCRIBE))[:2]
        peer.say(packet(SUBACK, number + bytes((0, 1, code))))
        with pytest.raises(SubscriptionRefusedError) as caught:
            await subscribing
        assert not connection.lost.done()
    if code == 0x87:
        assert str(caught.value) == "a client without a user may not subscribe to b/set"
    else:
        assert str(caught.value).startswith("to subscribe to b/set is refused: ")


@pytest.mark.parametrize(
    ("code", "words", "passes"),
    [
        (0x80, "to publish to value is refused: it gives no reason", True),
        (0x83, "to publish to value is refused: it has a reason of its own, perhaps in its log", True),
        (0x87, "a client without a user may not publish to value", False),
        (0x90, "to publish to value is refused: it says: topic name invalid", False),
        (0x97, "to publish to value is refused: quota exceeded: it has a limit for this client or user", True),
        (0x99, "to publish to value is refused: it says: payload format invalid", False),
        (0x10, "", False),
    ],
)
@pytest.mark.parametrize("device", ["", "silo-1"])
async def test_a_broker_says_why_it_refuses_a_message(code, words, passes, device):
    """A right that is missing is waited for by what was kept, but no device asks for it with each read."""
    answers, is_passing = [], passes or (code == 0x87 and not device)
    async with connected(confirmed=lambda *answer: answers.append(answer)) as (connection, peer):
        message = Message("value", b"1", device=device)
        connection.publish(message)
        peer.say(packet(PUBACK, peer.number(await peer.next(PUBLISH)) + bytes((code,))))
        await until(lambda: connection.in_flight == 0)
        assert answers == [(message, words, is_passing)]
        assert not connection.lost.done()
