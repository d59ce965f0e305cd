"""What is published, what is received, and what each form of it must be able to do.

A form is a way to put values into messages: JSON (`plain`) or Sparkplug B. It has no clock and no connection. Times are
Unix times in seconds: they are what messages carry.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from gateway.profiles.published import PublishedDevice, PublishedPoint
from gateway.registers.datatypes import Value


@dataclass(frozen=True, slots=True)
class Message:
    """A message to publish. With MQTT 5 the broker drops it `expiry` seconds after it has got it, if nobody took it.

    `correlation` is sent back to who asked, with MQTT 5 only. `device` is the name of the device whose values or
    availability it tells.
    """

    topic: str
    payload: bytes
    retain: bool = False
    qos: int = 1
    expiry: float | None = None
    correlation: bytes | None = None
    device: str = ""


@dataclass(frozen=True, slots=True)
class Delivery:
    """A message received from the broker at `at`. The last two are known with MQTT 5 only.

    `is_retained`: the broker kept it from before the subscription. `is_duplicate`: it may have been delivered before.
    `expiry` is how many seconds of its life were left.
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
    """What a point had: its value, and when its device answered."""

    value: Value
    at: float


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
    """Somebody wants a point to have a value, given as text as `write DEVICE POINT VALUE` takes it.

    `refusal` is why it must not be carried out; empty when it may be. `delivery` is the message that it came with.
    """

    device: PublishedDevice
    point: PublishedPoint
    text: str
    delivery: Delivery
    refusal: str = ""


@dataclass(frozen=True, slots=True)
class Misdirected:
    """Somebody wants to write something that is no point, or must not be written: `refusal` says which."""

    text: str
    delivery: Delivery
    refusal: str


@dataclass(frozen=True, slots=True)
class Rebirth:
    """The birth is to be published (again)."""


@dataclass(frozen=True, slots=True)
class Leave:
    """The session is to be ended with `ended`, and the connection made anew."""


#: What a message that was received asks for.
Received = Command | Misdirected | Rebirth | Leave


class Form(Protocol):
    """How values, availability and results become messages, and received messages become commands.

    For each connection the calls are: `will`; the connection is made; `early_subscriptions`; as soon as `is_held` is
    False `born` and `command_subscriptions`, these first if `takes_commands_first`; then any of the others; `ended`, if
    there is time for it. A new birth at any time starts with `born` again. Between connections nothing is called.
    `received` may be called from the first subscription on.
    """

    #: Whether commands are subscribed to before the birth; otherwise right behind it.
    takes_commands_first: bool

    @property
    def is_held(self) -> bool:
        """Whether nothing may be published yet; `received` returns a Rebirth when that ends."""

    @property
    def leaves_with_will(self) -> bool:
        """Whether the broker is to publish the will at a proper end too, which it does with MQTT 5."""

    def will(self, at: float) -> Message:
        """What the broker publishes when the connection is lost. Starts a new session."""

    def early_subscriptions(self) -> Sequence[str]:
        """Topics (filters) to subscribe to even if the birth is held: nothing that comes from there is written."""

    def command_subscriptions(self) -> Sequence[str]:
        """Topics (filters) of what writes."""

    def born(self, states: Iterable[DeviceState], at: float) -> Iterable[Message]:
        """What to publish at first: all devices with their availability and last readings, each when it is taken."""

    def values(
        self, device: PublishedDevice, readings: Readings, changed: Collection[str], at: float
    ) -> Sequence[Message]:
        """New readings of a device: all that are known, and the names of points whose readings are to be published now.

        A point among these without a reading had one, which is too old by now.
        """

    def availability(self, state: DeviceState, at: float) -> Sequence[Message]:
        """A device begins to answer, with what it has read, or no longer does."""

    def received(self, delivery: Delivery) -> Sequence[Received]:
        """What a message from the broker asks for; often one thing, or nothing."""

    def result(self, command: Command | Misdirected, error: str | None, at: float) -> Sequence[Message]:
        """What became of a command: None if the device confirmed it, else why not."""

    def ended(self, at: float) -> Sequence[Message]:
        """What to publish right before the connection is closed."""
