"""One connection to a broker, in the event loop."""

import asyncio
import ssl
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

from paho.mqtt.client import Client, ConnectFlags, DisconnectFlags, MQTTMessage
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode

from gateway.clock.threads import ThreadPerCall
from gateway.errors import BrokerError
from gateway.plant.client import LARGEST_PACKET, MOST_IN_FLIGHT, STEP_TIME, BrokerClient, BrokerSettings, Version
from gateway.plant.messages import Delivery, Message
from gateway.plant.reasons import (
    UNTOLD,
    SubscriptionRefusedError,
    WrongVersionError,
    in_words,
    is_passing,
    refused,
    refused_login,
)
from gateway.tls.reasons import explain


class BrokerConnection:
    """A connection with one `version` of MQTT. `deliver` takes each message received.

    `confirmed` is called for each message that the broker has answered: with the message, the reason if it was refused
    (else empty), and whether it may be accepted later. MQTT has no confirmation for QoS 0: the answer to a ping that
    was sent after the message takes its place.
    """

    def __init__(
        self,
        settings: BrokerSettings,
        version: Version,
        will: Message,
        *,
        deliver: Callable[[Delivery], None],
        confirmed: Callable[[Message, str, bool], None],
        unix: Callable[[], float],
    ) -> None:
        #: When the broker must have confirmed another message, by the clock of the event loop; None if none is due.
        self.deadline: float | None = None
        self.most_in_flight = MOST_IN_FLIGHT
        #: The largest packet that the broker accepts, in bytes, or a size that any broker should accept.
        self.largest = LARGEST_PACKET
        self._user = settings.user
        self._deliver = deliver
        self._confirmed = confirmed
        self._unix = unix
        self._loop = asyncio.get_running_loop()
        self._accepted: asyncio.Future[None] = self._loop.create_future()
        self._subscribed: dict[int, asyncio.Future[list[ReasonCode]]] = {}
        #: Done when the connection is lost, with the reason.
        self.lost: asyncio.Future[str] = self._loop.create_future()
        #: What was sent and is not confirmed, by number, in the order of sending.
        self._awaited: dict[int, Message] = {}
        #: The numbers of those with QoS 0: sent behind the last ping, and before it.
        self._unpinged: list[int] = []
        self._pinged: list[int] = []
        self._client = BrokerClient(settings, version, will)
        self._client.on_connect = self._on_connect
        self._client.on_disconnect = self._on_disconnect
        self._client.on_subscribe = self._on_subscribe
        self._client.on_publish = self._on_publish
        self._client.on_message = self._on_message
        self._timer: asyncio.TimerHandle | None = None
        self._is_abandoned = False

    @property
    def in_flight(self) -> int:
        """How many messages were sent and are not confirmed."""
        return len(self._awaited)

    @property
    def unconfirmed(self) -> Sequence[Message]:
        """The messages that were sent and are not confirmed, in the order of sending; also once it is lost."""
        return list(self._awaited.values())

    async def open(self) -> None:
        """Connect and log in.

        Raises:
            WrongVersionError: another version of MQTT may succeed.
            BrokerError: the broker cannot be reached, or refuses.
        """
        try:
            async with asyncio.timeout(2 * STEP_TIME):
                await self._loop.run_in_executor(ThreadPerCall("connect to broker"), self._log_in)
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
            SubscriptionRefusedError: the broker refuses.
            BrokerError: the connection is lost, or the broker does not answer.
        """
        if not topics:
            return
        error, number = self._client.subscribe([self._client.subscription(topic) for topic in topics])
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
                raise SubscriptionRefusedError(refused(reason, f"subscribe to {topic}", self._user))

    def publish(self, message: Message) -> None:
        """Send a message; `in_flight` counts it until it is confirmed, and must not exceed `most_in_flight`."""
        if not self.in_flight:
            self.deadline = self._loop.time() + STEP_TIME
        number = self._client.send(message)
        self._awaited[number] = message
        if not message.qos:
            self._unpinged.append(number)
            self._ping()

    def end(self, *, with_will: bool) -> None:
        """Log out; `with_will` has the broker publish the will, with MQTT 5 only."""
        self._client.log_out(with_will=with_will)

    def close(self) -> None:
        """Close the connection. Nothing is delivered any more."""
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

    def _log_in(self) -> None:
        """Log in, in a thread that may outlast the connection: then the socket is closed here."""
        self._client.log_in()
        if self._is_abandoned:
            sock = self._client.socket()
            if sock is not None:
                sock.close()

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
        except Exception as error:  # noqa: BLE001 - the library raises anything for invalid packets
            self._fail(f"what it sends is not understood: {error!r}")

    def _read(self) -> None:
        self._client.loop_read()
        if self._client.size_of_packet > LARGEST_PACKET:
            raise BrokerError(f"it has sent a message of more than {LARGEST_PACKET} bytes")
        self._ping()

    def _writable(self) -> None:
        try:
            self._client.loop_write()
        except OSError as error:
            self._fail(str(error))

    def _ping(self) -> None:
        """Ping after messages with QoS 0, one ping at a time; count them as confirmed when it was answered."""
        if self._client.awaits_pong:
            return
        answered, self._pinged, self._unpinged = self._pinged, self._unpinged, []
        if self._pinged:
            self._client.ping()
        for number in answered:
            self._confirm(number)

    def _confirm(self, number: int, refusal: str = "", *, is_passing: bool = False) -> None:
        message = self._awaited.pop(number)
        self.deadline = self._loop.time() + STEP_TIME if self.in_flight else None
        self._confirmed(message, refusal, is_passing)

    def _tick(self) -> None:
        self._timer = self._loop.call_later(1.0, self._tick)
        try:
            self._client.loop_misc()
        except Exception as error:  # noqa: BLE001 - the library raises anything when a ping cannot be written
            self._fail(f"the connection was lost: {error!r}")

    def _fail(self, reason: str) -> None:
        if not self._accepted.done():
            self._accepted.set_exception(BrokerError(reason))
        for waiting in self._subscribed.values():
            if not waiting.done():
                waiting.set_exception(BrokerError(reason))
        if not self.lost.done():
            self.lost.set_result(reason)

    # --- what the library calls ---

    def _on_more_to_write(self, _client: Client, _data: Any, sock: Any) -> None:
        self._loop.add_writer(sock, self._writable)

    def _on_all_written(self, _client: Client, _data: Any, sock: Any) -> None:
        self._loop.remove_writer(sock)

    def _on_socket_close(self, _client: Client, _data: Any, sock: Any) -> None:
        self._unwatch(sock)

    def _on_connect(
        self, _client: Client, _data: Any, _flags: ConnectFlags, reason: ReasonCode, properties: Properties | None
    ) -> None:
        if self._accepted.done():
            return
        if reason.is_failure:
            self._accepted.set_exception(refused_login(reason))
        else:
            self.most_in_flight = min(MOST_IN_FLIGHT, getattr(properties, "ReceiveMaximum", MOST_IN_FLIGHT))
            self.largest = getattr(properties, "MaximumPacketSize", LARGEST_PACKET)
            self._accepted.set_result(None)

    def _on_disconnect(
        self, _client: Client, _data: Any, flags: DisconnectFlags, reason: ReasonCode, _properties: Properties | None
    ) -> None:
        if not self._accepted.done():  # some brokers close the connection instead of answering
            self._accepted.set_exception(WrongVersionError("it has closed the connection without an answer"))
        is_told = flags.is_disconnect_packet_from_server
        self._fail(in_words(reason) if is_told else UNTOLD)

    def _on_subscribe(
        self, _client: Client, _data: Any, number: int, reasons: list[ReasonCode], _properties: Properties | None
    ) -> None:
        confirmed = self._subscribed.pop(number, None)
        if confirmed is not None and not confirmed.done():
            confirmed.set_result(reasons)

    def _on_publish(
        self, _client: Client, _data: Any, number: int, reason: ReasonCode, _properties: Properties | None
    ) -> None:
        message = self._awaited.get(number)
        if message is not None and message.qos:  # with QoS 0 it only says that the message is written
            refusal = refused(reason, f"publish to {message.topic}", self._user) if reason.is_failure else ""
            self._confirm(number, refusal, is_passing=is_passing(reason))

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
