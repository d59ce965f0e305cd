"""A local register image: a unit that the gateway answers itself."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal, cast

from gateway.errors import IllegalAddress, IllegalFunction, RequestError
from gateway.events import Emit, RequestRefused, discard_event
from gateway.images.last_writes import LastWrites
from gateway.images.services import PRODUCT, Diagnostics, Identity
from gateway.images.tables import Tables, make_tables, perform
from gateway.modbus.codes import Area, FunctionCode
from gateway.modbus.functions import TABLE_FUNCTIONS
from gateway.modbus.pdu import RequestPdu, Span
from gateway.profiles.profile import Profile, Range
from gateway.registers.masks import write_after
from gateway.request import NamedTarget, Request
from gateway.trace.ring import Ring


@dataclass(frozen=True, slots=True)
class ImageSettings:
    """One image: the addresses that exist in each area, and the values they start with (area -> address -> values).

    `persist` says which values survive a restart: none, all but those of the last second, or every acknowledged write.
    An image that `shows_gateway` has the state of the gateway as its values. One with `python` is a CustomUnit, written
    there as `package:Name`, which may take `timeout` seconds for a request.
    """

    unit: int
    name: str
    profile: Profile
    areas: Mapping[Area, tuple[Range, ...]]
    initial: Mapping[Area, tuple[tuple[int, tuple[int, ...]], ...]] = field(default_factory=dict)
    persist: Literal["never", "interval", "always"] = "never"
    shows_gateway: bool = False
    python: str = ""
    timeout: float = 1.0
    source: str = field(default="", compare=False)

    @property
    def longest_wait(self) -> float:
        """How long a request may take, in seconds: for its turn and, once it has begun, for its answer."""
        return 2 * self.timeout if self.python else 0.0


@dataclass(slots=True)
class ImageCounts:
    """Requests of an image, and exception responses among its answers."""

    requests: int = 0
    exceptions: int = 0


class Image(NamedTarget):
    """Four tables behind the rules of a profile; a Target that finishes every request before `submit` returns.

    The profile limits functions, quantities and addresses, so that an image with a device's profile answers as the
    device would. `tables` holds the values, by area. `diagnostics` has the counters and the event log for clients,
    `counts` those for the operator, `last_writes` the last writers.
    """

    def __init__(
        self,
        settings: ImageSettings,
        emit: Emit = discard_event,
        ring: Ring | None = None,
        diagnostics: Diagnostics | None = None,
        product: str = PRODUCT,
        tables: Tables | None = None,
    ) -> None:
        self.settings = settings
        self.name = settings.name
        self.tables = make_tables(settings.areas, settings.initial) if tables is None else tables
        #: Whether its values are known.
        self.has_started = True
        self.counts = ImageCounts()
        self.last_writes = LastWrites()
        self.diagnostics = diagnostics or Diagnostics()
        # A coil of an image is on or off, and its registers have two bytes.
        self._profile = replace(settings.profile, any_coil=False, wide={})
        self._emit = emit
        self._ring = ring or Ring()
        identity = Identity(settings.name, product)
        self._services: Mapping[int, Callable[[bytes], bytes]] = {
            FunctionCode.DIAGNOSTICS: self.diagnostics.perform,
            FunctionCode.GET_COMM_EVENT_COUNTER: self.diagnostics.event_counter,
            FunctionCode.GET_COMM_EVENT_LOG: self.diagnostics.event_log,
            FunctionCode.REPORT_SERVER_ID: identity.report,
            FunctionCode.ENCAPSULATED_INTERFACE: identity.identify,
        }

    def submit(self, request: Request, now: float) -> None:
        """Answer `request`."""
        self._begin(request)
        try:
            outcome: bytes | RequestError = self._perform(self._check(request))
        except RequestError as error:
            outcome = error
        self._finish(request, outcome, now)

    def _begin(self, request: Request) -> None:
        """Count a request before it is executed."""
        self.counts.requests += 1
        self.diagnostics.received(request)

    def _perform(self, asked: RequestPdu) -> bytes:
        """Execute a checked request. Return the response PDU.

        Raises:
            RequestError: a sub-function (01) or an object (02) does not exist, or a value is wrong (03).
        """
        service = self._services.get(asked.function)
        return perform(self.tables, asked) if service is None else service(asked.data)

    def _finish(self, request: Request, outcome: bytes | RequestError, now: float) -> None:
        """Answer a request, and count its result."""
        if isinstance(outcome, bytes):
            self.diagnostics.done(request)
            self.last_writes.done(request)
            self._ring.answer(request, outcome, now, self.settings.name)
            request.respond(outcome)
        else:
            self.counts.exceptions += 1
            self.diagnostics.refused(request, outcome.code)
            self._tell(request, outcome)
            self._ring.refuse(request, outcome, now, name=self.settings.name)
            request.fail(outcome)

    def _tell(self, request: Request, error: RequestError) -> None:
        """Log that a request gets an exception."""
        self._emit(RequestRefused.of(request, error, device=self.settings.name))

    def _check(self, request: Request) -> RequestPdu:
        """Parse and check a request in the order of the specification (A 7). Changes nothing.

        Raises:
            RequestError: the function (01), the structure or a limit (03), or an address (02) does not fit.
        """
        pdu = request.pdu
        if pdu[0] not in TABLE_FUNCTIONS and pdu[0] not in self._services:
            raise IllegalFunction(f"an image has no function {pdu[0]}")
        function, request.in_one_turn = request.in_one_turn, 0
        if function and not self._profile.masks(pdu):
            return self._check_in_one_turn(pdu, function)
        return self._check_places(self._profile.check(pdu))

    def _check_in_one_turn(self, pdu: bytes, function: int) -> RequestPdu:
        """Check a write to bits, which is done at once, and the write of `function` that does the same."""
        asked = self._check_places(self._profile.check_in_one_turn(pdu, function))
        before = self.tables[Area.HOLDING].read(cast("Span", asked.write))
        self._profile.check(write_after(pdu, int.from_bytes(before, "big"), function))
        return asked

    def _check_places(self, asked: RequestPdu) -> RequestPdu:
        for span in (asked.read, asked.write):
            if span is not None and not self._has(span):
                raise IllegalAddress(f"{self.settings.name} has no {span.area} {span.addresses}")
        return asked

    def _has(self, span: Span) -> bool:
        return self.tables[span.area].has(span)

    def __repr__(self) -> str:
        counts = f"requests={self.counts.requests} exceptions={self.counts.exceptions}"
        return f"<Image {self.settings.name} unit={self.settings.unit} {counts}>"
