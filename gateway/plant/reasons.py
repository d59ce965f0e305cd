"""Why a broker refuses something, in words."""

from typing import Final

from paho.mqtt.reasoncodes import ReasonCode

from gateway.errors import BrokerError

_UNSUPPORTED_VERSION: Final = 0x84
_WRONG_LOGIN: Final = 0x86
_NO_RIGHT: Final = 0x87
#: Brokers say the one or the other when a client logs in, whatever the cause.
_LOGIN_REFUSED: Final = "user or password is wrong, or this user may not connect"
SAME_NAME: Final = "another client uses the same name; two gateways must not have the same site"
#: When the broker does not say why: not all say that another client has the name.
UNTOLD: Final = "the connection was lost"
#: Refusals that say nothing of the message: unspecified error, implementation specific error, quota exceeded.
_PASSING: Final = (0x80, 0x83, 0x97)
_REASONS: Final = {
    _UNSUPPORTED_VERSION: "it does not have this version of MQTT",
    0x85: "it refuses this client identifier",
    _NO_RIGHT: "it says that this user has no right",
    0x88: "it is not available",
    0x8E: f"session taken over: {SAME_NAME}",
}


class WrongVersionError(BrokerError):
    """The broker does not have this version of MQTT, or closes the connection as if it had not."""


class SubscriptionRefusedError(BrokerError):
    """The broker does not let this user subscribe to a topic."""


def in_words(reason: ReasonCode) -> str:
    """What a broker says."""
    return _REASONS.get(reason.value) or f"it says: {reason}"


def refused_login(reason: ReasonCode) -> BrokerError:
    """Why it does not accept a connection."""
    if reason.value == _UNSUPPORTED_VERSION:
        return WrongVersionError(_REASONS[_UNSUPPORTED_VERSION])
    return BrokerError(_LOGIN_REFUSED if reason.value in (_WRONG_LOGIN, _NO_RIGHT) else in_words(reason))


def refused(reason: ReasonCode, what: str, user: str | None) -> str:
    """Why `user` may not do something: publish to a topic."""
    if reason.value == _NO_RIGHT:
        who = "a client without a user" if user is None else f'user "{user}"'
        return f"{who} may not {what}"
    return f"to {what} is refused: {in_words(reason)}"


def is_passing(reason: ReasonCode) -> bool:
    """Whether the same message may be taken later."""
    return reason.value in _PASSING
