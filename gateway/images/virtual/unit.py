"""A virtual unit: values of many devices in one block of registers.

Its rows write their values into a table when their polls are answered, so a read is a piece of that table once all rows
that it touches are known to be fresh. A client's requests are carried out one after another, as those to one device.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Final, cast

from gateway.errors import DeviceFailure, IllegalAddress, IllegalFunction, StaleValue
from gateway.events import Emit
from gateway.images.image import Image
from gateway.images.ordered import MOST_READS, ClientRequests, OrderedUnit, Passed
from gateway.images.polled_range import Part
from gateway.images.polls import POLLING_FUNCTIONS
from gateway.images.supply import Supply
from gateway.images.virtual.block import Block
from gateway.images.virtual.layout import Touched
from gateway.images.virtual.row import Row, Source
from gateway.images.virtual.settings import VirtualSettings
from gateway.images.virtual.writes import write_to
from gateway.modbus.codes import EXCEPTION_BIT, FunctionCode
from gateway.modbus.functions import BROADCAST_FUNCTIONS
from gateway.modbus.pdu import RequestPdu, Span, parse_sent
from gateway.registers.items import REGISTER, has_bits
from gateway.request import Request
from gateway.trace.ring import Ring

#: The functions that write coils or registers, but for 23.
_WRITING: Final = BROADCAST_FUNCTIONS


class VirtualUnit(OrderedUnit):
    """Answers from what is polled of `sources`, by their names. `own` has the registers that are its own."""

    def __init__(
        self,
        settings: VirtualSettings,
        sources: Mapping[str, Source],
        own: Image,
        answers_to: Passed,
        emit: Emit,
        ring: Ring | None = None,
    ) -> None:
        super().__init__(settings.name, answers_to, emit, ring)
        self.settings = settings
        self.own = own
        self.block = Block(settings, sources, own, self)
        # A coil of the unit is on or off, and its registers have two bytes.
        self._profile = replace(settings.profile, any_coil=False, wide={})
        self._reads: dict[bytes, Touched] = {}

    @property
    def label(self) -> str:
        """What logs and the trace call it."""
        return self.settings.label

    @property
    def place(self) -> str:
        """Its place in the config."""
        return self.settings.source

    def wanted(self) -> Iterable[tuple[Supply, Part]]:
        """List what it wants of its sources."""
        return ((row.source.polls, row) for row in self.block.rows)

    def took(self, items: Sequence[tuple[Part, bytes]], now: float) -> None:  # noqa: ARG002 - the parts have the time
        """Convert the values of rows, and keep them."""
        for row, own in items:
            self.block.take(cast("Row", row), own)

    def missed(self, parts: Sequence[Part], now: float, *, answers: bool | None) -> None:  # noqa: ARG002
        """Note that there are no new values, and whether the device refuses them: the rest their age says."""
        for row in parts:
            cast("Row", row).is_refused = bool(answers)

    def passed(self, request: Request, response: bytes | None, now: float) -> None:
        """Finish a request passed on: the client gets what belongs to its own request."""
        function = request.pdu[0]
        if response is not None and function in _WRITING:
            is_exception = response[0] & EXCEPTION_BIT
            head = bytes((function | EXCEPTION_BIT,))
            response = head + response[1:] if is_exception else parse_sent(request.pdu).response_head
        super().passed(request, response, now)

    def take_over(self, old: "VirtualUnit") -> None:
        """Have the values and ages of rows that the unit which this one replaces has too."""
        self.block.take_over(old.block)

    def _at_once(self, pdu: bytes, now: float) -> bytes | None:
        read = self._reads.get(pdu)
        if read is None or not self.block.are_fresh(read, now):
            return None
        return read.head + self.block.values(read, now)

    def _handle(self, request: Request, client: ClientRequests, now: float) -> bytes | None:
        if client.under_way:
            return None
        function = request.pdu[0]
        if function == FunctionCode.READ_WRITE_MULTIPLE_REGISTERS:
            raise IllegalFunction("a virtual unit has no function 23")
        if function in POLLING_FUNCTIONS:
            read = self._read(request.pdu)
            if not read.is_own:
                return self._answer(read, client, now)
            self._pass_to_own(request, client, now)
        elif function in _WRITING:
            self._write(request, client, now)
        else:
            self._pass_to_own(request, client, now)
        return None

    def _read(self, pdu: bytes) -> Touched:
        """Find what a read touches.

        Raises:
            RequestError: the profile refuses it, not all of its addresses exist, or not all own values are known.
        """
        read = self._reads.get(pdu)
        if read is None:
            asked = self._checked(self._profile.check(pdu))
            span = cast("Span", asked.read)
            read = self.block.touched(span, asked.response_head)
            if read.is_own:
                return read
            if read.has_own and not self.own.has_started:
                raise DeviceFailure(f"{self.name}: what was saved cannot be read")
            if len(self._reads) >= MOST_READS:
                self._reads.clear()
            self._reads[pdu] = read
        return read

    def _answer(self, read: Touched, client: ClientRequests, now: float) -> bytes | None:
        """Return the response to the first waiting read; None if it must still wait.

        Raises:
            StaleValue: a value is not fresh, and there is nothing else to send for it.
        """
        if self._is_closed:
            raise StaleValue(f"{self.name} is no longer polled")
        stale, unknown, fills = self.settings.stale, [], []
        for each in read.rows:
            polls = each.source.polls
            writes = client.writes.setdefault(polls, polls.writes)
            if each.is_missing(now, stale, writes):
                when_stale = each.mapped.when_stale
                if when_stale == "exception" or (when_stale == "hold" and not each.holds):
                    raise StaleValue(f"{self.name}: {each.trouble(now, stale)}", each.mapped.device)
                if isinstance(when_stale, int):
                    fills.append((each.place, _filled(each.place, when_stale)))
            elif not each.is_known(writes):
                unknown.append(each)
        if not unknown:
            return read.head + self.block.values(read, now, fills)
        self._wait(client, unknown)
        return None

    def _write(self, request: Request, client: ClientRequests, now: float) -> None:
        """Pass on a write, to the device of the row that it touches, or to the unit's own registers.

        Raises:
            RequestError: it touches more than that, or does not suit the row.
        """
        if request.in_one_turn and not self._profile.masks(request.pdu):
            asked = self._checked(self._profile.check_in_one_turn(request.pdu, request.in_one_turn))
        else:
            asked = self._checked(self._profile.check(request.pdu))
        span = cast("Span", asked.write)
        touched = self.block.touched(span)
        if touched.is_own:
            self._pass_to_own(request, client, now)
            return
        if len(touched.rows) + len(touched.others) > 1:
            raise IllegalAddress(f"{span.area} {span.addresses} belong to several rows: write them one by one")
        if not touched.rows:
            raise IllegalAddress(f"{span.area} {span.addresses} are computed: nobody writes them")
        piece = touched.rows[0]
        before = None if piece.since(now, self.settings.stale) is None else piece.items
        write = write_to(piece, asked, request.in_one_turn, before)
        sent = self._derived(request, write.pdu, piece.source.polls, now)
        sent.in_one_turn = write.in_one_turn
        request.device = piece.mapped.device
        self._pass_on(client, piece.source.target, sent, now)

    def _pass_to_own(self, request: Request, client: ClientRequests, now: float) -> None:
        sent = self._derived(request, request.pdu, None, now)
        sent.in_one_turn = request.in_one_turn
        self._pass_on(client, self.own, sent, now)

    def _checked(self, asked: RequestPdu) -> RequestPdu:
        """Check that all addresses of a request exist.

        Raises:
            IllegalAddress: one of them does not.
        """
        span = cast("Span", asked.read or asked.write)
        if not self.block.has(span):
            raise IllegalAddress(f"{self.name} has no {span.area} {self.block.missing(span).addresses}")
        return asked

    def __repr__(self) -> str:
        counts = self.counts
        return f"<VirtualUnit {self.name} rows={len(self.block.rows)} polls={counts.polls} failed={counts.failed}>"


def _filled(place: Span, number: int) -> bytes:
    """Make the items of a place that all have a number."""
    one = bytes((bool(number),)) if has_bits(place.area) else number.to_bytes(REGISTER, "big")
    return one * place.count
