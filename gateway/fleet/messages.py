"""Messages of NATS, and entries of its key-value store."""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(slots=True)
class Message:
    """A message on a subject. `reply` is the subject for the answer, empty if none is expected.

    With `has_no_responders` it is the server's notice that nobody is subscribed, so the request was not delivered.
    """

    subject: str
    body: bytes = b""
    reply: str = ""
    headers: Mapping[str, str] | None = None
    has_no_responders: bool = False


@dataclass(frozen=True, slots=True)
class Entry:
    """The value for `key` in this `revision` of a bucket.

    `created` is when the server stored it, in seconds since 1970 by the server's clock; None if unknown.
    """

    key: str
    value: bytes
    revision: int
    created: float | None = None
