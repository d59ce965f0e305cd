"""The body of a request: a bounded one in bounded time, and the fields of a form in it."""

import asyncio
from typing import Final

from aiohttp import web

from gateway.clock.threads import in_thread
from gateway.web.front.forms import MOST_FIELDS, read_form
from gateway.web.front.problems import ProblemError

#: How long the body of a request may take to arrive, in seconds; and a long one, which is larger than most bodies may
#: be, in bytes: a config of 1 MiB in a form.
_BODY_TIME: Final = 10.0
_LONG_BODY_TIME: Final = 60.0
LONGEST_BODY: Final = 3 * 1024 * 1024 + 1024
FORM_TYPE: Final = "application/x-www-form-urlencoded"
#: What a request may call its encoding.
_CHARSETS: Final = frozenset({"utf-8", "utf8"})
#: Where handlers find a form with a long body; others are in `request.post()`.
FORM: Final = web.RequestKey("form", dict[str, str])


async def take_body(request: web.Request) -> None:
    """Take the body of a request.

    Raises:
        ProblemError: it is no form or text as this server takes them, or has not arrived in time.
    """
    await _read_body(request, _BODY_TIME)
    if request.content_type == FORM_TYPE:
        try:
            await request.post()
        except ValueError:
            raise ProblemError(400, "the form is not UTF-8") from None


async def with_long_body(request: web.Request) -> web.Request:
    """Take the body of a request for which more is allowed than for others: LONGEST_BODY, and a minute.

    Raises:
        ProblemError: as above.
    """
    request = request.clone(client_max_size=LONGEST_BODY)
    body = await _read_body(request, _LONG_BODY_TIME)
    if request.content_type == FORM_TYPE:
        try:
            request[FORM] = await in_thread("web form", read_form, body)
        except ValueError:
            raise ProblemError(400, f"the form is not UTF-8, or has more than {MOST_FIELDS} fields") from None
    return request


async def _read_body(request: web.Request, limit: float) -> bytes:
    if request.content_type.startswith("multipart/"):
        raise ProblemError(415, f"forms are {FORM_TYPE}")
    if (request.charset or "utf-8").lower() not in _CHARSETS:  # some codecs take seconds for 32 KiB
        raise ProblemError(415, "what is sent must be UTF-8")
    try:
        async with asyncio.timeout(limit):
            return await request.read()
    except TimeoutError:
        raise ProblemError(408, f"the request has not arrived within {limit:g} s") from None
    except ConnectionError:
        raise ProblemError(400, "the client has gone") from None
