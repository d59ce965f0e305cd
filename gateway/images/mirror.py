"""A mirror: polls a device once for any number of clients.

Reads are answered from the last poll while it is fresh; a stale value is never sent. While values are unknown, at the
start or after a client's write, a read waits until a later poll was answered or has failed. All other requests are
passed on to the device.
"""

from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby
from typing import NamedTuple, cast

from gateway.errors import IllegalAddress, StaleValue
from gateway.events import Emit
from gateway.images.ordered import MOST_READS, ClientRequests, OrderedUnit, Passed
from gateway.images.places import Places
from gateway.images.polled_range import Part
from gateway.images.polls import POLLING_FUNCTIONS, MirrorSettings, Poll, in_a_row
from gateway.images.supply import Supply
from gateway.images.tables import Table, make_tables
from gateway.modbus.pdu import Span, parse_sent
from gateway.registers.items import has_bits, pack_bits
from gateway.request import Request, Target
from gateway.trace.ring import Ring


class _Read(NamedTuple):
    """A read of `span` in `table`: the head of its response, and the parts that it touches."""

    head: bytes
    table: Table
    span: Span
    parts: tuple[Part, ...]


class Mirror(OrderedUnit):
    """Answers from what `polls` reads of `device`."""

    def __init__(
        self,
        settings: MirrorSettings,
        polls: Supply,
        device: Target,
        answers_to: Passed,
        emit: Emit,
        ring: Ring | None = None,
    ) -> None:
        super().__init__(settings.name, answers_to, emit, ring)
        self.settings = settings
        self.parts = tuple(Part(poll, self) for poll in settings.wanted)
        self._places = Places((part.span, part) for part in self.parts)
        self._polls = polls
        self.device = device
        self._tables = make_tables(settings.areas, {})
        self._stale = settings.stale
        self._reads: dict[bytes, _Read] = {}

    @property
    def label(self) -> str:
        """What logs and the trace call it."""
        return self.settings.label

    def wanted(self) -> Iterable[tuple[Supply, Part]]:
        """List what it wants of its device."""
        return ((self._polls, part) for part in self.parts)

    @property
    def place(self) -> str:
        """Its place in the config."""
        return self.settings.source

    def took(self, items: Sequence[tuple[Part, bytes]], now: float) -> None:  # noqa: ARG002 - the parts have the time
        """Keep the values of parts."""
        for part, own in items:
            span = part.span
            self._tables[span.area].write(span, pack_bits(own) if has_bits(span.area) else own)

    def missed(self, parts: Sequence[Part], now: float, *, answers: bool | None) -> None:
        """Note that there are no new values: their age says so."""

    def ages(self, now: float) -> Iterator[tuple[Poll, float | None]]:
        """Yield what is polled with the age of the values in seconds; None while they are unknown.

        Addresses in a row that are only heard, and have the same age, are one.
        """
        if self.settings.together is None:
            yield from ((part.poll, part.age(now)) for part in self.parts)
            return
        for age, those in groupby(self.parts, key=lambda part: part.age(now)):
            yield from ((poll, age) for poll in in_a_row(part.poll for part in those))

    def values(self, span: Span) -> bytes:
        """Return the values of the last polls, encoded as in a response; `ages` says which of them are known.

        Addresses that are not polled have the value 0.
        """
        return self._tables[span.area].read(span)

    def _handle(self, request: Request, client: ClientRequests, now: float) -> bytes | None:
        if request.pdu[0] not in POLLING_FUNCTIONS:
            parse_sent(request.pdu)  # malformed ones are not passed on
            sent = self._derived(request, request.pdu, self._polls, now)
            sent.in_one_turn = request.in_one_turn
            self._pass_on(client, self.device, sent, now)
            return None
        return None if client.under_way else self._answer(self._read(request.pdu), client, now)

    def _at_once(self, pdu: bytes, now: float) -> bytes | None:
        read = self._reads.get(pdu)
        if read is None:
            return None
        for part in read.parts:
            age = part.age(now)
            if age is None or age > self._stale:
                return None
        return read.head + read.table.read(read.span)

    def _read(self, pdu: bytes) -> _Read:
        """Find what a read touches.

        Raises:
            RequestError: the device's profile refuses it, or not all of it is polled.
        """
        read = self._reads.get(pdu)
        if read is not None:
            return read
        asked = self.settings.profile.check(pdu)
        span = cast("Span", asked.read)
        if not self._tables[span.area].has(span) or self.settings.profile.has_wide(span):
            raise IllegalAddress(f"{self.settings.name} does not poll all of {span.area} {span.addresses}")
        if len(self._reads) >= MOST_READS:
            self._reads.clear()
        touched = tuple(self._places.touched(span))
        read = self._reads[pdu] = _Read(asked.response_head, self._tables[span.area], span, touched)
        return read

    def _answer(self, read: _Read, client: ClientRequests, now: float) -> bytes | None:
        """Return the response to the first waiting read; None if it must still wait.

        Raises:
            StaleValue: the values are too old.
        """
        if self._is_closed:
            raise StaleValue(f"{self.settings.name} is no longer polled")
        writes = client.writes.setdefault(self._polls, self._polls.writes)
        lost = next((part.span for part in read.parts if part.is_lost(now, self._stale, writes)), None)
        if lost is not None:
            where = f"{self.settings.of} ({lost.area} {lost.addresses})"
            raise StaleValue(f"{where} {self._polls.silence}", self.settings.of)
        unknown = [part for part in read.parts if not part.is_known(writes)]
        if not unknown:
            return read.head + read.table.read(read.span)
        self._wait(client, unknown)
        return None

    def __repr__(self) -> str:
        counts = self.counts
        return f"<Mirror {self.settings.name} of {self.settings.of} polls={counts.polls} failed={counts.failed}>"
