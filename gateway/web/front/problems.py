"""Errors as problem details (RFC 9457), those of Modbus with their exception code."""

import json
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass, field
from http import HTTPStatus
from typing import Any, Final

from aiohttp import web
from aiohttp.typedefs import Middleware

from gateway.errors import (
    ChangedMeanwhile,
    DoesNotFit,
    ExceptionCode,
    ExceptionReceived,
    Malformed,
    NotPermitted,
    UnitFailed,
    Unready,
    WrongQuestion,
)
from gateway.events import Emit, PartFailed
from gateway.operator.operations.answers.values import IF_KNOWN
from gateway.operator.operations.parameters import fields_of

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]

#: The status for each kind of refusal.
STATUSES: Final[Mapping[type[Any], int]] = {
    Malformed: 400,
    NotPermitted: 403,
    WrongQuestion: 404,
    ChangedMeanwhile: 409,
    DoesNotFit: 422,
    UnitFailed: 502,
    Unready: 503,
}
#: The status for each exception; that of UnitFailed for all others.
OF_EXCEPTIONS: Final[Mapping[int, int]] = {
    ExceptionCode.ILLEGAL_FUNCTION: 403,
    ExceptionCode.ILLEGAL_DATA_ADDRESS: 422,
    ExceptionCode.ILLEGAL_DATA_VALUE: 422,
    ExceptionCode.SERVER_DEVICE_BUSY: 503,
    ExceptionCode.GATEWAY_PATH_UNAVAILABLE: 502,
    ExceptionCode.GATEWAY_TARGET_FAILED_TO_RESPOND: 504,
}
#: Values below this path can only be read.
_READ_ONLY: Final = "/api/v1/images/"
_KEPT_HEADERS: Final = ("Allow", "WWW-Authenticate", "Retry-After")


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """An error (RFC 9457). `exception` is the code of a Modbus exception response.

    If the gateway itself answered with it, `result` is why. `problems` are those of a file that was rejected.
    """

    type: str = "about:blank"
    title: str
    status: int
    detail: str
    exception: int | None = field(default=None, metadata=IF_KNOWN)
    result: str | None = field(default=None, metadata=IF_KNOWN)
    problems: Sequence[str] | None = field(default=None, metadata=IF_KNOWN)


class ProblemError(Exception):
    """Ends a request with a problem; `more` are members beside those of the RFC."""

    def __init__(self, status: int, detail: str, headers: Mapping[str, str] | None = None, **more: Any) -> None:
        super().__init__(detail)
        self.status = status
        self.detail = detail
        self.headers = headers or {}
        self.more = more


def problem_of(wrong: WrongQuestion) -> ProblemError:
    """Make the problem for an operation that was refused."""
    if isinstance(wrong, ExceptionReceived):
        more: dict[str, Any] = {"exception": wrong.code} | ({"result": wrong.result} if wrong.result else {})
        status = OF_EXCEPTIONS.get(wrong.code, STATUSES[UnitFailed])
        return ProblemError(status, str(wrong), **more)
    status = next(STATUSES[kind] for kind in type(wrong).mro() if kind in STATUSES)
    if isinstance(wrong, NotPermitted) and wrong.code is not None:
        return ProblemError(status, str(wrong), exception=wrong.code)
    return ProblemError(status, str(wrong))


def problems(emit: Emit) -> Middleware:
    """Make the middleware that turns all errors into problems: the error boundary of a request."""

    @web.middleware
    async def as_problems(request: web.Request, handler: Handler) -> web.StreamResponse:
        try:
            return await handler(request)
        except ProblemError as problem:
            return _response(problem)
        except WrongQuestion as wrong:
            return _response(problem_of(wrong))
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
            emit(PartFailed.of("web", error))
            return _response(ProblemError(500, "a defect in the gateway; its log says more"))

    return as_problems


def _response(problem: ProblemError) -> web.Response:
    title = HTTPStatus(problem.status).phrase
    body = Problem(title=title, status=problem.status, detail=problem.detail, **problem.more)
    return web.Response(
        text=json.dumps(fields_of(body)),
        status=problem.status,
        headers=dict(problem.headers),
        content_type="application/problem+json",
    )
