"""Everything that can go wrong, as one tree.

GatewayError
├── RequestError                 a client gets an exception response with `code`
│   ├── IllegalFunction          01  the unit does not know the function
│   │   └── AccessDenied         01  the client has no right to it
│   ├── IllegalDataAddress       02  a coil or register that does not exist
│   ├── IllegalDataValue         03  a length, quantity, byte count or value that the specification forbids
│   ├── ServerDeviceFailure      04  the unit failed while it acted
│   ├── Busy                     06  nothing was sent
│   │   ├── QueueFull            06  too many requests wait for the line
│   │   ├── WaitedTooLong        06  the request waited longer than `max_wait`
│   │   └── Unwanted             06  a write whose client sends no more; whatever a client asked that has left
│   ├── PathUnavailable          0A  nothing was sent
│   │   ├── NoRoute              0A  no such unit
│   │   └── LineDown             0A  the unit's line has no port
│   └── TargetFailedToRespond    0B  the device may have acted
│       ├── ResponseTimeout      0B  nothing came within the limit
│       ├── BrokenResponse       0B  what came within the limit was no response to the request
│       ├── LineLost             0B  the port died while the request was on the line
│       ├── AnswerOverdue        0B  not sent: the late answer to an earlier request could be taken for its answer
│       ├── UnitResting          0B  not sent: the unit has failed too often
│       ├── EchoSuspected        0B  not sent: the adapter echoes, so a copy of the request would prove nothing
│       ├── AmbiguousResponse    0B  another client was heard, so the response may be the answer to its request
│       └── StaleValue           0B  not sent: a mirror's values are too old
├── NotModbus                    a client's byte stream is no Modbus: its connection is closed
├── PortError                    a serial port cannot be opened or has been lost
│   └── PortClosed               it was closed by its user
├── ListenError                  no clients can be accepted at an address
├── StateError                   what was remembered over a restart cannot be read
└── DaemonError                  the running gateway cannot be asked

Requests under way are not ended by raising: `Request.fail` turns a RequestError into the exception response.
"""

from enum import IntEnum
from typing import ClassVar


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

    code: ClassVar[ExceptionCode]
    #: What became of the request, as status and metrics call it.
    result: ClassVar[str] = "refused"


class IllegalFunction(RequestError):
    """The unit does not know the function."""

    code = ExceptionCode.ILLEGAL_FUNCTION


class AccessDenied(IllegalFunction):
    """The client has no right to the function."""

    result = "denied"


class IllegalDataAddress(RequestError):
    """The request names a coil or register that the unit does not have."""

    code = ExceptionCode.ILLEGAL_DATA_ADDRESS


class IllegalDataValue(RequestError):
    """A length, quantity, byte count or value is outside the specification."""

    code = ExceptionCode.ILLEGAL_DATA_VALUE


class ServerDeviceFailure(RequestError):
    """The unit failed while it acted."""

    code = ExceptionCode.SERVER_DEVICE_FAILURE


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
    """Not sent: its client has left, or sends no more and may have left, so that nobody may be waiting for a write."""

    result = "unwanted"


class PathUnavailable(RequestError):
    """The request was not sent: there is no way to the unit."""

    code = ExceptionCode.GATEWAY_PATH_UNAVAILABLE


class NoRoute(PathUnavailable):
    """No such unit is configured."""

    result = "no_route"


class LineDown(PathUnavailable):
    """The unit's line has no port at the moment."""

    result = "line_down"


class TargetFailedToRespond(RequestError):
    """The request was sent and no valid response came; the device may have acted."""

    code = ExceptionCode.GATEWAY_TARGET_FAILED_TO_RESPOND


class ResponseTimeout(TargetFailedToRespond):
    """Nothing was heard within the limit."""

    result = "timeout"


class BrokenResponse(TargetFailedToRespond):
    """Something was heard within the limit, but no valid response to the request."""

    result = "bad_frame"


class LineLost(TargetFailedToRespond):
    """The port died while the request was on the line."""

    result = "line_lost"


class AnswerOverdue(TargetFailedToRespond):
    """Not sent: the answer to an earlier request may still come, and would be taken for the answer to this one."""

    result = "overdue"


class UnitResting(TargetFailedToRespond):
    """Not sent: the unit has failed too often and rests."""

    result = "resting"


class EchoSuspected(TargetFailedToRespond):
    """Not sent: the adapter returns what is sent, and an answer that is a copy of its request would prove nothing."""

    result = "echo_suspected"


class AmbiguousResponse(TargetFailedToRespond):
    """Another client was heard on the line, so the response may be the answer to its request."""

    result = "ambiguous"


class StaleValue(TargetFailedToRespond):
    """Not sent: the last poll of a mirror is too old, and an old value is never given out."""

    result = "stale"


class NotModbus(GatewayError):
    """A client's byte stream cannot be Modbus; nothing that follows in it can be trusted."""


class PortError(GatewayError):
    """A serial port cannot be opened or was lost; the message says why and what to do."""


class PortClosed(PortError):
    """A port was closed by its user."""

    def __init__(self) -> None:
        super().__init__("closed")


class ListenError(GatewayError):
    """An address cannot be listened on; the message says why and what to do."""


class StateError(GatewayError):
    """What was remembered over a restart cannot be read; the message names the file and what to do."""


class DaemonError(GatewayError):
    """The running gateway cannot be asked through its control socket; the message says why and what to do."""
