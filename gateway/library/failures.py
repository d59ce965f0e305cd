"""The errors that a program gets for exceptions, in words that say which unit was asked for what, and why."""

from collections.abc import Callable, Mapping
from typing import Final

from gateway import errors
from gateway.errors import RequestError
from gateway.operator.values.complaint import Complaint

#: Makes an error that says this.
Make = Callable[[str], RequestError]

#: For what the gateway itself has refused, by the result of the request: the very error that it was refused with.
_BY_RESULT: Final[Mapping[str, Make]] = {
    each.result: each
    for each in (
        errors.AccessDenied,
        errors.NoRoute,
        errors.OnlyHeard,
        errors.QueueFull,
        errors.WaitedTooLong,
        errors.Unwanted,
        errors.LineDown,
        errors.ResponseTimeout,
        errors.BrokenResponse,
        errors.LineLost,
        errors.AnswerOverdue,
        errors.UnitResting,
        errors.EchoSuspected,
        errors.AmbiguousResponse,
        errors.StaleValue,
    )
}
#: For all others, and for what a device has sent.
_BY_CODE: Final[Mapping[int, Make]] = {
    each.code: each
    for each in (
        errors.IllegalFunction,
        errors.IllegalAddress,
        errors.IllegalValue,
        errors.DeviceFailure,
        errors.Busy,
        errors.LineDown,
        errors.NoResponse,
    )
}


def failure(unit: str, what: str, complaint: Complaint) -> RequestError:
    """Make the error for `what` was asked of a unit, as `silo-1, holding 0-9: exception 0B, ...: no response came`."""
    message = f"{unit}, {what}: {complaint}"
    make = _BY_RESULT.get(complaint.result) or _BY_CODE.get(complaint.code)
    return errors.Refused(message, complaint.code) if make is None else make(message)
