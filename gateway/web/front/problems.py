"""Errors as problem details (RFC 9457), those of Modbus with their exception code."""

import json
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from http import HTTPStatus
from typing import Any, Final

from aiohttp import web
from aiohttp.typedefs import Middleware

from gateway.errors import ExceptionCode, WrongQuestion
from gateway.web.api.answers import Answer, Answers

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]

#: Why the gateway itself has answered with an exception, by the result of the request.
_WHYS: Final[Mapping[str, str]] = {
    "timeout": "no response came within the limit",
    "bad_frame": "what came was damaged, or not the response to this request",
    "ambiguous": "the response may have been for another client on the line",
    "line_lost": "the port was lost while the request was under way",
    "resting": "not sent: the unit has not answered and rests",
    "overdue": "not sent: a late response to an earlier request may still come",
    "echo_suspected": "not sent: the response would look like an echo of the request",
    "stale": "the values of the mirror are too old",
    "queue_full": "not sent: too many requests wait for the line",
    "expired": "not sent: it has waited too long for the line",
    "line_down": "not sent: the line is down",
    "denied": "not sent: [[access]] does not allow it",
    "no_route": "not sent: there is no such unit",
}
#: The status for each exception; 502 for all others.
STATUSES: Final[Mapping[int, int]] = {
    ExceptionCode.ILLEGAL_FUNCTION: 403,
    ExceptionCode.ILLEGAL_DATA_ADDRESS: 422,
    ExceptionCode.ILLEGAL_DATA_VALUE: 422,
    ExceptionCode.SERVER_DEVICE_BUSY: 503,
    ExceptionCode.GATEWAY_PATH_UNAVAILABLE: 502,
    ExceptionCode.GATEWAY_TARGET_FAILED_TO_RESPOND: 504,
}
#: Where nothing can be written, though it can be read.
_READ_ONLY: Final = "/api/v1/images/"
_KEPT_HEADERS: Final = ("Allow", "WWW-Authenticate", "Retry-After")


@dataclass(frozen=True, slots=True)
class Complaint:
    """A response with an exception, in words. `result` and `reason` are those of the gateway's own ones."""

    code: int
    result: str = ""
    reason: str = ""

    @property
    def name(self) -> str:
        """What the code means."""
        return exception_name(self.code)

    @property
    def why(self) -> str:
        """Why the gateway itself has answered with it. It has a translation unless it is a rare reason."""
        return _WHYS.get(self.result, self.reason)

    def __str__(self) -> str:
        why = self.reason or self.why
        return f"exception {self.code:02X}, {self.name}" + (f": {why}" if why else "")


class ProblemError(Exception):
    """Ends a request with a problem; `more` are members beside those of the RFC."""

    complaint: Complaint | None = None

    def __init__(self, status: int, detail: str, headers: Mapping[str, str] | None = None, **more: Any) -> None:
        super().__init__(detail)
        self.status = status
        self.detail = detail
        self.headers = headers or {}
        self.more = more


def exception_problem(answer: Answer) -> ProblemError:
    """The problem that a response with an exception stands for."""
    code = answer.pdu[1]
    said = complaint(answer)
    problem = ProblemError(STATUSES.get(code, 502), str(said), exception=code)
    problem.complaint = said
    if answer.result:
        problem.more["result"] = answer.result
    return problem


def complaint(answer: Answer) -> Complaint:
    """What an exception means."""
    return Complaint(answer.pdu[1], answer.result, answer.reason)


def exception_name(code: int) -> str:
    """What the specification calls an exception code."""
    known = code in {each.value for each in ExceptionCode}
    return ExceptionCode(code).name.lower().replace("_", " ") if known else "not a standard one"


def problems(answers: Answers) -> Middleware:
    """Middleware that makes problems of all errors: the error boundary of a request."""

    @web.middleware
    async def as_problems(request: web.Request, handler: Handler) -> web.StreamResponse:
        try:
            return await handler(request)
        except ProblemError as problem:
            return _response(problem)
        except WrongQuestion as wrong:
            return _response(ProblemError(404, str(wrong)))
        except web.HTTPRedirection:
            raise
        except web.HTTPError as error:
            phrase = HTTPStatus(error.status).phrase
            detail = error.text if error.text and not error.text.startswith(str(error.status)) else phrase
            if error.status == HTTPStatus.METHOD_NOT_ALLOWED and request.path.startswith(_READ_ONLY):
                detail = f"{_READ_ONLY} is only read; values are written under /api/v1/units/"
            headers = {name: error.headers[name] for name in _KEPT_HEADERS if name in error.headers}
            return _response(ProblemError(error.status, detail, headers))
        except Exception as error:  # noqa: BLE001 - the error boundary of a request
            answers.failed(error)
            return _response(ProblemError(500, "a defect in the gateway; its log says more"))

    return as_problems


def _response(problem: ProblemError) -> web.Response:
    title = HTTPStatus(problem.status).phrase
    body = {"type": "about:blank", "title": title, "status": problem.status, "detail": problem.detail, **problem.more}
    return web.Response(
        text=json.dumps(body),
        status=problem.status,
        headers=dict(problem.headers),
        content_type="application/problem+json",
    )
