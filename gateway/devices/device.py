"""The targets on a line: each of its devices, all of them for broadcasts, and units that a scan looks for."""

from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from typing import Final, Literal

from gateway.errors import IllegalValue, LineShared, RequestError
from gateway.events import Emit, RequestRefused, discard_event
from gateway.lines.bits import BitsTransaction
from gateway.lines.transaction import BroadcastTransaction, Destination, TakesTransactions, Transaction
from gateway.modbus.codes import BROADCAST_UNIT, HIGHEST_UNIT, FunctionCode
from gateway.modbus.frame import Frame
from gateway.modbus.pdu import RequestPdu, Span, parse_request
from gateway.profiles.holes import Holes
from gateway.profiles.profile import Profile
from gateway.request import Request
from gateway.timing.budget import AnswerTime
from gateway.timing.table import TimingTable
from gateway.trace.ring import Ring

#: The answer time of broadcasts.
_NEVER_ANSWERED: Final = AnswerTime(TimingTable(), margin=0.0, timeout=0.0)


_ELSEWHERE: Final = (
    "clients of the other site could write between the read and the write of the register; if the device has "
    "function 22, name it in the `functions` of its profile, here and there"
)
_WHOLE: Final = (
    "clients of the other site could write between the read and the write of the register, and limits of a value in it "
    "do not allow function 22; write the whole register"
)


def key_of(name: str) -> int:
    """Make the number of a device that has no unit for clients: above all units, and no two names have the same.

    So a reload that adds or removes another device never gives it to this one.
    """
    return HIGHEST_UNIT + 1 + int.from_bytes(name.encode())


@dataclass(frozen=True, slots=True)
class DeviceSettings:
    """One device of a line or upstream: `unit` on the wire, `known_as` for clients; see `key_of` if it is above 255.

    It sleeps after `wake` seconds without a request; 0 for never. `source` is its place in the config.
    """

    name: str
    unit: int
    known_as: int
    profile: Profile
    answer_time: AnswerTime
    priority: Literal["normal", "high"] = "normal"
    wake: float = 0.0
    source: str = field(default="", compare=False)

    @property
    def client_unit(self) -> int | None:
        """The unit that clients use for it; None if they can ask for it by name only, or by a listener for its line."""
        return self.known_as if self.known_as <= HIGHEST_UNIT else None


class Device(Destination):
    """A unit on a line: a Target. Requests that its profile rejects are never sent."""

    def __init__(
        self,
        settings: DeviceSettings,
        line: TakesTransactions,
        emit: Emit = discard_event,
        ring: Ring | None = None,
        line_name: str = "",
    ) -> None:
        super().__init__(
            settings.unit,
            settings.name,
            settings.answer_time,
            source=settings.source,
            is_urgent=settings.priority == "high",
            wake=settings.wake,
        )
        self.settings = settings
        #: What must not be read together. A reload hands it on to the device that takes this one's place.
        self.holes = Holes()
        self._line = line
        self._emit = emit
        self._ring = ring or Ring()
        self.line_name = line_name

    def submit(self, request: Request, now: float, *, yields: bool = False) -> None:
        """Send the request in its turn, or fail it. If it `yields`, requests of clients go first: a mirror's poll."""
        try:
            if request.in_one_turn:
                transaction = self._in_one_turn(request)
            else:
                transaction = self._transaction(request, self.settings.profile.check(request.pdu))
        except RequestError as error:
            self.refuse(request, error, now)
            return
        transaction.yields = yields
        self._line.submit(transaction, now)

    def check(self, pdu: bytes) -> RequestPdu:
        """Parse a request PDU, and check that its profile accepts it. See Profile.check."""
        return self.settings.profile.check(pdu)

    def refuse(self, request: Request, error: RequestError, now: float) -> None:
        """Fail a request that is not sent, and tell of it."""
        self.report_rejection(request, error)
        self._ring.refuse(request, error, now, line=self.line_name, name=self.name)
        super().refuse(request, error, now)

    @property
    def possible_units(self) -> tuple[int, ...]:
        """The addresses that it may have; none if it is not asked at all."""
        return (self.unit,)

    @property
    def moved_from(self) -> int | None:
        """The address in the config, if the device is, or may be, at another one; else None."""
        configured = self.settings.unit
        return None if self.possible_units == (configured,) else configured

    def is_resting(self, now: float) -> bool:
        """Tell whether the device is in its back-off."""
        return self.breaker.is_resting(now)

    def report_rejection(self, request: Request, error: RequestError) -> None:
        """Log that the request was rejected with `error`, and nothing was sent."""
        self._emit(RequestRefused.of(request, error, device=self.name))

    def _transaction(self, request: Request, asked: RequestPdu) -> Transaction:
        return Transaction(request, asked, self)

    def _in_one_turn(self, request: Request) -> Transaction:
        """Make the transaction of a write to bits: with function 22, or with a read and a write."""
        profile, pdu = self.settings.profile, request.pdu
        if profile.masks(pdu):
            request.in_one_turn = 0
            return self._transaction(request, profile.check(pdu))
        plain = self._transaction(request, profile.check_in_one_turn(pdu, request.in_one_turn))
        return BitsTransaction(request, plain.asked, self)

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.name} unit={self.unit} as={self.settings.known_as}>"


class SiteDevice(Device):
    """A unit of another site, whose gateway has other clients: they could come between a read and a write."""

    def _in_one_turn(self, request: Request) -> Transaction:
        profile = self.settings.profile
        if not profile.masks(request.pdu):
            has_guard = profile.names(FunctionCode.MASK_WRITE_REGISTER)
            raise LineShared(_WHOLE if has_guard else _ELSEWHERE)
        return super()._in_one_turn(request)


class EveryDevice(Destination):
    """Unit 0 of one line: a Target that sends broadcasts. None may touch a guarded point, whatever it writes."""

    def __init__(
        self,
        line: TakesTransactions,
        emit: Emit = discard_event,
        ring: Ring | None = None,
        line_name: str = "",
    ) -> None:
        super().__init__(BROADCAST_UNIT, "every device", _NEVER_ANSWERED)
        #: The devices of the line, which hear it.
        self.devices: Collection[Device] = ()
        self._line = line
        self._emit = emit
        self._ring = ring or Ring()
        self.line_name = line_name

    def was_written(self, span: Span | None, now: float) -> None:
        """Note it of each device."""
        for device in self.devices:
            device.was_written(span, now)

    def submit(self, request: Request, now: float) -> None:
        """Send the request to unit 0, or fail it. It must be well formed and have a broadcast function."""
        try:
            asked = self.check(request.pdu)
        except RequestError as error:
            self.refuse(request, error, now)
            return
        self._line.submit(BroadcastTransaction(request, asked, self), now)

    def check(self, pdu: bytes) -> RequestPdu:
        """Parse a broadcast, and check that all devices of the line may get it.

        Raises:
            IllegalValue: it touches a guarded point of one of them.
        """
        asked = parse_request(pdu)
        for device in self.devices:
            guards = device.settings.profile.guards
            guard = next(guards.touched(asked.write), None) if asked.write is not None else None
            if guard is not None:
                raise IllegalValue(f"{device.name}: {guard.point.rule}, and a broadcast cannot be answered")
        return asked

    def refuse(self, request: Request, error: RequestError, now: float) -> None:
        """Fail a broadcast that this line does not get, and tell of it."""
        self._emit(RequestRefused.of(request, error, device=f"{self.name} of {self.line_name}"))
        self._ring.refuse(request, error, now, line=self.line_name, name=self.name)
        super().refuse(request, error, now)


class ScannedUnit(Destination):
    """A unit that may not exist, for the reads of a scan.

    `heard` holds its answers to the last read, in time or late, each with the seconds it took after the request.
    """

    def __init__(self, unit: int, answer_time: AnswerTime, now: Callable[[], float]) -> None:
        super().__init__(unit, f"unit {unit} of a scan", answer_time)
        self.heard: list[tuple[Frame, float]] = []
        self._now = now

    def submit(self, request: Request, now: float) -> None:  # noqa: ARG002 - see Target
        """Raise AssertionError: a scan makes the transactions itself."""
        raise AssertionError("a scan makes the transactions itself")

    def finished(self, transaction: Transaction, response: Frame | None) -> None:
        """Note the response and the seconds it took."""
        if response is not None:
            self.heard.append((response, self._now() - transaction.ends_at))
