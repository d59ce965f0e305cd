"""One connection to a broker, in the event loop."""

import asyncio
import ssl
from collections.abc import Callable, Sequence
from typing import Final

from paho.mqtt.client import MQTTMessage
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode

from gateway.clock.threads import in_thread
from gateway.errors import BrokerError
from gateway.plant.client import LARGEST_PACKET, MOST_IN_FLIGHT, STEP_TIME, BrokerClient, BrokerSettings, Version, size
from gateway.plant.messages import Delivery, Message
from gateway.plant.reasons import (
    SubscriptionRefusedError,
    WrongVersionError,
    in_words,
    is_passing,
    lost,
    refused,
    refused_login,
)
from gateway.tls.reasons import explain

#: How long a broker may take to confirm a message while it confirms others, in seconds.
LONGEST: Final = 60.0


class BrokerConnection:
    """A connection with one `version` of MQTT. `deliver` takes each message received.

    `confirmed` is called for each message that the broker has answered: with the message, the reason if it was refused
    (else empty), and whether it may be accepted later. MQTT has no confirmation for QoS 0: the answer to a
    question that was sent after the message takes its place.
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
        #: How long it may take for that.
        self.patience = STEP_TIME
        self.most_in_flight = MOST_IN_FLIGHT
        #: The largest packet that the broker accepts, in bytes, or a size that any broker should accept.
        self.largest = LARGEST_PACKET
        self._limit: int | None = None
        #: Done when the connection is lost, with the reason.
        self.lost: asyncio.Future[str] = asyncio.get_running_loop().create_future()
        self._user = settings.user
        self._deliver = deliver
        self._confirmed = confirmed
        self._unix = unix
        self._loop = asyncio.get_running_loop()
        #: The answer to the login, then to each subscription.
        self._answer: asyncio.Future[tuple[Sequence[ReasonCode], Properties | None]] = self._loop.create_future()
        #: What was sent and is not confirmed, and when, by number, in the order of sending.
        self._awaited: dict[int, tuple[Message, float]] = {}
        #: Since when the broker has had something to confirm, and has confirmed nothing.
        self._waiting_since = 0.0
        #: The numbers of those with QoS 0: sent before the present question, and behind it.
        self._asked: list[int] = []
        self._unasked: list[int] = []
        self._client = BrokerClient(settings, version, will, self._fail)
        self._is_answered = False

    @property
    def in_flight(self) -> int:
        """How many messages were sent and are not confirmed."""
        return len(self._awaited)

    async def open(self) -> None:
        """Connect and log in.

        Raises:
            WrongVersionError: another version of MQTT may succeed.
            BrokerError: the broker cannot be reached, or refuses.
        """
        try:
            async with asyncio.timeout(2 * STEP_TIME):
                await in_thread("connect to broker", self._client.log_in)
                self._listen()
                (reason,), properties = await self._answer
        except TimeoutError:
            raise BrokerError(f"it does not answer within {2 * STEP_TIME:g} s") from None
        except ssl.SSLError as error:
            raise BrokerError(explain(error)) from error
        except ssl.CertificateError as error:
            raise BrokerError(f"its certificate is refused: {error}") from error
        except (OSError, ValueError) as error:
            raise BrokerError(str(getattr(error, "strerror", None) or error)) from error
        if reason.is_failure:
            raise refused_login(reason, properties)

    async def subscribe(self, topics: Sequence[str]) -> None:
        """Subscribe, and wait for the confirmation.

        Raises:
            SubscriptionRefusedError: the broker refuses.
            BrokerError: the connection is lost, or the broker does not answer.
        """
        if not topics:
            return
        if self.lost.done():
            raise BrokerError(self.lost.result())
        self._answer = self._loop.create_future()
        self._client.subscribe_to(topics)
        try:
            async with asyncio.timeout(STEP_TIME):
                reasons, properties = await self._answer
        except TimeoutError:
            raise BrokerError("it does not confirm a subscription") from None
        for topic, reason in zip(topics, reasons, strict=False):
            if reason.is_failure:
                raise SubscriptionRefusedError(refused(reason, properties, f"subscribe to {topic}", self._user))

    def publish(self, message: Message) -> None:
        """Send a message; `in_flight` counts it until it is confirmed, and must not exceed `most_in_flight`.

        One that is too large is refused here: the broker would end the connection.
        """
        if self._limit is not None and size(message) > self._limit:
            self._refuse(message, self._limit)
            return
        now = self._loop.time()
        if not self._awaited:
            self._waiting_since = now
        number = self._client.send(message)
        self._awaited[number] = message, now
        self._set_deadline()
        if not message.qos:
            self._unasked.append(number)
            self._ask()

    def end(self, *, with_will: bool) -> None:
        """Log out; `with_will` has the broker publish the will, with MQTT 5 only."""
        self._client.log_out(with_will=with_will)

    def close(self) -> None:
        """Close the connection. Nothing is delivered any more."""
        self._client.close()

    def _listen(self) -> None:
        client = self._client
        client.on_connect = lambda _client, _data, _flags, reason, properties: self._on_connect(reason, properties)
        client.on_disconnect = lambda _client, _data, flags, reason, properties: self._on_disconnect(
            reason, properties, is_told=flags.is_disconnect_packet_from_server
        )
        client.on_subscribe = lambda _client, _data, _number, *reasons: self._answer.set_result(reasons)
        client.on_unsubscribe = lambda *_: self._on_unsubscribe()
        client.on_publish = lambda _client, _data, *answer: self._on_publish(*answer)
        client.on_message = lambda _client, _data, message: self._on_message(message)
        client.watch()

    def _fail(self, error: BrokerError) -> None:
        self._client.close()
        if not self._answer.done():
            self._answer.set_exception(error)
        if not self.lost.done():
            self.lost.set_result(str(error))

    def _refuse(self, message: Message, limit: int) -> None:
        refusal = f"{message.topic} has {size(message)} bytes, but the broker accepts no more than {limit}"
        if message.qos:
            self._confirmed(message, refusal, False)
        else:  # of Sparkplug, whose messages have numbers: if one is missing, hosts ask for all anew, again and again
            self._fail(BrokerError(refusal))

    def _ask(self) -> None:
        """Ask the broker, if no answer is awaited, whether it has come to the messages with QoS 0."""
        if self._unasked and not self._asked:
            self._asked, self._unasked = self._unasked, []
            self._client.ask()

    def _confirm(self, number: int, refusal: str = "", *, is_passing: bool = False) -> None:
        message, _ = self._awaited.pop(number)
        self._waiting_since = self._loop.time()
        self._set_deadline()
        self._confirmed(message, refusal, is_passing)

    def _set_deadline(self) -> None:
        """Give the broker a short time to confirm anything, and a longer one for each: history waits for its own."""
        self.deadline = None
        if self._awaited:
            _, first = next(iter(self._awaited.values()))
            all_of_them = (self._waiting_since + STEP_TIME, STEP_TIME)
            self.deadline, self.patience = min(all_of_them, (first + LONGEST, LONGEST))

    # --- what the library calls ---

    def _on_connect(self, reason: ReasonCode, properties: Properties | None) -> None:
        self._is_answered = True
        self.most_in_flight = min(MOST_IN_FLIGHT, getattr(properties, "ReceiveMaximum", MOST_IN_FLIGHT))
        self._limit = getattr(properties, "MaximumPacketSize", None)
        self.largest = self._limit or LARGEST_PACKET
        self._answer.set_result(([reason], properties))

    def _on_disconnect(self, reason: ReasonCode, properties: Properties | None, *, is_told: bool) -> None:
        if is_told:
            self._fail(BrokerError(in_words(reason, properties)))
        elif self._is_answered:
            self._fail(BrokerError(lost(reason)))
        else:
            self._fail(WrongVersionError("it has closed the connection without an answer"))

    def _on_unsubscribe(self) -> None:
        asked, self._asked = self._asked, []
        for number in asked:
            self._confirm(number)
        self._ask()

    def _on_publish(self, number: int, reason: ReasonCode, properties: Properties | None) -> None:
        message, _ = self._awaited.get(number, (None, 0.0))
        if message is not None and message.qos:  # with QoS 0 it only says that the message is written
            what = f"publish to {message.topic}"
            refusal = refused(reason, properties, what, self._user) if reason.is_failure else ""
            self._confirm(number, refusal, is_passing=is_passing(reason, message))

    def _on_message(self, message: MQTTMessage) -> None:
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
