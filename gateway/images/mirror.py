"""A mirror: polls a device once for any number of clients.

    unknown ──poll answered──▶ fresh ──older than `stale`──▶ stale: 0B
       ▲                         │                             │
       └──── a client wrote ─────┴─────────────────────────────┘

Reads are answered from the last poll while it is fresh; a stale value is never sent. While values are unknown, at the
start or after a client's write, a read waits until a later poll was answered or has failed. All other requests are
passed on to the device. The requests of one client keep their order.

It has no clock: time is an argument, and `deadline` says when to call `tick`.
"""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final, cast

from gateway.errors import IllegalDataAddress, RequestError, ServerDeviceFailure, StaleValue
from gateway.events import Emit, RequestRefused
from gateway.images.last_writes import LastWrites
from gateway.images.polling import MirrorCounts, MirroredDevice, MirrorOrigin, Polling
from gateway.images.polls import POLLING_FUNCTIONS, MirrorSettings, Poll
from gateway.modbus.codes import EXCEPTION_BIT
from gateway.modbus.functions import only_reads
from gateway.modbus.pdu import Span, parse_sent
from gateway.request import DerivedOrigin, Request
from gateway.trace.ring import Ring

#: Exceptions after which nothing has changed in the device: function, address, value, busy, no path.
_WITHOUT_EFFECT: Final = frozenset({1, 2, 3, 6, 10})


@dataclass(slots=True, eq=False)
class _ClientRequests:
    """One client's open requests: those at the device, and behind them those that wait here.

    `writes`: if the first waiting request is a read, its values must include this many writes to the device.
    """

    under_way: int = 0
    waiting: deque[Request] = field(default_factory=deque)
    writes: int | None = None

    def take(self) -> Request:
        self.writes = None
        return self.waiting.popleft()


class Mirror:
    """A Target for clients. `poller` is the Origin of its polls and hands their responses to `polled`."""

    def __init__(
        self,
        settings: MirrorSettings,
        device: MirroredDevice,
        poller: MirrorOrigin,
        emit: Emit,
        ring: Ring | None = None,
    ) -> None:
        self.settings = settings
        self.counts = MirrorCounts()
        #: Writes through the mirror; there may be others.
        self.last_writes = LastWrites()
        self._device = device
        self._poller = poller
        self._emit = emit
        self._ring = ring or Ring()
        self._polling = Polling(settings, self.counts, device, poller, emit)
        self._rows: dict[str, _ClientRequests] = {}
        self._is_closed = False

    def submit(self, request: Request, now: float) -> None:
        """Answer a read, or keep it until a poll; pass everything else on to the device."""
        self.counts.requests += 1
        client = request.caller.client
        row = self._rows.setdefault(client, _ClientRequests())
        row.waiting.append(request)
        self._go_on(client, row, now)

    def abandon(self, request: Request) -> None:
        """Fail a request whose processing met a defect, unless it is over."""
        if request.is_over:
            return
        row = self._rows.get(request.caller.client)
        if row is not None and request in row.waiting:
            row.waiting.remove(request)
            row.writes = None
        request.fail(ServerDeviceFailure())

    def polled(self, poll: Request, response: bytes | None, now: float) -> None:
        """Take the response to a poll; None if it has none."""
        self._polling.polled(poll, response, now)
        self._settle(now)

    def wrote(self, request: Request, response: bytes | None, now: float) -> None:
        """Note that a request passed on, here or by the mirror before a reload, may have changed values."""
        if not only_reads(request.pdu) and response is not None and not _has_no_effect(response):
            self._polling.changed(parse_sent(request.pdu).write, now)
            if not response[0] & EXCEPTION_BIT:
                self.last_writes.done(request)

    def passed(self, request: Request, response: bytes | None, now: float) -> None:
        """Finish a request passed on with its response; None if it has none. Call `wrote` first."""
        request.place = None
        self._rows[request.caller.client].under_way -= 1
        if response is None:
            request.end()
        else:
            request.respond(response)
        self._settle(now)

    def close(self, now: float) -> None:
        """Stop polling. Reads that wait for a poll fail."""
        self._is_closed = True
        self._settle(now)

    def deadline(self) -> float | None:
        """Return when to call `tick`; None while every range is being polled."""
        return self._polling.deadline()

    def tick(self, now: float) -> None:
        """Send the polls that are due."""
        self._polling.tick(now)
        self._settle(now)

    def ages(self, now: float) -> Iterator[tuple[Poll, float | None]]:
        """Yield the polls with the age of their values in seconds; None while they are unknown."""
        return self._polling.ages(now)

    def values(self, span: Span) -> bytes:
        """Return the values of the last polls, encoded as in a response; `ages` says which of them are known.

        Addresses that are not polled have the value 0.
        """
        return self._polling.read(span)

    def _settle(self, now: float) -> None:
        """Continue with requests that no longer have to wait."""
        for client, row in list(self._rows.items()):
            self._go_on(client, row, now)

    def _go_on(self, client: str, row: _ClientRequests, now: float) -> None:
        """Continue with a client's requests until one has to wait."""
        while row.waiting and self._go_on_with(row, now):
            pass
        if not row.waiting and not row.under_way and self._rows.get(client) is row:
            del self._rows[client]

    def _go_on_with(self, row: _ClientRequests, now: float) -> bool:
        """Answer the first waiting request, or pass it on. Return False if it must still wait."""
        request = row.waiting[0]
        try:
            if request.pdu[0] not in POLLING_FUNCTIONS:
                self._pass_on(row, now)
                return True
            response = None if row.under_way else self._read(request.pdu, row, now)
        except RequestError as error:
            self._fail(row.take(), error, now)
            return True
        if response is None:
            return False
        answered = row.take()
        self._ring.answer(answered, response, now, self.settings.name)
        answered.respond(response)
        return True

    def _read(self, pdu: bytes, row: _ClientRequests, now: float) -> bytes | None:
        """Return the response to the first waiting read; None if it must still wait.

        Raises:
            RequestError: the device's profile refuses it, not all of it is polled, or the values are too old.
        """
        asked = self.settings.profile.check(pdu)
        span = cast("Span", asked.read)
        if not self._polling.has(span) or self.settings.profile.has_wide(span):
            raise IllegalDataAddress(f"{self.settings.name} does not poll all of {span.area} {span.addresses}")
        if row.writes is None:
            row.writes = self._polling.writes
        touched = self._polling.touched(span)
        if any(polled.is_lost(now, self.settings.stale, row.writes) for polled in touched):
            raise StaleValue(f"{self.settings.of} has not answered for too long")
        if all(polled.is_known(row.writes) for polled in touched):
            return asked.response_head + self._polling.read(span)
        if self._is_closed:
            raise StaleValue(f"{self.settings.name} is no longer polled")
        return None

    def _pass_on(self, row: _ClientRequests, now: float) -> None:
        """Pass the first waiting request on to the device.

        Raises:
            RequestError: it is malformed.
        """
        parse_sent(row.waiting[0].pdu)
        request = row.take()
        passed_on = Request(request.unit, request.pdu, ForwardedOrigin(request, self._poller), now)
        passed_on.in_one_turn = request.in_one_turn
        request.place = passed_on
        row.under_way += 1  # until it is over: see `passed`
        try:
            self._device.submit(passed_on, now)
        except BaseException:
            if not passed_on.is_over:
                passed_on.fail(ServerDeviceFailure())
            raise

    def _fail(self, request: Request, error: RequestError, now: float) -> None:
        self.counts.exceptions += 1
        if not isinstance(error, StaleValue):  # errors of the device are logged elsewhere
            self._emit(RequestRefused.of(request, error, device=self.settings.name))
        self._ring.refuse(request, error, now, name=self.settings.name)
        request.fail(error)

    def __repr__(self) -> str:
        counts = self.counts
        return f"<Mirror {self.settings.name} of {self.settings.of} polls={counts.polls} failed={counts.failed_polls}>"


class ForwardedOrigin(DerivedOrigin):
    """The Origin of a client's request that is passed on to the device."""

    def __init__(self, original: Request, poller: MirrorOrigin) -> None:
        super().__init__(original)
        self._poller = poller

    def answer(self, request: Request, pdu: bytes | None) -> None:
        """Pass the response to the mirror, with the error if there is one."""
        self.original.error = request.error
        self.original.in_one_turn = request.in_one_turn
        self._poller.passed(self.original, pdu)


def _has_no_effect(response: bytes) -> bool:
    """Tell whether the response is an exception after which nothing was written."""
    return bool(response[0] & EXCEPTION_BIT) and response[1] in _WITHOUT_EFFECT
