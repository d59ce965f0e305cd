"""The client of nats-py, but for what ends it: a message that it cannot decode."""

import asyncio
from typing import Final

from nats.aio.client import Client

from gateway.fleet.counts import LostMessages

#: After this many messages, other work in the event loop gets a turn.
MESSAGES_AT_ONCE: Final = 16
#: The shortest and the longest block of headers that the library may read: the first line with its end and an empty
#: line, and several times what gateways send.
_SHORTEST_HEADERS: Final = 12
_LONGEST_HEADERS: Final = 4096


class TolerantClient(Client):
    """The library stops reading for good when one message cannot be decoded: such messages are dropped here."""

    def __init__(self, lost: LostMessages) -> None:
        super().__init__()
        self._lost = lost
        self._read = 0

    async def _process_msg(self, sid: int, subject: bytes, reply: bytes, data: bytes, headers: bytes) -> None:
        self._read += 1
        if self._read % MESSAGES_AT_ONCE == 0:
            await asyncio.sleep(0)
        try:
            _check(subject, reply, headers)
            await super()._process_msg(sid, subject, reply, data, headers)
        except (ValueError, LookupError):
            self._lost.unreadable += 1


def _check(subject: bytes, reply: bytes, headers: bytes) -> None:
    """Raise ValueError if the library could not read this, or would take long for it."""
    subject.decode()
    reply.decode()
    if headers and not _SHORTEST_HEADERS <= len(headers) <= _LONGEST_HEADERS:
        raise ValueError
