"""The client of the MQTT library, in the event loop."""

import asyncio
import os
import ssl
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from socket import IPPROTO_TCP, TCP_NODELAY
from socket import socket as Socket  # noqa: N812 - a type here
from types import SimpleNamespace
from typing import Any, Final, Literal

from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion, MQTTProtocolVersion
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode
from paho.mqtt.subscribeoptions import SubscribeOptions

from gateway.errors import BrokerError
from gateway.plant.messages import Message
from gateway.plant.reasons import INVALID, UNTOLD

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

#: The most bytes of a message that are neither topic nor payload nor correlation data.
_HEADS: Final = 5 + 2 + 2 + 1 + 5 + 3
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
    """A client with one `version` of MQTT, for one clean session. If that is lost, the broker publishes its `will`.

    `failed` gets what goes wrong in the event loop. One private name of the library is read;
    tests/system/test_mqtt_connection.py shows that it keeps its meaning.
    """

    def __init__(
        self, settings: BrokerSettings, version: Version, will: Message, failed: Callable[[BrokerError], None]
    ) -> None:
        self._is_newest = version == "5"
        super().__init__(
            CallbackAPIVersion.VERSION2,
            settings.client,
            protocol=_PROTOCOLS[version],
            transport="websockets" if settings.path else "tcp",
            reconnect_on_failure=False,
        )
        self._settings = settings
        self._failed = failed
        self._turns = asyncio.get_running_loop()
        self._timer: asyncio.TimerHandle | None = None
        self._is_closed = False
        self.on_socket_open = lambda _client, _data, sock: self._opened(sock)
        self.connect_timeout = STEP_TIME
        self.max_inflight_messages_set(0)  # the connection counts them
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
        properties = self._properties(PacketTypes.CONNECT, MaximumPacketSize=LARGEST_PACKET)
        self.connect(self._settings.host, self._settings.port, KEEP_ALIVE, properties=properties)

    def watch(self) -> None:
        """Read and write from now on whenever that is possible.

        Raises:
            BrokerError: the broker has closed the connection.
        """
        sock = self.socket()
        if sock is None:
            raise BrokerError("it has closed the connection")
        self.on_socket_register_write = lambda *_: self._more_to_write(sock)
        self.on_socket_unregister_write = lambda *_: self._all_written(sock)
        self.on_socket_close = lambda *_: self._unwatch(sock)
        self._turns.add_reader(sock, self._do, self._read)
        self._do(self.loop_write)  # what is left of the login
        self._tick()

    def close(self) -> None:
        """Close the connection, or have it closed as soon as the thread has made it."""
        self._is_closed = True
        if self._timer is not None:
            self._timer.cancel()
        sock = self.socket()
        if sock is not None:
            self._unwatch(sock)
            with suppress(OSError):
                sock.close()

    def log_out(self, *, with_will: bool) -> None:
        """Log out; `with_will` has the broker publish the will, with MQTT 5 only."""
        is_said = with_will and self._is_newest
        self.disconnect(ReasonCode(PacketTypes.DISCONNECT, identifier=_WITH_WILL) if is_said else None)

    def send(self, message: Message) -> int:
        """Publish a message; return its number."""
        expiry = None if message.expiry is None else max(1, round(message.expiry))
        properties = self._properties(
            PacketTypes.PUBLISH, MessageExpiryInterval=expiry, CorrelationData=message.correlation
        )
        return self.publish(message.topic, message.payload, message.qos, message.retain, properties).mid

    def ask(self) -> None:
        """Send what the broker must answer: that topic of the will, never subscribed to, is unsubscribed from."""
        self.unsubscribe(str(self.will_topic))

    def subscribe_to(self, topics: Sequence[str]) -> None:
        """Subscribe to topics. With MQTT 5, deliveries keep their retain flag."""
        options: Any = SubscribeOptions(qos=1, retainAsPublished=True) if self._is_newest else 1
        self.subscribe([(topic, options) for topic in topics])

    def _opened(self, sock: Any) -> None:
        """Close a socket that comes too late, in the thread: a login would end the session of a later connection."""
        if self._is_closed:
            sock.close()
            raise OSError("it was given up")
        with Socket(fileno=os.dup(sock.fileno())) as same:  # that of a WebSocket has no options
            same.setsockopt(IPPROTO_TCP, TCP_NODELAY, 1)

    def _more_to_write(self, sock: Any) -> None:
        if sock.fileno() >= 0:
            self._turns.add_writer(sock, self._do, self.loop_write)

    def _all_written(self, sock: Any) -> None:
        if sock.fileno() >= 0:
            self._turns.remove_writer(sock)

    def _unwatch(self, sock: Any) -> None:
        if sock.fileno() >= 0:
            self._turns.remove_reader(sock)
            self._turns.remove_writer(sock)

    def _tick(self) -> None:
        self._timer = self._turns.call_later(1.0, self._tick)
        self._do(self.loop_misc)

    def _do(self, step: Callable[[], object]) -> None:
        """Have the library read, write, or look at the time."""
        try:
            step()
        except BrokerError as error:
            self._failed(error)
        except OSError as error:
            self._failed(BrokerError(f"{UNTOLD}: {error}"))
        except Exception as error:  # noqa: BLE001 - the library raises anything for invalid packets
            self._failed(BrokerError(f"{INVALID}: {error!r}"))

    def _read(self) -> None:
        """Read what has come, and what is decrypted already, of which the event loop does not know.

        Raises:
            BrokerError: a packet is too large. The library has no limit, and MQTT 3.1.1 none to ask the broker for.
        """
        is_more = True
        while is_more:
            self.loop_read()
            if self._in_packet["remaining_length"] > LARGEST_PACKET:
                raise BrokerError(f"it has sent a message of more than {LARGEST_PACKET} bytes")
            is_more = getattr(self.socket(), "pending", lambda: 0)() > 0

    def _properties(self, kind: int, **values: object) -> Properties | None:
        """Return the properties of a packet, None if it has none; MQTT 3.1.1 has no such thing."""
        told = {name: value for name, value in values.items() if value is not None}
        if not (told and self._is_newest):
            return None
        properties = Properties(kind)  # type: ignore[no-untyped-call]
        for name, value in told.items():
            setattr(properties, name, value)
        return properties


def size(message: Message) -> int:
    """Return the most bytes that a message may have as a packet."""
    return _HEADS + len(message.topic.encode()) + len(message.payload) + len(message.correlation or b"")


def _named(context: ssl.SSLContext, name: str) -> Any:
    """Return of a context what the library uses; it checks the certificate against `name` instead of the host."""

    def wrap_socket(sock: Socket, *, server_hostname: str, **options: Any) -> ssl.SSLSocket:  # noqa: ARG001
        return context.wrap_socket(sock, server_hostname=name, **options)

    return SimpleNamespace(check_hostname=True, wrap_socket=wrap_socket)
