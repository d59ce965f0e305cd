"""Messages to and from a broker, and the protocol of a form.

A form is a way to put values into messages: JSON (`plain`) or Sparkplug B. It has no clock and no connection. Times are
Unix times in seconds, as in messages.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from gateway.profiles.published import PublishedDevice, PublishedPoint
from gateway.registers.datatypes import Value


@dataclass(frozen=True, slots=True)
class Message:
    """A message to publish. `expiry` and `correlation` have an effect with MQTT 5 only.

    The broker drops the message if it cannot deliver it within `expiry` seconds. `correlation` is the one of the
    command that it answers. `device` is the name of the device whose values or availability it tells; `told` has those
    of its readings that nobody has told before. `birth` is the number of the birth that it is part of, 0 if of none.
    """

    topic: str
    payload: bytes
    retain: bool = False
    qos: int = 1
    expiry: float | None = None
    correlation: bytes | None = None
    device: str = ""
    told: "Readings" = field(default_factory=dict)
    birth: int = 0


@dataclass(frozen=True, slots=True)
class Delivery:
    """A message received from the broker at `at`. The last two are known with MQTT 5 only.

    `is_retained`: the broker kept it from before the subscription. `is_duplicate`: it may have been delivered before.
    `expiry` is the number of seconds until it expires.
    """

    topic: str
    payload: bytes
    at: float
    is_retained: bool = False
    is_duplicate: bool = False
    expiry: float | None = None
    correlation: bytes | None = None


@dataclass(frozen=True, slots=True)
class Reading:
    """The value of a point, None if the device has none there, and when its device answered.

    `read_at` is the same time by the clock of the event loop, which nobody sets.
    """

    value: Value | None
    at: float
    read_at: float = 0.0


@dataclass(frozen=True, slots=True)
class Record:
    """The values of points of a device that were read at one time; `is_unsure` if that time may be wrong."""

    at: float
    values: Mapping[str, Value | None]
    is_unsure: bool = False


#: The last readings of a device by the names of its points. Points that were not read, or not lately, are absent.
Readings = Mapping[str, Reading]


@dataclass(frozen=True, slots=True)
class DeviceState:
    """A device at its birth: whether it answers, and its last readings (none unless it does)."""

    device: PublishedDevice
    is_available: bool
    readings: Readings = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Command:
    """A request to write a value to a point, as text as `write DEVICE POINT VALUE` takes it.

    `refusal` is why it must not be carried out; empty if it may be. `delivery` is the message that it came with.
    """

    device: PublishedDevice
    point: PublishedPoint
    text: str
    delivery: Delivery
    refusal: str = ""


@dataclass(frozen=True, slots=True)
class Misdirected:
    """A request to write something that is not a point, or must not be written: `refusal` says which."""

    text: str
    delivery: Delivery
    refusal: str


@dataclass(frozen=True, slots=True)
class Rebirth:
    """A request to publish the birth (again)."""


@dataclass(frozen=True, slots=True)
class Leave:
    """A request to end the session with `ended`, and to make a new connection."""


#: The requests that a received message may contain.
Received = Command | Misdirected | Rebirth | Leave


class Form(Protocol):
    """Turns values, availability and results into messages, and received messages into commands.

    For each connection the calls are: `will`; the connection is made; `early_subscriptions`; as soon as `is_held` is
    False `born` and `command_subscriptions`, the latter first if `takes_commands_first`; then any of the others;
    `ended`, if there is time for it. A new birth at any time starts with `born` again. Between connections nothing is
    called. `received` may be called from the first subscription on.
    """

    #: Whether commands are subscribed to before the birth; otherwise right after it.
    takes_commands_first: bool

    @property
    def is_held(self) -> bool:
        """Whether nothing may be published yet; `received` returns a Rebirth when that ends."""

    @property
    def leaves_with_will(self) -> bool:
        """Whether the broker is to publish the will at a proper end too, which is possible with MQTT 5."""

    def will(self, at: float) -> Message:
        """Return the message that the broker publishes when the connection is lost. Starts a new session."""

    def early_subscriptions(self) -> Sequence[str]:
        """Return topics (filters) to subscribe to even if the birth is held. Their messages write nothing."""

    def command_subscriptions(self) -> Sequence[str]:
        """Return topics (filters) whose messages may write."""

    def born(self, states: Iterable[DeviceState], at: float) -> Iterable[Message]:
        """Return what to publish first: all devices with availability and last readings, each made when it is taken."""

    def values(
        self, device: PublishedDevice, readings: Readings, changed: Collection[str], at: float
    ) -> Sequence[Message]:
        """Return the messages with new readings of a device, whose known readings are all in `readings`.

        `changed` names the points to publish now. A point among these without a reading had one that is too old by now.
        """

    def availability(self, state: DeviceState, at: float) -> Sequence[Message]:
        """Return the messages when a device begins to answer, with its readings, or no longer does."""

    def may_tell(self, device: str) -> bool:
        """Tell whether earlier readings of a device may be published now."""

    def history(self, device: str, records: Sequence[Record], at: float) -> Message | None:
        """Return the message with earlier readings of a device, the oldest first; None if they mean nothing here."""

    def received(self, delivery: Delivery) -> Sequence[Received]:
        """Return what a message from the broker asks for; often one thing, or nothing."""

    def result(self, command: Command | Misdirected, error: str | None, at: float) -> Sequence[Message]:
        """Return the messages with the result of a command: no `error` if the device confirmed it, else why not."""

    def ended(self, at: float) -> Sequence[Message]:
        """Return what to publish right before the connection is closed."""
