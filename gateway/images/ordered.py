"""Units that answer reads from polls and pass other requests on to devices.

The requests of one client keep their order: a read waits for its client's requests that are at a device, and its values
include what these have written.
"""

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Final, Protocol

from gateway.errors import DeviceFailure, RequestError, StaleValue
from gateway.events import Emit, RequestRefused
from gateway.images.last_writes import LastWrites
from gateway.images.polled_range import Part, PollCounts
from gateway.images.supply import Supply
from gateway.modbus.codes import EXCEPTION_BIT, WITHOUT_EFFECT
from gateway.modbus.functions import only_reads
from gateway.modbus.pdu import parse_sent
from gateway.request import DerivedOrigin, Request, Target
from gateway.trace.ring import Ring

#: The most different reads of which a unit remembers what they touch.
MOST_READS: Final = 1024


@dataclass(slots=True)
class AnswerCounts:
    """Requests, and exception responses of this unit itself among its answers."""

    requests: int = 0
    exceptions: int = 0


@dataclass(slots=True, eq=False)
class ClientRequests:
    """One client's open requests: those at devices, and behind them those that wait here.

    `writes`: if the first waiting request is a read, its values must include so many writes to each of these devices.
    While it `is_going_on`, what is answered at once must not begin that anew.
    """

    under_way: int = 0
    waiting: deque[Request] = field(default_factory=deque)
    writes: dict[Supply, int] = field(default_factory=dict)
    is_going_on: bool = False

    def take(self) -> Request:
        """Take the first waiting request."""
        self.writes.clear()
        return self.waiting.popleft()


class Passed(Protocol):
    """Takes the responses to requests that were passed on."""

    def passed(self, request: Request, polls: Supply | None, sent: Request, response: bytes | None) -> None:
        """Take the response to `sent`, which was passed on for `request` to what `polls` polls; None: nobody does."""


class OrderedUnit(ABC):
    """A Target for clients. `answers_to` hands the responses to requests passed on to `wrote` and `passed`."""

    def __init__(self, name: str, answers_to: Passed, emit: Emit, ring: Ring | None) -> None:
        self.name = name
        self.answer_counts = AnswerCounts()
        self.counts = PollCounts()
        #: Writes through this unit; there may be others.
        self.last_writes = LastWrites()
        self._answers_to = answers_to
        self._emit = emit
        self._ring = ring or Ring()
        self._clients: dict[str, ClientRequests] = {}
        #: Clients whose first waiting request is a read that needs this part, by their names; None: a defect was met.
        self._waiting: dict[Part | None, dict[str, ClientRequests]] = {}
        self._is_closed = False

    def submit(self, request: Request, now: float) -> None:
        """Answer a read, or keep it until a poll; pass on what is for a device."""
        self.answer_counts.requests += 1
        name = request.caller.client
        if name not in self._clients and not self._is_closed:
            response = self._at_once(request.pdu, now)
            if response is not None:
                self._ring.answer(request, response, now, self.name)
                request.respond(response)
                return
        client = self._clients.setdefault(name, ClientRequests())
        client.waiting.append(request)
        self._go_on(name, client, now)

    def abandon(self, request: Request) -> None:
        """Fail a request whose processing met a defect, unless it is over."""
        row = self._clients.get(request.caller.client)
        if row is not None and request in row.waiting:  # behind the one that met it
            row.waiting.remove(request)
        if not request.is_over:
            request.fail(DeviceFailure())

    def wrote(self, request: Request, polls: Supply, sent: Request, response: bytes | None, now: float) -> None:
        """Note that `sent`, which was passed on for `request`, may have changed values of the device."""
        if may_have_written(sent.pdu, response):
            polls.changed(parse_sent(sent.pdu).write, now)
            if response is not None and not response[0] & EXCEPTION_BIT:
                self.last_writes.done(request)

    def passed(self, request: Request, response: bytes | None, now: float) -> None:
        """Finish a request passed on with its response; None if it has none. Call `wrote` first."""
        request.place = None
        name = request.caller.client
        client = self._clients[name]
        client.under_way -= 1
        if response is None:
            request.end()
        else:
            request.respond(response)
        self._go_on(name, client, now)

    def close(self, now: float) -> None:
        """Fail the reads that wait for a poll: there will be none."""
        self._is_closed = True
        self._waiting.clear()
        for name, client in list(self._clients.items()):
            self._go_on(name, client, now)

    def settle(self, parts: Sequence[Part], now: float) -> None:
        """Go on with the reads that waited for one of these parts."""
        if not self._waiting:
            return
        for part in (None, *parts):
            those = self._waiting.pop(part, {})
            try:
                for name, client in those.items():
                    self._go_on(name, client, now)
            except BaseException:
                self._waiting.setdefault(None, {}).update(those)
                raise

    @property
    @abstractmethod
    def label(self) -> str:
        """What logs and the trace call it: `mirror silo`."""

    @abstractmethod
    def wanted(self) -> Iterable[tuple[Supply, Part]]:
        """List what it wants of its sources."""

    @abstractmethod
    def _at_once(self, pdu: bytes, now: float) -> bytes | None:
        """Return the response to a read that was answered before, while all that it touches is fresh; None otherwise.

        Its client has no other open requests.
        """

    @abstractmethod
    def _handle(self, request: Request, client: ClientRequests, now: float) -> bytes | None:
        """Return the response to the first waiting request of a client; None if it must still wait, or was passed on.

        Raises:
            RequestError: it gets an exception.
        """

    def _go_on(self, name: str, client: ClientRequests, now: float) -> None:
        """Go on with a client's requests until one has to wait."""
        if client.is_going_on:
            return
        client.is_going_on = True
        try:
            while client.waiting and self._go_on_with(client.waiting[0], client, now):
                pass
        except BaseException:
            self._waiting.setdefault(None, {})[name] = client
            raise
        finally:
            client.is_going_on = False
            if not client.waiting and not client.under_way and self._clients.get(name) is client:
                del self._clients[name]

    def _go_on_with(self, request: Request, client: ClientRequests, now: float) -> bool:
        """Answer the first waiting request, or pass it on. Return False if it must still wait."""
        try:
            response = self._handle(request, client, now)
        except RequestError as error:
            self._fail(client.take(), error, now)
            return True
        except BaseException:
            if client.waiting and client.waiting[0] is request:  # else it was passed on
                client.take().fail(DeviceFailure())
            raise
        if response is None:
            return not client.waiting or client.waiting[0] is not request
        answered = client.take()
        self._ring.answer(answered, response, now, self.name)
        answered.respond(response)
        return True

    def _wait(self, client: ClientRequests, parts: Iterable[Part]) -> None:
        """Let a client's first waiting request wait for the polls of these parts."""
        name = client.waiting[0].caller.client
        for part in parts:
            self._waiting.setdefault(part, {})[name] = client

    def _pass_on(self, client: ClientRequests, device: Target, sent: Request, now: float) -> None:
        """Pass `sent` on to the device for the first waiting request; `_derived` makes it."""
        request = client.take()
        request.place = sent
        client.under_way += 1  # until it is over: see `passed`
        try:
            device.submit(sent, now)
        except BaseException:
            if not sent.is_over:
                sent.fail(DeviceFailure())
            raise

    def _derived(self, request: Request, pdu: bytes, polls: Supply | None, now: float) -> Request:
        """Make the request that is passed on for a client's one to what `polls` polls; None: nobody does."""
        return Request(request.unit, pdu, ForwardedOrigin(request, polls, self._answers_to), now)

    def _fail(self, request: Request, error: RequestError, now: float) -> None:
        self.answer_counts.exceptions += 1
        if not isinstance(error, StaleValue):  # errors of the device are logged elsewhere
            self._emit(RequestRefused.of(request, error, device=self.name))
        self._ring.refuse(request, error, now, name=self.name)
        request.fail(error)


class ForwardedOrigin(DerivedOrigin):
    """The Origin of a client's request that is passed on to a device."""

    def __init__(self, original: Request, polls: Supply | None, answers_to: Passed) -> None:
        super().__init__(original)
        self._polls = polls
        self._answers_to = answers_to

    def answer(self, request: Request, pdu: bytes | None) -> None:
        """Hand on the response, with the error if there is one."""
        self.original.error = request.error
        if self.original.in_one_turn:
            self.original.in_one_turn = request.in_one_turn
        self._answers_to.passed(self.original, self._polls, request, pdu)


def may_have_written(pdu: bytes, response: bytes | None) -> bool:
    """Tell whether a request with this response, or without one, may have changed values of a device."""
    if only_reads(pdu) or response is None:
        return False
    return not (response[0] & EXCEPTION_BIT and response[1] in WITHOUT_EFFECT)
