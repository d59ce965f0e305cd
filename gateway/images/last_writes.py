"""The last writer of each value: for an operator who wonders where a value comes from."""

from collections.abc import Iterator
from typing import Final, NamedTuple

from gateway.modbus.codes import Area
from gateway.modbus.functions import only_reads
from gateway.modbus.pdu import Span, parse_sent
from gateway.request import Request

#: The most writes that are kept, each to different addresses; the oldest are forgotten.
MOST: Final = 256


class LastWrite(NamedTuple):
    """A write of `client`, `at` a time of the requests' clock."""

    span: Span
    client: str
    at: float


class LastWrites:
    """The last write to each span of addresses. A write costs one entry of a dict, a read nothing."""

    __slots__ = ("_writes",)

    def __init__(self) -> None:
        #: By area, first address and number, which are found sooner than a Span.
        self._writes: dict[tuple[Area, int, int], LastWrite] = {}

    def done(self, request: Request) -> None:
        """Record a request that has succeeded, unless it only reads."""
        if only_reads(request.pdu):
            return
        span = parse_sent(request.pdu).write
        if span is None:
            return
        key = span.area, span.start, span.count
        self._writes.pop(key, None)
        self._writes[key] = LastWrite(span, request.caller.client, request.received_at)
        if len(self._writes) > MOST:
            del self._writes[next(iter(self._writes))]

    def __iter__(self) -> Iterator[LastWrite]:
        """Iterate over the writes, the newest first."""
        return reversed(self._writes.values())
