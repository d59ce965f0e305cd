"""Turns the reasons of a broker into words."""

from typing import Final

from paho.mqtt.reasoncodes import ReasonCode

from gateway.errors import BrokerError

_UNSUPPORTED_VERSION: Final = 0x84
_WRONG_LOGIN: Final = 0x86
_NO_RIGHT: Final = 0x87
#: Brokers give either reason for a refused login, whatever the cause.
_LOGIN_REFUSED: Final = "user or password is wrong, or this user may not connect"
SAME_NAME: Final = "another client uses the same name; two gateways must not have the same site"
#: The reason if the broker gives none: not every broker says that another client has the same name.
UNTOLD: Final = "the connection was lost"
#: Refusals for no fault of the message: unspecified error, implementation specific error, quota exceeded.
_PASSING: Final = (0x80, 0x83, 0x97)
_REASONS: Final = {
    _UNSUPPORTED_VERSION: "it does not have this version of MQTT",
    0x85: "it refuses this client identifier",
    _NO_RIGHT: "it says that this user has no right",
    0x88: "it is not available",
    0x8E: f"session taken over: {SAME_NAME}",
}


class WrongVersionError(BrokerError):
    """The broker does not support this version of MQTT, or closes the connection as if it did not."""


class SubscriptionRefusedError(BrokerError):
    """The broker does not let this user subscribe to a topic."""


def in_words(reason: ReasonCode) -> str:
    """Put the reason of a broker into words."""
    return _REASONS.get(reason.value) or f"it says: {reason}"


def refused_login(reason: ReasonCode) -> BrokerError:
    """Make the error for a login that the broker has refused."""
    if reason.value == _UNSUPPORTED_VERSION:
        return WrongVersionError(_REASONS[_UNSUPPORTED_VERSION])
    return BrokerError(_LOGIN_REFUSED if reason.value in (_WRONG_LOGIN, _NO_RIGHT) else in_words(reason))


def refused(reason: ReasonCode, what: str, user: str | None) -> str:
    """Say why the broker refuses `what`, such as `publish to TOPIC`, to a `user`."""
    if reason.value == _NO_RIGHT:
        who = "a client without a user" if user is None else f'user "{user}"'
        return f"{who} may not {what}"
    return f"to {what} is refused: {in_words(reason)}"


def is_passing(reason: ReasonCode) -> bool:
    """Tell whether the same message may be accepted later."""
    return reason.value in _PASSING
