"""What a client gets when its request got no response from a unit."""

from typing import Final, Literal

from gateway.errors import ExceptionCode
from gateway.request import Request

#: The exception that says why there is no response; or nothing, as from a device that is switched off.
OnFailure = Literal["exception", "silent"]

#: The gateway's own exceptions: busy, no path to the unit, no response from the unit.
_WITHOUT_ANSWER: Final = frozenset(
    {
        ExceptionCode.SERVER_DEVICE_BUSY,
        ExceptionCode.GATEWAY_PATH_UNAVAILABLE,
        ExceptionCode.GATEWAY_TARGET_FAILED_TO_RESPOND,
    }
)


def is_kept_back(request: Request, on_failure: OnFailure) -> bool:
    """Whether the failure of a request is not reported to the client.

    An exception of the unit itself is a response, whatever its code.
    """
    return request.error is not None and on_failure == "silent" and request.error.code in _WITHOUT_ANSWER
