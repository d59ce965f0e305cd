"""What a client gets when nobody has answered its request."""

from typing import Final, Literal

from gateway.errors import ExceptionCode
from gateway.request import Request

#: The exception that says why there is no answer, or nothing, as a device that is off says nothing.
OnFailure = Literal["exception", "silent"]

#: What the gateway says when it has no answer: try again, no way to the unit, the unit has not answered.
_WITHOUT_ANSWER: Final = frozenset(
    {
        ExceptionCode.SERVER_DEVICE_BUSY,
        ExceptionCode.GATEWAY_PATH_UNAVAILABLE,
        ExceptionCode.GATEWAY_TARGET_FAILED_TO_RESPOND,
    }
)


def is_kept_back(request: Request, on_failure: OnFailure) -> bool:
    """Whether a client is not told that its request has failed.

    An exception of the unit itself is its answer, whatever the code.
    """
    return request.error is not None and on_failure == "silent" and request.error.code in _WITHOUT_ANSWER
