"""All errors of the gateway, as one tree.

GatewayError
├── RequestError                 a client gets an exception response with `code`
│   ├── Refused                  04  what is asked for is not done; one with another `code` says why
│   │   ├── IllegalFunction      01  the unit does not support the function
│   │   │   └── AccessDenied     01  the client has no right to it
│   │   ├── IllegalAddress       02  a coil or register that does not exist
│   │   ├── IllegalValue         03  a length, quantity, byte count or value that the specification forbids
│   │   ├── DeviceFailure        04  the unit failed during the request
│   │   │   └── LineShared       04  not sent: another client could come between the read and the write of a register
│   │   ├── NoRoute              0A  unit not configured
│   │   └── OnlyHeard            0A  others ask the unit, and the gateway only listens on its line
│   ├── Busy                     06  nothing was sent
│   │   ├── QueueFull            06  too many requests wait for the line
│   │   ├── WaitedTooLong        06  the request waited longer than `max_wait`
│   │   └── Unwanted             06  a write of a client that sends no more; any request of a client that has left
│   ├── LineDown                 0A  nothing was sent: the port or upstream of the unit is down
│   └── NoResponse               0B  the device may have acted
│       ├── ResponseTimeout      0B  nothing came within the limit
│       ├── BrokenResponse       0B  what came within the limit was not the response
│       ├── LineLost             0B  the port was lost during the request
│       ├── AnswerOverdue        0B  not sent: a late response to an earlier request could be taken for its response
│       ├── UnitResting          0B  not sent: the unit backs off after failures
│       ├── EchoSuspected        0B  not sent: the adapter echoes, so a copy of the request proves nothing
│       ├── AmbiguousResponse    0B  another client was received, so the response may be for it
│       └── StaleValue           0B  not sent: the values of a mirror or virtual unit are stale
├── NotModbus                    a client's bytes are not Modbus: its connection is closed
├── PortError                    a serial port cannot be opened or was lost
│   ├── PortClosed               it was closed by its user
│   └── ConnectionEnded          the server has closed it in order
├── ListenError                  a listener cannot use its address
├── TlsError                     a certificate, key or revocation list cannot be used
├── BrokerError                  the broker cannot be reached, or refuses
├── FleetError                   NATS cannot be reached, or refuses
├── StateError                   a file in the state directory cannot be read
├── ConfigError                  a config has `problems`, or the process that reads it failed
├── UsersError                   the file with the users of the web page cannot be used
├── WrongQuestion                an operation cannot be carried out; if no subclass says more, something is not there
│   ├── Malformed                a parameter is missing, or makes no sense
│   ├── NotPermitted             this client has no right to it
│   ├── ChangedMeanwhile         a reload has changed what is asked for
│   ├── DoesNotFit               a value cannot be written there, or not be read
│   ├── Unready                  the gateway cannot do it now
│   └── UnitFailed               the unit did not answer with what was asked for
│       └── ExceptionReceived    it answered with an exception, or the gateway did so for it
├── NotConfigured                the config has no such unit, or a unit has no such point
└── DaemonError                  the running gateway cannot be reached

A request in progress is not ended by raising: `Request.fail` turns a RequestError into the exception response.
"""

from enum import IntEnum
from typing import TYPE_CHECKING, ClassVar

if TYPE_CHECKING:
    from gateway.config.problem import Problem


class ExceptionCode(IntEnum):
    """Exception codes of a response (Application Protocol V1.1b3, section 7)."""

    ILLEGAL_FUNCTION = 0x01
    ILLEGAL_DATA_ADDRESS = 0x02
    ILLEGAL_DATA_VALUE = 0x03
    SERVER_DEVICE_FAILURE = 0x04
    ACKNOWLEDGE = 0x05
    SERVER_DEVICE_BUSY = 0x06
    MEMORY_PARITY_ERROR = 0x08
    GATEWAY_PATH_UNAVAILABLE = 0x0A
    GATEWAY_TARGET_FAILED_TO_RESPOND = 0x0B


class GatewayError(Exception):
    """Root of the project's own errors."""


class RequestError(GatewayError):
    """Why a request gets an exception response instead of data."""

    #: Of the exception response, 1-255.
    code: int
    #: The result of the request in status and metrics.
    result: ClassVar[str] = "refused"


class Refused(RequestError):
    """The unit, or the gateway in its place, does not do what is asked for; `code` says why."""

    code: int = ExceptionCode.SERVER_DEVICE_FAILURE

    def __init__(self, message: str = "", code: int | None = None) -> None:
        super().__init__(message)
        if code is not None:
            self.code = code


class IllegalFunction(Refused):
    """The unit does not support the function."""

    code = ExceptionCode.ILLEGAL_FUNCTION


class AccessDenied(IllegalFunction):
    """The client has no right to the function."""

    result = "denied"


class IllegalAddress(Refused):
    """The request names a coil or register that the unit does not have."""

    code = ExceptionCode.ILLEGAL_DATA_ADDRESS


class IllegalValue(Refused):
    """A length, quantity, byte count or value is outside the specification."""

    code = ExceptionCode.ILLEGAL_DATA_VALUE


class DeviceFailure(Refused):
    """The unit failed during the request."""

    code = ExceptionCode.SERVER_DEVICE_FAILURE


class LineShared(DeviceFailure):
    """Not sent, or not written: another client on the line could write between the read and the write of a register."""


class NoRoute(Refused):
    """The unit is not configured."""

    code = ExceptionCode.GATEWAY_PATH_UNAVAILABLE
    result = "no_route"


class OnlyHeard(Refused):
    """The unit is on a line where others ask, and the gateway only listens."""

    code = ExceptionCode.GATEWAY_PATH_UNAVAILABLE
    result = "only_heard"


class Busy(RequestError):
    """The request was not sent; the client may try again."""

    code = ExceptionCode.SERVER_DEVICE_BUSY


class QueueFull(Busy):
    """Too many requests wait for the line."""

    result = "queue_full"


class WaitedTooLong(Busy):
    """The request waited longer than the line's `max_wait`."""

    result = "expired"


class Unwanted(Busy):
    """Not sent: its client has left, or sends no more and may have left, so a write may not be wanted any more."""

    result = "unwanted"


class LineDown(RequestError):
    """The request was not sent: the port or upstream of the unit is down."""

    code = ExceptionCode.GATEWAY_PATH_UNAVAILABLE
    result = "line_down"


class NoResponse(RequestError):
    """No valid response came; the device may have acted, unless the message says that the request was not sent."""

    code = ExceptionCode.GATEWAY_TARGET_FAILED_TO_RESPOND


class ResponseTimeout(NoResponse):
    """Nothing was received within the time limit."""

    result = "timeout"


class BrokenResponse(NoResponse):
    """Something was received within the time limit, but no valid response to the request."""

    result = "bad_frame"


class LineLost(NoResponse):
    """The port was lost while the request was on the line."""

    result = "line_lost"


class AnswerOverdue(NoResponse):
    """Not sent: the response to an earlier request may still come, and could be taken for the response to this one."""

    result = "overdue"


class UnitResting(NoResponse):
    """Not sent: the unit has failed too often and backs off."""

    result = "resting"


class EchoSuspected(NoResponse):
    """Not sent: the adapter echoes, and a response that equals its request proves nothing."""

    result = "echo_suspected"


class AmbiguousResponse(NoResponse):
    """Another client was heard on the line, so the response may be for it."""

    result = "ambiguous"


class StaleValue(NoResponse):
    """Not sent: what was polled of `device` is stale, or is no value, and this is never returned."""

    result = "stale"

    def __init__(self, what: str, device: str = "") -> None:
        super().__init__(what)
        self.device = device


class NotModbus(GatewayError):
    """A client's bytes cannot be Modbus; nothing after them can be trusted."""


class PortError(GatewayError):
    """A serial port cannot be opened or was lost; the message says why, and what to do."""


class PortClosed(PortError):
    """A port was closed by its user."""

    def __init__(self) -> None:
        super().__init__("closed")


class ConnectionEnded(PortError):
    """A server has closed a connection in order; `at_once`: soon after it was opened, and nothing was received."""

    def __init__(self, message: str, *, at_once: bool = False) -> None:
        super().__init__(message)
        self.at_once = at_once


class ListenError(GatewayError):
    """A listener cannot use its address; the message says why, and what to do."""


class TlsError(GatewayError):
    """A certificate, a key or a revocation list cannot be used; the message names its file, and what to do."""


class BrokerError(GatewayError):
    """The broker cannot be reached, or refuses what the gateway wants of it."""


class FleetError(GatewayError):
    """NATS cannot be reached, or refuses what the gateway wants of it."""


class StateError(GatewayError):
    """The state directory is in use, or a file in it cannot be read; the message names it, and what to do."""


class ConfigError(GatewayError):
    """A config has `problems`, as `check` tells them; or it could not be read, whatever it says, and has none.

    The message names the file and says why.
    """

    def __init__(self, message: str, problems: "tuple[Problem, ...]" = ()) -> None:
        super().__init__(message)
        self.problems = problems


class UsersError(GatewayError):
    """The file with the users of the web page cannot be used; the message names it, and what to do."""


class WrongQuestion(GatewayError):
    """An operation cannot be carried out; the message says why. Where no subclass says more, something is not there."""


class Malformed(WrongQuestion):
    """A parameter is missing, or makes no sense."""


class NotPermitted(WrongQuestion):
    """The client has no right to it; `code` is the exception that its request would have got, if there is one."""

    def __init__(self, message: str, code: ExceptionCode | None = None) -> None:
        super().__init__(message)
        self.code = code


class ChangedMeanwhile(WrongQuestion):
    """A reload has changed what is asked for while it was carried out."""


class DoesNotFit(WrongQuestion):
    """A value cannot be written to its place, or not be read from it. `remedy` says what can be done, if anything."""

    def __init__(self, what: str, remedy: str = "") -> None:
        super().__init__(f"{what}; {remedy}" if remedy else what)
        self.what = what
        self.remedy = remedy


class Unready(WrongQuestion):
    """The gateway cannot do it now; it may be asked again later."""


class UnitFailed(WrongQuestion):
    """The unit did not answer with what was asked for."""


class ExceptionReceived(UnitFailed):
    """The unit answered with the exception `code`; or the gateway in its place, which has a `result` and a `reason`."""

    def __init__(self, message: str, code: int, result: str = "", reason: str = "") -> None:
        super().__init__(message)
        self.code = code
        self.result = result
        self.reason = reason


class NotConfigured(GatewayError):
    """The config has no unit with this number or name; or the unit has no such point."""


class DaemonError(GatewayError):
    """The running gateway cannot be reached through its control socket; the message says why, and what to do."""
