"""One request on a line: its unit, the response that it accepts, and its time limit."""

from abc import abstractmethod
from math import inf

from gateway.compiler import mypyc_attr
from gateway.errors import RequestError, ResponseTimeout, Unwanted
from gateway.lines.breaker import Breaker
from gateway.lines.counts import UnitCounts
from gateway.lines.last_reads import LastReads
from gateway.modbus.codes import BROADCAST_UNIT, EXCEPTION_BIT
from gateway.modbus.frame import Frame
from gateway.modbus.pdu import RequestPdu, Span, parse_request
from gateway.request import NamedTarget, Request
from gateway.timing.budget import AnswerTime, Budget


class Sleep:
    """Tells whether a device may sleep: after `wake` seconds without a request; 0 for never."""

    __slots__ = ("_asked_at", "wake")

    def __init__(self, wake: float) -> None:
        self.wake = wake
        self._asked_at = -inf

    def end(self, now: float) -> bool:
        """Note that a request is sent. Return whether the device may have slept."""
        asked_at, self._asked_at = self._asked_at, now
        return now - asked_at >= self.wake


class Destination(NamedTarget):
    """The device that a transaction is sent to, or all devices of a line.

    `unit` is its current unit identifier on the wire. `name` and `source`, the place in the config, are for events.
    Requests to one that `is_urgent` go first. It sleeps after `wake` seconds without a request; 0 for never.
    """

    def __init__(
        self,
        unit: int,
        name: str,
        answer_time: AnswerTime,
        *,
        source: str = "",
        is_urgent: bool = False,
        wake: float = 0.0,
    ) -> None:
        self.unit = unit
        self.name = name
        self.source = source
        self.is_urgent = is_urgent
        self.sleep = Sleep(wake)
        self.answer_time = answer_time
        self.breaker = Breaker()
        self.counts = UnitCounts()
        #: Those of the counts, at hand: an attribute of a dictionary would be looked up by its name.
        self.times = self.counts.times
        #: What it has last answered; None unless something is known of what its registers mean.
        self.last_reads: LastReads | None = None

    def was_written(self, span: Span | None, now: float) -> None:
        """Note that a write to `span` (None: to any address) was sent, and may have been carried out."""
        if self.last_reads is not None:
            self.last_reads.written(span, now)

    def check(self, pdu: bytes) -> RequestPdu:
        """Parse a request PDU, and check that it may be sent there.

        Raises:
            RequestError: it must not.
        """
        return parse_request(pdu)

    def refuse(self, request: Request, error: RequestError, now: float) -> None:  # noqa: ARG002 - for subclasses
        """Fail a request that must not be sent."""
        self.counts[request.pdu[0]].count_error(error, 1)
        request.fail(error)

    def finished(self, transaction: "Transaction", response: Frame | None) -> None:
        """Note that a transaction has ended; `response` is None if none came. Must not answer requests.

        Does nothing by default.
        """


@mypyc_attr(free_list_len=1)
class Transaction:
    """A request that has passed its device's checks. Equal reads of several clients share one transaction."""

    __slots__ = (
        "asked", "asked_at", "counts", "device", "ends_at", "expects_answer", "failures", "gives_up_at", "limit",
        "requests", "retries", "sent_at", "times", "unit", "wakes", "yields",
    )  # fmt: skip

    #: Whether it is for all units.
    is_broadcast = False
    #: Whether it only tests if a unit exists, so that silence is no failure.
    is_scan = False
    #: Whether a second response may follow the first one.
    awaits_second = False
    #: Whether it is a write to bits, or a part of one: see `bits`.
    is_of_bits = False

    def __init__(self, request: Request, asked: RequestPdu, device: Destination) -> None:
        #: The requests that it answers.
        self.requests = [request]
        self.asked = asked
        self.device = device
        function = asked.function
        self.counts = device.counts[function]
        self.times = device.times[function]
        self.expects_answer = asked.is_answered
        #: The unit identifier that the request is sent to.
        self.unit = device.unit
        #: Whether requests of clients go first, as before a mirror's poll.
        self.yields = False
        #: When it is written, when its last character is sent, and its time limit after that, in seconds.
        self.sent_at = 0.0
        #: When it was written first: the answer may be to that, and come after it is sent again. 0 until then.
        self.asked_at = 0.0
        self.ends_at = 0.0
        self.limit = 0.0
        #: Failures of the unit to respond, number of repeats, and the latest time for another one.
        self.failures = 0
        self.retries = 0
        self.gives_up_at = 0.0
        #: Whether it was sent once, and its device may have slept.
        self.wakes = False

    def start(self, budget: Budget, now: float) -> None:
        """Set the times of a request that is written at `now`.

        Raises:
            RequestError: it must not be sent.
        """
        self.sent_at = now
        self.asked_at = self.asked_at or now
        self.ends_at = now + budget.request_wire_time(self.asked)
        self.limit = budget.limit(self.asked, self.device.answer_time)

    def again(self) -> "Transaction":
        """Make a copy to send once more. The original does not change, because a late response to it may come."""
        again = self.part(self.requests)
        again.retries += 1
        return again

    def part(self, requests: list[Request]) -> "Transaction":
        """Make a copy for these of its requests."""
        part = type(self)(requests[0], self.asked, self.device)
        part.requests = requests
        part.yields = self.yields
        part.failures = self.failures
        part.retries = self.retries
        part.asked_at = self.asked_at
        part.gives_up_at = self.gives_up_at
        return part

    def opening(self) -> "Transaction":
        """Return the transaction that is sent when its turn has come: itself, by default."""
        return self

    def following(self, pdu: bytes) -> "Transaction | None":  # noqa: ARG002 - by default, nothing follows
        """Return the transaction that follows in the same turn after the response `pdu`; None if none does."""
        return None

    def resembles(self, earlier: RequestPdu) -> bool:
        """Tell whether a late response to `earlier`, to the same unit, could be taken for the response to this."""
        return self.asked.function == earlier.function

    @property
    def answers_from(self) -> int | None:
        """The unit that responds; None if it is unknown."""
        return self.unit

    def accepts(self, frame: Frame) -> bool:
        """Tell whether `frame` is the response: unit, function, size and echoed fields fit, or it is an exception."""
        return frame.unit == self.unit and self.asked.accepts(frame.pdu)

    def is_copy(self, frame: Frame) -> bool:
        """Tell whether `frame` is a copy of the request."""
        return frame.unit == self.unit and frame.pdu == self.asked.data

    @property
    def client(self) -> str:
        """The client of the first request."""
        return self.requests[0].caller.client

    @property
    def is_wanted(self) -> bool:
        """Whether a client still wants the request to be sent."""
        for request in self.requests:  # noqa: SIM110 - request path: a generator costs more than the rest
            if request.origin.wants(request):
                return True
        return False

    @property
    def unwanted(self) -> RequestError:
        """The error for a request that no client wants: a repeat was sent before."""
        return ResponseTimeout() if self.is_repeat else Unwanted()

    @property
    def is_repeat(self) -> bool:
        """Whether it was sent before, and waits to be sent again."""
        return self.retries > 0 or self.wakes

    @property
    def patience(self) -> float:
        """The least length of its late window after the request, in seconds."""
        return 0.0

    @property
    def fails_at(self) -> float:
        """The end of its time limit."""
        return self.ends_at + self.limit

    def count_sent(self, now: float) -> None:
        """Count that it is sent, for the first time or again."""
        self.counts.sent += 1
        if self.retries:
            self.counts.retries += 1
        elif not self.wakes:
            for request in self.requests:
                self.times.wait.add(now - request.received_at)
        sleep = self.device.sleep
        if sleep.wake:
            self.wakes = sleep.end(now) and self.asked.only_reads and not self.is_repeat

    def count_response(self, now: float) -> None:
        """Count a valid response that came in time."""
        self.counts.responses += 1
        self.times.answered(now, self.ends_at, self.limit)

    def respond(self, pdu: bytes, now: float) -> None:
        """Answer all requests."""
        if pdu[0] & EXCEPTION_BIT:
            self.counts.exception += len(self.requests)
            self.device.counts.count_exception(pdu[1], len(self.requests), now)
        else:
            self.counts.ok += len(self.requests)
            self.times.samples.add(self.asked.items, now - self.ends_at)
            last_reads = self.device.last_reads
            if last_reads is not None:
                last_reads.answered(self.asked, pdu, self.requests[0].caller, self.unit, self.asked_at, now)
        for request in self.requests:
            self.times.request.add(now - request.received_at)
            request.respond(pdu)

    def fail_sent(self, error: RequestError, now: float) -> None:
        """Fail all requests after they were sent."""
        self.times.limit = self.limit
        self.device.counts.record_error(error.result, now)
        self.device.counts.record(error.result, now)
        if not self.asked.only_reads:
            self.device.was_written(self.asked.write, now)
        for request in self.requests:
            self.times.request.add(now - request.received_at)
        self.fail(error)

    def fail(self, error: RequestError) -> None:
        """Fail all requests."""
        self.counts.count_error(error, len(self.requests))
        for request in self.requests:
            request.fail(error)

    def fail_open(self, error: RequestError) -> None:
        """Fail the requests that are not over."""
        self.requests = [request for request in self.requests if not request.is_over]
        self.fail(error)

    def end(self) -> None:
        """Finish all requests without a response: they were sent, and none is expected."""
        if self.is_broadcast:
            self.counts.broadcast += len(self.requests)
            self.device.was_written(self.asked.write, self.ends_at)
        else:
            self.counts.ok += len(self.requests)
        for request in self.requests:
            request.end()

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.device.name} unit={self.unit} {self.asked.data.hex(' ').upper()}>"


@mypyc_attr(allow_interpreted_subclasses=True)
class TakesTransactions:
    """A line or an upstream, as seen by its devices."""

    __slots__ = ()

    @abstractmethod
    def submit(self, transaction: Transaction, now: float) -> None:
        """Take over a transaction."""


class BroadcastTransaction(Transaction):
    """A request to all devices of the line: all act, none responds (S 2.1)."""

    __slots__ = ()

    is_broadcast = True

    def __init__(self, request: Request, asked: RequestPdu, device: Destination) -> None:
        super().__init__(request, asked, device)
        self.expects_answer = False


class ScanTransaction(Transaction):
    """A read from a unit that may not exist: silence is an answer too, neither logged nor counted as a failure.

    At address 0 it asks a lone device, which answers from its own address. With `awaits_second` another answer may
    follow the first one: two devices may have the same address. A client's request to the unit may have a longer limit
    than the scan's: late answers may come for `patience` seconds.
    """

    __slots__ = ("_patience", "awaits_second")

    is_scan = True

    def __init__(
        self,
        request: Request,
        asked: RequestPdu,
        device: Destination,
        *,
        awaits_second: bool,
        patience: float,
    ) -> None:
        super().__init__(request, asked, device)
        self.awaits_second = awaits_second
        self._patience = patience

    @property
    def patience(self) -> float:
        """The least length of its late window after the request, in seconds."""
        return self._patience

    @property
    def answers_from(self) -> int | None:
        """The unit that responds; None at address 0, where any unit may."""
        return self.unit or None

    def accepts(self, frame: Frame) -> bool:
        """Tell whether `frame` is the answer; to a read at address 0 it comes from any unit."""
        return self.asked.accepts(frame.pdu) if self.unit == BROADCAST_UNIT else super().accepts(frame)
