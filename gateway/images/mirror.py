"""A mirror: a device that is polled once, and read by any number of clients.

    unknown ──poll answered──▶ fresh ──older than `stale`──▶ stale: 0B
       ▲                         │                             │
       └──── a client wrote ─────┴─────────────────────────────┘

Reads are answered from the last poll as long as it is fresh; an old value is never given out. What is not known, since
the start or since a client wrote, is waited for until its poll is answered or has failed. Everything but a read goes
through to the device, and what its client asks next waits for it.

The machine knows no clock: time is an argument, and `deadline` says when it wants to be called again. A value's age
counts from when its poll was handed to the line, so it is never older than it seems.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final, NamedTuple, Protocol, cast

from gateway.errors import IllegalDataAddress, RequestError, StaleValue
from gateway.events import Emit, PollRefused, RequestRefused
from gateway.images.polled_range import PolledRange
from gateway.images.polls import POLLING_FUNCTIONS, Poll, joined
from gateway.images.tables import make_tables
from gateway.modbus.codes import EXCEPTION_BIT, READING_FUNCTIONS, Area
from gateway.modbus.pdu import Span, parse_request
from gateway.profiles.profile import Profile, Range
from gateway.request import Origin, Request

#: Exceptions by which devices refuse a range as a whole: address, quantity, and what some answer instead.
_REFUSALS: Final = frozenset({2, 3, 4})
#: Exceptions after which nothing has changed in the device: function, address, value, busy, and no way to it.
_WITHOUT_EFFECT: Final = frozenset({1, 2, 3, 6, 10})


@dataclass(frozen=True, slots=True)
class MirrorSettings:
    """A mirror of the device called `of`, which has `profile`. `areas` are the addresses of all `polls`.

    Values older than `stale` seconds are not given out.
    """

    unit: int
    name: str
    of: str
    profile: Profile
    polls: tuple[Poll, ...]
    areas: Mapping[Area, tuple[Range, ...]]
    stale: float
    source: str = field(default="", compare=False)


@dataclass(slots=True)
class Counts:
    """What a mirror has done."""

    requests: int = 0
    exceptions: int = 0
    polls: int = 0
    failed_polls: int = 0


class Poller(Origin, Protocol):
    """Who sends a mirror's polls and gets their answers, and those to the writes that pass through."""

    def written(self, request: Request, response: bytes | None) -> None:
        """Take the device's answer to a client's write."""


class MirroredDevice(Protocol):
    """The device behind a mirror."""

    def submit(self, request: Request, now: float, *, yields: bool = False) -> None:
        """Take over a request; one that `yields` lets the requests of clients go first."""

    def rests(self, now: float) -> bool:
        """Whether it has failed too often and is left alone."""


class _Read(NamedTuple):
    """What a client wants to read, and what the response begins with."""

    head: bytes
    span: Span


class Mirror:
    """A Target for clients. Its polls go out in the name of `poller`, who hands their answers to `polled`."""

    def __init__(self, settings: MirrorSettings, device: MirroredDevice, poller: Poller, emit: Emit) -> None:
        self.settings = settings
        self.counts = Counts()
        self._device = device
        self._poller = poller
        self._emit = emit
        self._tables = make_tables(settings.areas, {})
        self._ranges = [PolledRange(poll, due_at=0.0) for poll in joined(settings.polls, settings.profile.limits)]
        self._polls: dict[Request, PolledRange] = {}
        self._writes: list[tuple[Request, Span | None]] = []
        self._reads: list[tuple[Request, _Read]] = []

    def submit(self, request: Request, now: float) -> None:
        """Answer a read, or let it wait for a poll; hand everything else on to the device."""
        self.counts.requests += 1
        if request.pdu[0] not in POLLING_FUNCTIONS:
            self._pass_on(request, now)
            return
        try:
            self._read(request, self._check(request.pdu), now)
        except RequestError as error:
            self._emit(RequestRefused.of(request, error))
            self._fail(request, error)

    def polled(self, poll: Request, response: bytes | None, now: float) -> None:
        """A poll is over; None when it was not sent any more."""
        polled = self._polls.pop(poll)
        if response is None or response[0] & EXCEPTION_BIT:
            self._poll_failed(polled, response, now)
        else:
            self._tables[polled.span.area].write(polled.span, response[2:])
            polled.answered()
        self._settle(now)

    def written(self, request: Request, response: bytes | None, now: float) -> None:
        """A client's request has been through to the device, with this response; None when it was not sent any more."""
        span = next(span for write, span in self._writes if write is request)
        self._writes.remove((request, span))
        if response is not None and not _had_no_effect(response):
            for touched in self._touched(span):
                touched.must_be_asked(now)
        if response is None:
            request.end()
        else:
            request.respond(response)
        self._settle(now)

    def deadline(self) -> float | None:
        """When `tick` wants to be called; None while every range is being asked for."""
        return min((polled.due_at for polled in self._ranges if not polled.is_asked), default=None)

    def tick(self, now: float) -> None:
        """Send the polls that are due. A unit that rests is not asked."""
        due = [polled for polled in self._ranges if not polled.is_asked and polled.due_at <= now]
        is_resting = self._device.rests(now)
        for polled in due:
            polled.due_at = now + polled.poll.every
        if not is_resting:
            for polled in due:
                self._ask(polled, now)
            return
        for polled in due:
            polled.failed()
        self._settle(now)

    def ages(self, now: float) -> Iterator[tuple[Poll, float | None]]:
        """What is polled, and how old the values are in seconds; None while they are not known."""
        return ((polled.poll, polled.age(now)) for polled in self._ranges)

    def _check(self, pdu: bytes) -> _Read:
        """What a read asks for.

        Raises:
            RequestError: the device's profile refuses it, or not all of it is polled.
        """
        asked = self.settings.profile.check(pdu)
        span = cast("Span", asked.read)
        if not self._tables[span.area].has(span):
            raise IllegalDataAddress(
                f"{self.settings.name} does not poll all of {span.area} {span.start}-{span.end - 1}"
            )
        return _Read(asked.response_head, span)

    def _read(self, request: Request, read: _Read, now: float) -> None:
        """Answer a read, or let it wait."""
        touched = self._touched(read.span)
        if any(polled.is_lost(now, self.settings.stale) for polled in touched):
            self._fail(request, StaleValue(f"{self.settings.of} has not answered for too long"))
        elif any(polled.sampled_at is None for polled in touched) or self._is_behind_a_write(request, read.span):
            self._reads.append((request, read))
        else:
            request.respond(read.head + self._tables[read.span.area].read(read.span))

    def _touched(self, span: Span | None) -> list[PolledRange]:
        return [polled for polled in self._ranges if polled.touches(span)]

    def _is_behind_a_write(self, request: Request, span: Span) -> bool:
        client = request.origin.client
        return any(write.origin.client == client and _overlap(written, span) for write, written in self._writes)

    def _pass_on(self, request: Request, now: float) -> None:
        """Let the device answer. Of a write the mirror wants to hear, so that it polls what may have changed."""
        try:
            span = parse_request(request.pdu).write
        except RequestError as error:
            self._fail(request, error)
            return
        if request.pdu[0] in READING_FUNCTIONS:
            self._device.submit(request, now)
            return
        self._writes.append((request, span))
        self._device.submit(Request(request.unit, request.pdu, _Write(request, self._poller), now), now)

    def _ask(self, polled: PolledRange, now: float) -> None:
        poll = Request(self.settings.unit, polled.poll.request, self._poller, now)
        polled.asked(now)
        self.counts.polls += 1
        self._polls[poll] = polled
        self._device.submit(poll, now, yields=True)

    def _poll_failed(self, polled: PolledRange, response: bytes | None, now: float) -> None:
        self.counts.failed_polls += 1
        polled.failed()
        if response is None or response[1] not in _REFUSALS:
            return
        if polled.poll.parts:
            at = self._ranges.index(polled)
            self._ranges[at : at + 1] = [PolledRange(part, due_at=now) for part in polled.poll.parts]
        else:
            self._refused(polled, response[1])

    def _refused(self, polled: PolledRange, code: int) -> None:
        """A refusal is told once, until the device answers."""
        if not polled.is_refused:
            polled.is_refused = True
            settings = self.settings
            self._emit(PollRefused(settings.name, settings.of, str(polled.poll), code, settings.source))

    def _settle(self, now: float) -> None:
        """Answer the reads that wait for nothing any more."""
        waiting, self._reads = self._reads, []
        for request, read in waiting:
            self._read(request, read, now)

    def _fail(self, request: Request, error: RequestError) -> None:
        self.counts.exceptions += 1
        request.fail(error)

    def __repr__(self) -> str:
        counts = self.counts
        return f"<Mirror {self.settings.name} of {self.settings.of} polls={counts.polls} failed={counts.failed_polls}>"


class _Write:
    """The origin of a write on its way to the device, in the name of the client."""

    def __init__(self, original: Request, poller: "Poller") -> None:
        self._original = original
        self._poller = poller
        self.client = original.origin.client
        self.host = original.origin.host

    def wants(self, request: Request) -> bool:  # noqa: ARG002 - it is the original's client who wants it or not
        return self._original.origin.wants(self._original)

    def answer(self, request: Request, pdu: bytes | None) -> None:
        self._original.error = request.error
        self._poller.written(self._original, pdu)


def _had_no_effect(response: bytes) -> bool:
    """Whether it is an exception that says that nothing was written."""
    return bool(response[0] & EXCEPTION_BIT) and response[1] in _WITHOUT_EFFECT


def _overlap(written: Span | None, read: Span) -> bool:
    """Whether a write can change what is read; None stands for a write to nobody knows where."""
    if written is None:
        return True
    return written.area is read.area and written.start < read.end and read.start < written.end
