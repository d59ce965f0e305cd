"""The client of the MQTT library as the gateway uses it, and what only private names of the library give."""

import ssl
from dataclasses import dataclass
from socket import socket as Socket  # noqa: N812 - a type here
from typing import Any, Final, Literal

from paho.mqtt.client import MQTT_CLEAN_START_FIRST_ONLY, Client
from paho.mqtt.enums import CallbackAPIVersion, MQTTProtocolVersion
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode
from paho.mqtt.subscribeoptions import SubscribeOptions

from gateway.plant.messages import Message

#: Versions of MQTT, the newest first.
Version = Literal["5", "3.1.1"]
VERSIONS: Final[tuple[Version, ...]] = ("5", "3.1.1")

#: How long each step of connecting may take, and the keep-alive interval of MQTT, both in seconds.
STEP_TIME: Final = 10.0
KEEP_ALIVE: Final = 15
#: The most messages that the broker has not confirmed yet, or fewer if it asks for that: they age if it pauses.
MOST_IN_FLIGHT: Final = 20
#: The largest packet that is accepted from the broker, in bytes.
LARGEST_PACKET: Final = 65536

_PROTOCOLS: Final = {"5": MQTTProtocolVersion.MQTTv5, "3.1.1": MQTTProtocolVersion.MQTTv311}
_WITH_WILL: Final = 0x04


@dataclass(frozen=True, slots=True)
class BrokerSettings:
    """The address of a broker, and the login. WebSockets are used if `path` is not empty."""

    host: str
    port: int
    path: str
    client: str
    user: str | None = None
    password: str | None = None
    context: ssl.SSLContext | None = None
    server_name: str = ""


class BrokerClient(Client):
    """A client with one `version` of MQTT. The broker publishes its `will` when the connection is lost.

    It uses three private names of the library; tests/system/test_mqtt_connection.py shows that they keep their meaning.
    """

    def __init__(self, settings: BrokerSettings, version: Version, will: Message) -> None:
        super().__init__(
            CallbackAPIVersion.VERSION2,
            settings.client,
            protocol=_PROTOCOLS[version],
            clean_session=None if version == "5" else True,
            transport="websockets" if settings.path else "tcp",
            reconnect_on_failure=False,
        )
        self._settings = settings
        self._is_newest = version == "5"
        self.connect_timeout = STEP_TIME
        self.max_inflight_messages_set(MOST_IN_FLIGHT)
        self.max_queued_messages_set(2 * MOST_IN_FLIGHT)
        self.will_set(will.topic, will.payload, will.qos, will.retain)
        if settings.user is not None:
            self.username_pw_set(settings.user, settings.password)
        if settings.context is not None:
            self.tls_set_context(_named(settings.context, settings.server_name))
        if settings.path:
            self.ws_set_options(path=settings.path)

    def log_in(self) -> None:
        """Connect, and send the login. Blocks while names are looked up and during the TLS handshake.

        Raises:
            OSError: the broker cannot be reached, or TLS fails.
            ValueError: the library refuses the settings.
        """
        properties = None
        if self._is_newest:
            properties = Properties(PacketTypes.CONNECT)  # type: ignore[no-untyped-call]
            properties.MaximumPacketSize = LARGEST_PACKET
        self.connect(
            self._settings.host,
            self._settings.port,
            KEEP_ALIVE,
            clean_start=True if self._is_newest else MQTT_CLEAN_START_FIRST_ONLY,
            properties=properties,
        )

    def log_out(self, *, with_will: bool) -> None:
        """Log out; `with_will` has the broker publish the will, with MQTT 5 only."""
        is_said = with_will and self._is_newest
        self.disconnect(ReasonCode(PacketTypes.DISCONNECT, identifier=_WITH_WILL) if is_said else None)

    def send(self, message: Message) -> int:
        """Publish a message; return its number."""
        properties = None
        if self._is_newest and (message.expiry is not None or message.correlation is not None):
            properties = Properties(PacketTypes.PUBLISH)  # type: ignore[no-untyped-call]
            if message.expiry is not None:
                properties.MessageExpiryInterval = max(1, round(message.expiry))
            if message.correlation is not None:
                properties.CorrelationData = message.correlation
        return self.publish(message.topic, message.payload, message.qos, message.retain, properties).mid

    def subscription(self, topic: str) -> tuple[str, Any]:
        """Return the argument that subscribes to `topic`. With MQTT 5, deliveries keep their retain flag."""
        return topic, SubscribeOptions(qos=1, retainAsPublished=True) if self._is_newest else 1

    @property
    def size_of_packet(self) -> int:
        """The size of the packet being read, in bytes after its fixed header: the library does not limit it."""
        return int(self._in_packet["remaining_length"])

    @property
    def awaits_pong(self) -> bool:
        """Whether a ping was sent that is not answered yet."""
        return bool(self._ping_t)

    def ping(self) -> None:
        """Ping now: the library pings by itself only if nothing else is sent."""
        self._send_pingreq()


class _Named:
    """A context that checks the certificate against `name` instead of the host."""

    check_hostname = True

    def __init__(self, context: ssl.SSLContext, name: str) -> None:
        self._context = context
        self._name = name

    def wrap_socket(self, sock: Socket, *, server_hostname: str, do_handshake_on_connect: bool) -> ssl.SSLSocket:  # noqa: ARG002
        """Wrap a socket as ssl.SSLContext does, with the other name."""
        return self._context.wrap_socket(
            sock, server_hostname=self._name, do_handshake_on_connect=do_handshake_on_connect
        )


def _named(context: ssl.SSLContext, name: str) -> Any:
    return _Named(context, name)
