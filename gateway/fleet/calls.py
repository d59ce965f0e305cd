"""Calls of the NATS library: each has a deadline, and its errors become messages for operators."""

import asyncio
import os
from collections.abc import Awaitable
from typing import Final, TypeVar

from nats.errors import Error as NatsError
from nats.errors import NoRespondersError
from nats.js.errors import (
    APIError,
    KeyNotFoundError,
    KeyWrongLastSequenceError,
    NoStreamResponseError,
    NotFoundError,
    ServiceUnavailableError,
)

from gateway.errors import FleetError

#: How long the server may take to answer, in seconds.
ANSWER_TIME: Final = 3.0

_NO_JETSTREAM: Final = "this NATS server has no JetStream, or not for this account: start it with --jetstream"
#: JetStream's error codes for a value that has changed, and for a stream that does not exist.
_CHANGED: Final = (10071, 10164)
_NO_STREAM: Final = 10059

T = TypeVar("T")


class NoKeyError(FleetError):
    """The bucket has nothing for the key."""


class NoBucketError(FleetError):
    """There is no such bucket."""


class ChangedError(FleetError):
    """The value has changed since it was read."""


async def result(call: Awaitable[T]) -> T:
    """Await a call of the library, for at most 2 * ANSWER_TIME seconds, and return its result.

    Raises:
        FleetError: the call failed.
    """
    try:
        async with asyncio.timeout(2 * ANSWER_TIME):
            return await call
    except TimeoutError:
        raise FleetError("it does not answer; this site may have no right to ask that") from None
    except NatsError as error:
        raise _failure(error) from error
    except OSError as error:
        raise FleetError(reason_of(error)) from error
    except (ValueError, LookupError) as error:  # another site may have stored such headers
        raise FleetError("what it holds cannot be read") from error


def in_words(error: Exception) -> str:
    """Explain an error of the library to operators."""
    text = str(error).removeprefix("nats:").strip().strip("'")
    lower = text.lower()
    if "authorization violation" in lower or "authentication" in lower:
        return "it refuses this user: user, password or credentials are wrong"
    if isinstance(error, NoRespondersError | NoStreamResponseError):
        return _NO_JETSTREAM
    if "permissions violation" in lower:
        return f"it has no right to {text[len('permissions violation for ') :]}"
    return text or type(error).__name__


def reason_of(error: OSError) -> str:
    """Return the text of the operating system; asyncio's own text adds an address."""
    number = error.errno or 0
    return os.strerror(number) if number > 0 else error.strerror or str(error)


def _failure(error: NatsError) -> FleetError:
    """Translate an error of the library."""
    match error:
        case NotFoundError():
            return _what_is_missing(error)
        case KeyWrongLastSequenceError():
            return ChangedError(str(error))
        case ServiceUnavailableError():
            return FleetError(error.description or _NO_JETSTREAM)
        case APIError():
            kind = ChangedError if error.err_code in _CHANGED else FleetError
            return kind(error.description or str(error))
        case NoRespondersError() | NoStreamResponseError():
            return NoBucketError(in_words(error))
    return FleetError(in_words(error))


def _what_is_missing(error: NotFoundError) -> FleetError:
    """Tell a missing key from a missing bucket: the library raises KeyNotFoundError for both."""
    is_key = isinstance(error, KeyNotFoundError) and getattr(error.__context__, "err_code", None) != _NO_STREAM
    return NoKeyError(str(error)) if is_key else NoBucketError(str(error))
