"""What goes through NATS, and what a bucket of its key-value store holds."""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(slots=True)
class Message:
    """A message on a subject. `reply` is the subject for the answer, empty if none is wanted.

    `has_no_responders`: it says that nobody has subscribed to what was asked; then nobody got it.
    """

    subject: str
    body: bytes = b""
    reply: str = ""
    headers: Mapping[str, str] | None = None
    has_no_responders: bool = False


@dataclass(frozen=True, slots=True)
class Entry:
    """What a bucket holds for `key`, in its `revision`.

    `created` is when the server took it, in seconds since 1970 by the server's clock; None if that is not told.
    """

    key: str
    value: bytes
    revision: int
    created: float | None = None
