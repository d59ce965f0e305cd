"""Devices that deviate from the protocol. A profile names the quirks of its devices.

| quirk          | behaviour of the device                                         | source                    |
|----------------|-----------------------------------------------------------------|---------------------------|
| `moves`        | a write to holding register 0x0100 sets its address; the        | weighing transducer, 7, 8 |
|                | response to it comes from the new one                           |                           |
| `changes_baud` | a float32 written to 0x0200-1 sets its baud rate; it answers,   | weighing transducer, 5, 6 |
|                | then changes                                                    |                           |
| (unit = 0)     | it is asked at address 0 and answers from its own address, or 0 | weighing transducer, 3    |
"""

from collections.abc import Callable, Collection, Mapping
from struct import unpack
from typing import Final, Literal, cast

from gateway.devices.addresses import Remember, UnitAddresses, Whereabouts
from gateway.devices.device import Device, DeviceSettings, EveryDevice
from gateway.devices.moved import how_to_forget, show_addresses
from gateway.errors import ExceptionCode, IllegalValue, Refused
from gateway.events import AddressMoved, AddressRemembered, BaudChanged, Emit
from gateway.lines.breaker import FAILURES
from gateway.lines.transaction import TakesTransactions, Transaction
from gateway.modbus.codes import EXCEPTION_BIT, FIRST_UNIT, LAST_UNIT, Area
from gateway.modbus.frame import Frame
from gateway.modbus.pdu import RequestPdu, Span
from gateway.request import Request
from gateway.timing.budget import Budget
from gateway.trace.ring import Ring

Quirk = Literal["moves", "changes_baud"]

#: Holding registers of the weighing transducer: its address, and its baud rate.
ADDRESS_REGISTER: Final = 0x0100
BAUD_REGISTER: Final = 0x0200
_REGISTERS: Final[Mapping[Quirk, range]] = {
    "moves": range(ADDRESS_REGISTER, ADDRESS_REGISTER + 1),
    "changes_baud": range(BAUD_REGISTER, BAUD_REGISTER + 2),
}

_UNITS: Final = range(FIRST_UNIT, LAST_UNIT + 1)
#: The baud rates that a line can change to.
BAUD_RATES: Final = range(300, 1_000_001)


class AddressZeroTransaction(Transaction):
    """A request to address 0, which the only device of the line answers from any address."""

    __slots__ = ()

    @property
    def answers_from(self) -> None:
        """None: the unit is unknown."""

    def accepts(self, frame: Frame) -> bool:
        """Tell whether `frame` is the response, from any unit."""
        return self.asked.accepts(frame.pdu)


class AddressZeroDevice(Device):
    """A device of unknown address: `unit = 0`. Its profile must allow only function 03."""

    def _transaction(self, request: Request, asked: RequestPdu) -> Transaction:
        return AddressZeroTransaction(request, asked, self)


class AddressChange(Transaction):
    """A write to the device's address: the response comes from the new address, an exception from the old one."""

    __slots__ = ("new_unit",)

    def __init__(self, request: Request, asked: RequestPdu, device: Device) -> None:
        super().__init__(request, asked, device)
        self.new_unit = int.from_bytes(_registers(asked, ADDRESS_REGISTER, 1))

    def start(self, budget: Budget, now: float) -> None:
        """Start the request, and reserve the new address; see Transaction.

        Raises:
            IllegalValue: the new address is invalid, or another device of the line may have it.
        """
        device = cast("MovableDevice", self.device)
        device.check_move(self)
        super().start(budget, now)
        device.address.add(self.new_unit, self)

    @property
    def answers_from(self) -> None:
        """None: the response comes from the old or the new unit."""

    def accepts(self, frame: Frame) -> bool:
        """Tell whether `frame` confirms the change from the new unit, or is an exception from the old one."""
        is_exception = frame.pdu[0] & EXCEPTION_BIT
        return frame.unit == (self.unit if is_exception else self.new_unit) and self.asked.accepts(frame.pdu)


class BaudChange(Transaction):
    """A write to the device's baud rate; the device responds at the old rate."""

    __slots__ = ()

    @property
    def baud(self) -> float:
        """The new rate."""
        (baud,) = unpack(">f", _registers(self.asked, BAUD_REGISTER, 2))
        return float(baud)


class MovableDevice(Device):
    """A device that can change its address or baud rate. Requests are sent to its current address.

    `line_name` and `line_source` are for events. `change_rate` makes the line follow its rate, if it is alone there.
    `remember` stores its possible addresses for the next start.
    """

    def __init__(
        self,
        settings: DeviceSettings,
        line: TakesTransactions,
        *,
        line_name: str,
        line_source: str,
        addresses: UnitAddresses,
        change_rate: Callable[[int], None] | None,
        remember: Remember,
        emit: Emit,
        ring: Ring | None = None,
    ) -> None:
        super().__init__(settings, line, emit, ring, line_name)
        #: What makes the line follow its rate, and the place of that in the config; None if it must not.
        self._rate = None if change_rate is None else (change_rate, line_source)
        self.address = Whereabouts(self.name, addresses, remember)
        self.begin_at(settings.unit)

    @property
    def possible_units(self) -> tuple[int, ...]:
        """The addresses that it may have; none if it is not asked at all."""
        return self.address.units

    def begin_at(self, *units: int) -> None:
        """Adopt its possible addresses from an earlier run or another gateway. Without any, it is not asked."""
        self.address.begin_at(*units)
        self.unit = units[0] if units else self.settings.unit

    def check_move(self, change: AddressChange) -> None:
        """Check the new address of a change.

        Raises:
            IllegalValue: it is invalid, or another device of the line may have it.
        """
        error = None
        if change.new_unit not in _UNITS:
            error = IllegalValue(f"{change.new_unit} is no address: 1 to 247 are")
        elif not self.address.is_free(change.new_unit):
            error = IllegalValue(f"another device of the line has, or may have, the address {change.new_unit}")
        if error is not None:
            self.report_rejection(change.requests[0], error)
            raise error

    def finished(self, transaction: Transaction, response: Frame | None) -> None:
        """Update address and baud rate from the result of a transaction."""
        if response is None:
            self._failed(transaction)
        elif self.address.is_shown_by(transaction, response.unit):
            self._is_at(response.unit)
        if isinstance(transaction, BaudChange):
            self._change_baud(transaction.baud, response)

    def _transaction(self, request: Request, asked: RequestPdu) -> Transaction:
        if not self.address.units:
            raise Refused(
                "another device may be at its address: see address_remembered at the start",
                ExceptionCode.GATEWAY_PATH_UNAVAILABLE,
            )
        quirk = changes(asked, self.settings.profile.quirks)
        if quirk is None:
            return super()._transaction(request, asked)
        registers, span = _REGISTERS[quirk], cast("Span", asked.write)
        if not (asked.values and span.start <= registers.start and registers.stop <= span.end):
            raise IllegalValue("its address and its rate can only be written with all of their registers")
        return AddressChange(request, asked, self) if quirk == "moves" else BaudChange(request, asked, self)

    def _failed(self, transaction: Transaction) -> None:
        """Try the next possible address: the device did not respond."""
        units = self.address.units
        if not isinstance(transaction, AddressChange):
            self.unit = self.address.after(self.unit)
        elif self.address.is_doubtful:
            advice = f"old or new: no answer came; it is at {show_addresses(units)}, and its next answer settles it"
            self._tell_moved(transaction.new_unit, units[0], advice)
            self.unit = transaction.new_unit  # do not ask at the old one while a late change may happen
        configured = self.moved_from
        if units and configured is not None and self.breaker.failures == FAILURES:
            advice = f"it does not answer there; {how_to_forget(self.name, configured)}"
            self._emit(AddressRemembered(self.line_name, self.name, units[0], configured, advice))

    def _is_at(self, unit: int) -> None:
        """Settle on `unit`: it has responded from there."""
        if unit == self.unit and not self.address.is_doubtful:
            return
        self.unit = unit
        was = self.address.settle(unit)
        if was != unit:
            remedy = f"set unit = {unit} in {self.source}" if self.moved_from else "as the config says"
            self._tell_moved(unit, was, f"requests follow it; {remedy}")

    def _tell_moved(self, unit: int, was: int, advice: str) -> None:
        self._emit(AddressMoved(self.line_name, self.name, unit, was, advice))

    def _change_baud(self, baud: float, response: Frame | None) -> None:
        if response is not None and response.pdu[0] & EXCEPTION_BIT:
            return
        is_rate = baud.is_integer() and int(baud) in BAUD_RATES  # a range is slow for a float
        if response is None:
            advice = "old or new: no answer came, so the device may speak at either rate"
        elif self._rate is not None and is_rate:
            change_rate, place = self._rate
            change_rate(int(baud))
            advice = f"the line follows it; set baud = {baud:g} in {place}"
        else:
            advice = "the line stays at its rate, so this device cannot be reached until both are the same again"
        self._emit(BaudChanged(self.line_name, self.name, baud, advice))


class EveryQuirkyDevice(EveryDevice):
    """Unit 0 of a line whose devices have `quirks`: no broadcast may change their address or rate."""

    def __init__(
        self, line: TakesTransactions, quirks: Collection[str], emit: Emit, ring: Ring, line_name: str
    ) -> None:
        super().__init__(line, emit, ring, line_name)
        self._quirks = quirks

    def check(self, pdu: bytes) -> RequestPdu:
        """Check a broadcast, also that it writes no address and no rate. See EveryDevice."""
        asked = super().check(pdu)
        if changes(asked, self._quirks) is not None:
            raise IllegalValue(f"all devices of {self.line_name} would have the same address, or another rate")
        return asked


def changes(asked: RequestPdu, quirks: Collection[str]) -> Quirk | None:
    """Return the one of `quirks` whose registers the request writes, even partly; None if there is none."""
    span = asked.write
    if span is None or span.area is not Area.HOLDING:
        return None
    for quirk, registers in _REGISTERS.items():
        if quirk in quirks and span.start < registers.stop and registers.start < span.end:
            return quirk
    return None


def _registers(asked: RequestPdu, register: int, count: int) -> bytes:
    """Return the values that the request writes to `count` registers from `register` on."""
    at = 2 * (register - cast("Span", asked.write).start)
    return asked.values[at : at + 2 * count]
