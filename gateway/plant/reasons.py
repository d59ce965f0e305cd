"""Turns the reasons of a broker into words."""

from typing import Final

from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode

from gateway.errors import BrokerError
from gateway.plant.messages import Message

_UNSUPPORTED_VERSION: Final = 0x84
_WRONG_LOGIN: Final = 0x86
_NO_RIGHT: Final = 0x87
#: Brokers give either reason for a refused login, whatever the cause.
_LOGIN_REFUSED: Final = "user or password is wrong, or this user may not connect"
SAME_NAME: Final = "another client uses the same name; two gateways must not have the same site"
#: The reason if the broker gives none: not every broker says that another client has the same name.
UNTOLD: Final = "the connection was lost"
INVALID: Final = "what it sends is not understood"
#: Refusals for no fault of the message: unspecified error, implementation specific error, quota exceeded.
_PASSING: Final = (0x80, 0x83, 0x97)
#: The reason codes of MQTT 5; those whose names say all there is to say are missing.
_REASONS: Final = {
    0x00: "it has ended the connection",
    0x80: "it gives no reason",
    0x81: "malformed packet: it does not understand this gateway",
    0x82: "protocol error: it does not understand this gateway",
    0x83: "it has a reason of its own, perhaps in its log",
    _UNSUPPORTED_VERSION: "it does not have this version of MQTT",
    0x85: "it refuses this client identifier",
    _NO_RIGHT: "it says that this user has no right",
    0x88: "it is not available",
    0x89: "it is busy",
    0x8A: "it has banned this client",
    0x8B: "it is shutting down",
    0x8C: "it wants another kind of login than user and password",
    0x8D: "keep alive timeout: it has heard nothing from this gateway for too long",
    0x8E: f"session taken over: {SAME_NAME}",
    0x93: "receive maximum exceeded: more messages are unconfirmed than it allows",
    0x95: "packet too large: a message is larger than it allows",
    0x96: "message rate too high: messages come faster than it allows",
    0x97: "quota exceeded: it has a limit for this client or user",
    0x98: "administrative action: somebody has ended the connection at the broker",
    0x9A: "it keeps no retained messages, but this gateway publishes some",
    0x9B: "it does not have QoS 1, which this gateway needs",
    0x9C: "it wants this gateway to use another server",
    0x9D: "it has moved to another server for good",
    0x9F: "connection rate exceeded: connections come faster than it allows",
    0xA0: "maximum connect time: it allows no longer connection",
}
#: Why the library ends a connection by itself.
_OWN: Final = {0x82: INVALID, 0x8D: "it does not answer a ping"}
#: The most characters of a text of the broker's own.
_LONGEST_TEXT: Final = 200


class WrongVersionError(BrokerError):
    """The broker does not support this version of MQTT, or closes the connection as if it did not."""


class SubscriptionRefusedError(BrokerError):
    """The broker does not let this user subscribe to a topic."""


def in_words(reason: ReasonCode, properties: Properties | None) -> str:
    """Put the reason of a broker into words, with what it adds in text or which other server it names."""
    words = _REASONS.get(reason.value, f"it says: {str(reason).lower()}")
    added = [str(getattr(properties, name, "")) for name in ("ReasonString", "ServerReference")]
    text = "; ".join("".join(filter(str.isprintable, each))[:_LONGEST_TEXT] for each in added if each)
    return f'{words} ("{text}")' if text else words


def lost(reason: ReasonCode) -> str:
    """Say why the library thinks that a connection was lost, if the broker has not said it."""
    return _OWN.get(reason.value, UNTOLD)


def refused_login(reason: ReasonCode, properties: Properties | None) -> BrokerError:
    """Make the error for a login that the broker has refused."""
    if reason.value == _UNSUPPORTED_VERSION:
        return WrongVersionError(_REASONS[_UNSUPPORTED_VERSION])
    return BrokerError(_LOGIN_REFUSED if reason.value in (_WRONG_LOGIN, _NO_RIGHT) else in_words(reason, properties))


def refused(reason: ReasonCode, properties: Properties | None, what: str, user: str | None) -> str:
    """Say why the broker refuses `what`, such as `publish to TOPIC`, to a `user`."""
    if reason.value == _NO_RIGHT:
        who = "a client without a user" if user is None else f'user "{user}"'
        return f"{who} may not {what}"
    return f"to {what} is refused: {in_words(reason, properties)}"


def is_passing(reason: ReasonCode, message: Message) -> bool:
    """Tell whether the same message may be accepted later.

    A right may be given later, too; but the values of a device would ask for it with each read.
    """
    return reason.value in _PASSING or (reason.value == _NO_RIGHT and not message.device)
