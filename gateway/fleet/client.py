"""The client of nats-py, made to survive messages that it cannot decode."""

import asyncio
from typing import Final

from nats.aio.client import Client

from gateway.fleet.counts import LostMessages

#: The event loop gets a turn after this many messages.
MESSAGES_AT_ONCE: Final = 16
#: The shortest and the longest block of headers for the library, in bytes: a first line with its end and an empty line;
#: several times what gateways send.
_SHORTEST_HEADERS: Final = 12
_LONGEST_HEADERS: Final = 4096


class TolerantClient(Client):
    """Drops messages that cannot be decoded; the library would stop reading at the first one."""

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
    """Raise ValueError if the library could not read this, or would take too long."""
    subject.decode()
    reply.decode()
    if headers and not _SHORTEST_HEADERS <= len(headers) <= _LONGEST_HEADERS:
        raise ValueError
