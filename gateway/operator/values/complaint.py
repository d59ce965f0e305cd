"""Exception responses in words."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from gateway.errors import ExceptionReceived, WrongQuestion
from gateway.trace.pdus import EXCEPTIONS

#: Why the gateway itself has answered with an exception, by the result of the request.
WHYS: Final[Mapping[str, str]] = {
    "timeout": "no response came within the limit",
    "bad_frame": "what came was damaged, or not the response to this request",
    "ambiguous": "the response may have been for another client on the line",
    "line_lost": "the port was lost while the request was under way",
    "resting": "not sent: the unit has not answered and rests",
    "overdue": "not sent: a late response to an earlier request may still come",
    "echo_suspected": "not sent: the response would look like an echo of the request",
    "stale": "not sent: the values are too old, or not valid",
    "queue_full": "not sent: too many requests wait for the line",
    "expired": "not sent: it has waited too long for the line",
    "line_down": "not sent: the line is down",
    "denied": "not sent: [[access]] does not allow it",
    "no_route": "not sent: there is no such unit",
    "only_heard": "not sent: the gateway only listens on its line",
}


@dataclass(frozen=True, slots=True)
class Complaint:
    """An exception response in words. `result` and `reason` are set if the gateway itself answered."""

    code: int
    result: str = ""
    reason: str = ""

    @property
    def name(self) -> str:
        """The name of the code in the specification."""
        return exception_name(self.code)

    @property
    def why(self) -> str:
        """The reason why the gateway itself answered with it. Rare ones have no translation."""
        return WHYS.get(self.result, self.reason)

    def __str__(self) -> str:
        why = self.reason or self.why
        return f"exception {self.code:02X}, {self.name}" + (f": {why}" if why else "")


def exception_name(code: int) -> str:
    """Return the name of an exception code in the specification."""
    return EXCEPTIONS.get(code, "not a standard one")


def complaint_of(wrong: WrongQuestion) -> Complaint | str:
    """Say why an operation was not carried out; an exception response becomes a Complaint, which can be translated."""
    if isinstance(wrong, ExceptionReceived):
        return Complaint(wrong.code, wrong.result, wrong.reason)
    return str(wrong)
