"""One connection to a broker: the only module that knows the MQTT library."""

import asyncio
import ssl
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from socket import socket as Socket  # noqa: N812 - a type here
from typing import Any, Final, Literal

from paho.mqtt.client import MQTT_CLEAN_START_FIRST_ONLY, Client, ConnectFlags, DisconnectFlags, MQTTMessage
from paho.mqtt.enums import CallbackAPIVersion, MQTTProtocolVersion
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode
from paho.mqtt.subscribeoptions import SubscribeOptions

from gateway.errors import BrokerError
from gateway.plant.messages import Delivery, Message
from gateway.ports.threads import ThreadPerCall
from gateway.tls.reasons import explain

#: Versions of MQTT, the newest first.
Version = Literal["5", "3.1.1"]
VERSIONS: Final[tuple[Version, ...]] = ("5", "3.1.1")

#: How long each step of connecting may take, in seconds, and how often the broker must be heard at least.
STEP_TIME: Final = 10.0
KEEP_ALIVE: Final = 15
#: The most messages that the broker has not confirmed yet; fewer if it wants that. They grow old if it pauses.
MOST_IN_FLIGHT: Final = 20
#: The largest packet that is taken from the broker, in bytes.
LARGEST_PACKET: Final = 65536

_PROTOCOLS: Final = {"5": MQTTProtocolVersion.MQTTv5, "3.1.1": MQTTProtocolVersion.MQTTv311}
_UNSUPPORTED_VERSION: Final = 0x84
_WRONG_LOGIN: Final = 0x86
_NO_RIGHT: Final = 0x87
#: Brokers say the one or the other when a client logs in, whatever the cause.
_LOGIN_REFUSED: Final = "user or password is wrong, or this user may not connect"
_WITH_WILL: Final = 0x04
#: Refusals that say nothing of the message: unspecified error, implementation specific error, quota exceeded.
_PASSING: Final = (0x80, 0x83, 0x97)
_REASONS: Final = {
    0x84: "it does not have this version of MQTT",
    0x85: "it refuses this client identifier",
    _NO_RIGHT: "it says that this user has no right",
    0x88: "it is not available",
    0x8E: "another client has connected with the same identifier: is this site published twice?",
}


class WrongVersionError(BrokerError):
    """The broker does not have this version of MQTT, or closes the connection as if it had not."""


@dataclass(frozen=True, slots=True)
class BrokerSettings:
    """Where a broker is, and how to log in. `path` is for WebSockets, which are used if it is not empty."""

    host: str
    port: int
    path: str
    client: str
    user: str | None = None
    password: str | None = None
    context: ssl.SSLContext | None = None
    server_name: str = ""


class Connection:
    """A connection with one `version` of MQTT. `deliver` takes what is received.

    `confirmed` is called for each message that the broker has taken, or refused for the reason given; with the message
    if the broker may take it later. QoS 0 has no
    confirmation in MQTT; the answer to a ping that was sent after the message takes its place.
    """

    def __init__(
        self,
        settings: BrokerSettings,
        version: Version,
        will: Message,
        *,
        deliver: Callable[[Delivery], None],
        confirmed: Callable[[Message | None, str], None],
        unix: Callable[[], float],
    ) -> None:
        self.version = version
        self.in_flight = 0
        #: When the broker must have confirmed something, by the clock of the event loop; None if it has confirmed all.
        self.deadline: float | None = None
        self.most_in_flight = MOST_IN_FLIGHT
        self._settings = settings
        self._deliver = deliver
        self._confirmed = confirmed
        self._unix = unix
        self._loop = asyncio.get_running_loop()
        self._accepted: asyncio.Future[None] = self._loop.create_future()
        self._subscribed: dict[int, asyncio.Future[list[ReasonCode]]] = {}
        #: Done when the connection is lost, with the reason.
        self.lost: asyncio.Future[str] = self._loop.create_future()
        self._unpinged = self._pinged = 0
        self._awaited: dict[int, Message] = {}
        self._client = self._new_client(will)
        self._timer: asyncio.TimerHandle | None = None
        self._is_abandoned = False

    async def open(self) -> None:
        """Connect and log in.

        Raises:
            WrongVersionError: with another version of MQTT it may succeed.
            BrokerError: it cannot be reached, or refuses.
        """
        try:
            async with asyncio.timeout(2 * STEP_TIME):
                await self._loop.run_in_executor(ThreadPerCall("connect to broker"), self._connect)
                self._watch()
                await self._accepted
        except TimeoutError:
            raise BrokerError(f"it does not answer within {2 * STEP_TIME:g} s") from None
        except ssl.SSLError as error:
            raise BrokerError(explain(error)) from error
        except ssl.CertificateError as error:
            raise BrokerError(f"its certificate is refused: {error}") from error
        except (OSError, ValueError) as error:
            raise BrokerError(str(getattr(error, "strerror", None) or error)) from error

    async def subscribe(self, topics: Sequence[str]) -> None:
        """Subscribe, and wait for the confirmation.

        Raises:
            BrokerError: the broker refuses, or the connection is lost.
        """
        if not topics:
            return
        error, number = self._client.subscribe([self._subscription(topic) for topic in topics])
        if number is None:
            raise BrokerError(f"it cannot be subscribed to: {error.name}")
        confirmed = self._subscribed[number] = self._loop.create_future()
        try:
            async with asyncio.timeout(STEP_TIME):
                reasons = await confirmed
        except TimeoutError:
            raise BrokerError("it does not confirm a subscription") from None
        for topic, reason in zip(topics, reasons, strict=False):
            if reason.is_failure:
                raise BrokerError(self._refused(reason, f"subscribe to {topic}"))

    def publish(self, message: Message) -> None:
        """Send a message. `in_flight` counts it until it is confirmed: beyond `most_in_flight` none should be sent."""
        properties = None
        if self.version == "5" and (message.expiry is not None or message.correlation is not None):
            properties = Properties(PacketTypes.PUBLISH)  # type: ignore[no-untyped-call]
            if message.expiry is not None:
                properties.MessageExpiryInterval = max(1, round(message.expiry))
            if message.correlation is not None:
                properties.CorrelationData = message.correlation
        if not self.in_flight:
            self.deadline = self._loop.time() + STEP_TIME
        self.in_flight += 1
        sent = self._client.publish(message.topic, message.payload, message.qos, message.retain, properties)
        if message.qos:
            self._awaited[sent.mid] = message
        else:
            self._unpinged += 1
            self._ping()

    def end(self, *, with_will: bool) -> None:
        """Log out; the broker publishes the will if that is said, and with MQTT 5 only."""
        reason = (
            ReasonCode(PacketTypes.DISCONNECT, identifier=_WITH_WILL) if with_will and self.version == "5" else None
        )
        self._client.disconnect(reason)

    def close(self) -> None:
        """Close it. Nothing is delivered any more."""
        self._is_abandoned = True
        if self._timer is not None:
            self._timer.cancel()
        client = self._client
        client.on_message = client.on_publish = client.on_disconnect = client.on_connect = client.on_subscribe = None
        sock = client.socket()
        if sock is not None:
            self._unwatch(sock)
            with suppress(OSError):
                sock.close()
        self._accepted.cancel()
        for waiting in self._subscribed.values():
            waiting.cancel()

    def _new_client(self, will: Message) -> Client:
        settings = self._settings
        client = Client(
            CallbackAPIVersion.VERSION2,
            settings.client,
            protocol=_PROTOCOLS[self.version],
            clean_session=None if self.version == "5" else True,
            transport="websockets" if settings.path else "tcp",
            reconnect_on_failure=False,
        )
        client.connect_timeout = STEP_TIME
        client.max_inflight_messages_set(MOST_IN_FLIGHT)
        client.max_queued_messages_set(2 * MOST_IN_FLIGHT)
        client.will_set(will.topic, will.payload, will.qos, will.retain)
        if settings.user is not None:
            client.username_pw_set(settings.user, settings.password)
        if settings.context is not None:
            client.tls_set_context(_named(settings.context, settings.server_name))
        if settings.path:
            client.ws_set_options(path=settings.path)
        client.on_connect = self._on_connect
        client.on_disconnect = self._on_disconnect
        client.on_subscribe = self._on_subscribe
        client.on_publish = self._on_publish
        client.on_message = self._on_message
        return client

    def _subscription(self, topic: str) -> tuple[str, Any]:
        """With MQTT 5, what was published as retained is delivered as such."""
        return topic, SubscribeOptions(qos=1, retainAsPublished=True) if self.version == "5" else 1

    # --- in a thread ---

    def _connect(self) -> None:
        """Connect; name servers and TLS may take their time."""
        settings, is_newest, properties = self._settings, self.version == "5", None
        if is_newest:
            properties = Properties(PacketTypes.CONNECT)  # type: ignore[no-untyped-call]
            properties.MaximumPacketSize = LARGEST_PACKET
        self._client.connect(
            settings.host,
            settings.port,
            KEEP_ALIVE,
            clean_start=True if is_newest else MQTT_CLEAN_START_FIRST_ONLY,
            properties=properties,
        )
        if self._is_abandoned:
            sock = self._client.socket()
            if sock is not None:
                sock.close()

    # --- in the event loop ---

    def _watch(self) -> None:
        sock = self._client.socket()
        if sock is None:
            raise BrokerError("it has closed the connection")
        self._client.on_socket_close = self._on_socket_close
        self._client.on_socket_register_write = self._on_more_to_write
        self._client.on_socket_unregister_write = self._on_all_written
        self._loop.add_reader(sock, self._readable)
        if self._client.want_write():
            self._loop.add_writer(sock, self._writable)
        self._tick()

    def _unwatch(self, sock: Any) -> None:
        if sock.fileno() >= 0:
            self._loop.remove_reader(sock)
            self._loop.remove_writer(sock)

    def _readable(self) -> None:
        try:
            self._read()
            while (pending := getattr(self._client.socket(), "pending", None)) is not None and pending():
                self._read()
        except BrokerError as error:
            self._unwatch(self._client.socket())
            self._fail(str(error))
        except Exception as error:  # noqa: BLE001 - the library raises anything for packets that are none
            self._fail(f"what it sends is not understood: {error!r}")

    def _read(self) -> None:
        self._client.loop_read()
        if self._client._in_packet["remaining_length"] > LARGEST_PACKET:  # noqa: SLF001 - the library has no limit
            raise BrokerError(f"it has sent a message of more than {LARGEST_PACKET} bytes")
        self._ping()

    def _writable(self) -> None:
        try:
            self._client.loop_write()
        except OSError as error:
            self._fail(str(error))

    def _ping(self) -> None:
        """Ping after messages with QoS 0, one ping at a time; count them as confirmed when it was answered."""
        client = self._client
        if client._ping_t:  # noqa: SLF001 - the library has no other sign of an answer than that this is 0 again
            return
        answered, self._pinged, self._unpinged = self._pinged, self._unpinged, 0
        if self._pinged:
            client._send_pingreq()  # noqa: SLF001 - the library pings by itself only if nothing else is sent
        for _ in range(answered):
            self._count_confirmed(None, "")

    def _count_confirmed(self, message: Message | None, refusal: str) -> None:
        self.in_flight -= 1
        self.deadline = self._loop.time() + STEP_TIME if self.in_flight else None
        self._confirmed(message, refusal)

    def _tick(self) -> None:
        self._timer = self._loop.call_later(1.0, self._tick)
        try:
            self._client.loop_misc()
        except Exception as error:  # noqa: BLE001 - the library raises anything when a ping cannot be written
            self._fail(f"the connection was lost: {error!r}")

    def _on_more_to_write(self, _client: Client, _data: Any, sock: Any) -> None:
        self._loop.add_writer(sock, self._writable)

    def _on_all_written(self, _client: Client, _data: Any, sock: Any) -> None:
        self._loop.remove_writer(sock)

    def _on_socket_close(self, _client: Client, _data: Any, sock: Any) -> None:
        self._unwatch(sock)

    def _fail(self, reason: str) -> None:
        if not self._accepted.done():
            self._accepted.set_exception(BrokerError(reason))
        for waiting in self._subscribed.values():
            if not waiting.done():
                waiting.set_exception(BrokerError(reason))
        if not self.lost.done():
            self.lost.set_result(reason)

    def _on_connect(
        self, _client: Client, _data: Any, _flags: ConnectFlags, reason: ReasonCode, properties: Properties | None
    ) -> None:
        if self._accepted.done():
            return
        if reason.value == _UNSUPPORTED_VERSION:
            self._accepted.set_exception(WrongVersionError(_REASONS[_UNSUPPORTED_VERSION]))
        elif reason.is_failure:
            is_login = reason.value in (_WRONG_LOGIN, _NO_RIGHT)
            self._accepted.set_exception(BrokerError(_LOGIN_REFUSED if is_login else _in_words(reason)))
        else:
            wanted = getattr(properties, "ReceiveMaximum", MOST_IN_FLIGHT)
            self.most_in_flight = min(MOST_IN_FLIGHT, wanted)
            self._accepted.set_result(None)

    def _on_disconnect(
        self, _client: Client, _data: Any, flags: DisconnectFlags, reason: ReasonCode, _properties: Properties | None
    ) -> None:
        if not self._accepted.done():  # some brokers close the connection instead of an answer
            self._accepted.set_exception(WrongVersionError("it has closed the connection without an answer"))
        is_told = flags.is_disconnect_packet_from_server
        self._fail(_in_words(reason) if is_told else "the connection was lost")

    def _on_subscribe(
        self, _client: Client, _data: Any, number: int, reasons: list[ReasonCode], _properties: Properties | None
    ) -> None:
        confirmed = self._subscribed.pop(number, None)
        if confirmed is not None and not confirmed.done():
            confirmed.set_result(reasons)

    def _on_publish(
        self, _client: Client, _data: Any, number: int, reason: ReasonCode, _properties: Properties | None
    ) -> None:
        message = self._awaited.pop(number, None)
        if message is not None:  # with QoS 0 it says that the message is written, and no more
            is_passing = reason.value in _PASSING
            refusal = self._refused(reason, f"publish to {message.topic}") if reason.is_failure else ""
            self._count_confirmed(message if is_passing else None, refusal)

    def _refused(self, reason: ReasonCode, what: str) -> str:
        """Why the gateway may not do something, in words."""
        if reason.value == _NO_RIGHT:
            user = self._settings.user
            who = "a client without a user" if user is None else f'user "{user}"'
            return f"{who} may not {what}"
        return f"to {what} is refused: {_in_words(reason)}"

    def _on_message(self, _client: Client, _data: Any, message: MQTTMessage) -> None:
        properties = message.properties
        self._deliver(
            Delivery(
                message.topic,
                bytes(message.payload),
                self._unix(),
                is_retained=message.retain,
                is_duplicate=message.dup,
                expiry=getattr(properties, "MessageExpiryInterval", None),
                correlation=getattr(properties, "CorrelationData", None),
            )
        )


class _Named:
    """A context that asks for the certificate of another name than that of the host."""

    check_hostname = True

    def __init__(self, context: ssl.SSLContext, name: str) -> None:
        self._context = context
        self._name = name

    def wrap_socket(self, sock: Socket, *, server_hostname: str, do_handshake_on_connect: bool) -> ssl.SSLSocket:  # noqa: ARG002
        """See ssl.SSLContext."""
        return self._context.wrap_socket(
            sock, server_hostname=self._name, do_handshake_on_connect=do_handshake_on_connect
        )


def _named(context: ssl.SSLContext, name: str) -> Any:
    return _Named(context, name)


def _in_words(reason: ReasonCode) -> str:
    return _REASONS.get(reason.value) or f"it says: {reason}"
