"""Devices that deviate from the protocol. A profile names the quirks of its devices.

| quirk          | what such a device does                                         | source                    |
|----------------|-----------------------------------------------------------------|---------------------------|
| `moves`        | a write to holding register 0x0100 sets its address; the        | weighing transducer, 7, 8 |
|                | response to it comes from the new one                           |                           |
| `changes_baud` | a float32 written to 0x0200-1 sets its baud rate; it answers,   | weighing transducer, 5, 6 |
|                | then changes                                                    |                           |
| (unit = 0)     | it is asked at address 0 and answers from its own address       | weighing transducer, 3    |
"""

from collections.abc import Callable
from struct import unpack
from typing import Final, Literal, Protocol, cast

from gateway.devices.device import Device, DeviceSettings, TakesTransactions
from gateway.errors import IllegalDataValue
from gateway.events import AddressMoved, BaudChanged, Emit
from gateway.lines.breaker import FAILURES
from gateway.lines.transaction import Transaction
from gateway.modbus.codes import EXCEPTION_BIT, FIRST_UNIT, LAST_UNIT, Area
from gateway.modbus.frame import Frame
from gateway.modbus.pdu import RequestPdu, Span
from gateway.request import Request
from gateway.timing.budget import Budget
from gateway.trace.ring import Ring

Quirk = Literal["moves", "changes_baud"]

#: Holding registers of the weighing transducer.
ADDRESS_REGISTER: Final = 0x0100
BAUD_REGISTER: Final = 0x0200

_UNITS: Final = range(FIRST_UNIT, LAST_UNIT + 1)
#: The baud rates that a line can change to.
BAUD_RATES: Final = range(300, 1_000_001)


class QuirkyLine(TakesTransactions, Protocol):
    """A line that can change its baud rate with its only device."""

    def change_rate(self, baud: int) -> None:
        """Change to `baud`."""


class UnitAddresses:
    """The possible unit identifiers of each device on a line.

    A device has several after an address change without a response, until it responds from one of them.
    """

    def __init__(self) -> None:
        self._units: dict[str, tuple[int, ...]] = {}

    def place(self, device: str, *units: int) -> None:
        """`device` has one of `units`."""
        self._units[device] = units

    def is_free(self, unit: int, device: str) -> bool:
        """Whether no device but `device` may have `unit`."""
        return not any(unit in units for name, units in self._units.items() if name != device)


class AddressZeroTransaction(Transaction):
    """A request to address 0, which the only device of the line answers from its own address."""

    __slots__ = ()

    @property
    def answers_from(self) -> None:
        """None: the unit is unknown."""

    def accepts(self, frame: Frame) -> bool:
        """Whether `frame` is the response, from any unit."""
        return frame.unit in _UNITS and self.asked.accepts(frame.pdu)


class AddressZeroDevice(Device):
    """A device of unknown address: `unit = 0`. Its profile must allow only function 03."""

    def _transaction(self, request: Request, asked: RequestPdu) -> Transaction:
        return AddressZeroTransaction(request, asked, self)


class AddressChange(Transaction):
    """A write to the device's address: the response comes from the new address, an exception from the old one."""

    __slots__ = ("_addresses", "new_unit")

    def __init__(self, request: Request, asked: RequestPdu, device: Device, addresses: UnitAddresses) -> None:
        super().__init__(request, asked, device)
        self.new_unit = int.from_bytes(_registers(asked, ADDRESS_REGISTER, 1))
        self._addresses = addresses

    def start(self, budget: Budget, now: float) -> None:
        """See Transaction.

        Raises:
            IllegalDataValue: the new address is invalid, or another device of the line has it.
        """
        error = self._check()
        if error is not None:
            cast("Device", self.device).report_rejection(self.requests[0], error)
            raise error
        super().start(budget, now)

    def _check(self) -> IllegalDataValue | None:
        if self.new_unit not in _UNITS:
            return IllegalDataValue(f"{self.new_unit} is no address: 1 to 247 are")
        if not self._addresses.is_free(self.new_unit, self.device.name):
            return IllegalDataValue(f"another device of the line has the address {self.new_unit}")
        return None

    @property
    def answers_from(self) -> None:
        """None: the old unit or the new one."""

    def accepts(self, frame: Frame) -> bool:
        """Whether `frame` confirms the change, or is the exception to it."""
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

    `line_name` and `line_source` are for events. If it `is_alone` on its line, the line can change its rate with it.
    `remember` stores its address for the next start.
    """

    def __init__(
        self,
        settings: DeviceSettings,
        line: QuirkyLine,
        *,
        line_name: str,
        line_source: str,
        addresses: UnitAddresses,
        is_alone: bool,
        remember: Callable[[int], None],
        emit: Emit,
        ring: Ring | None = None,
    ) -> None:
        super().__init__(settings, line, emit, ring, line_name)
        self._quirks = settings.profile.quirks
        self._change_rate = line.change_rate
        self._line_source = line_source
        self._addresses = addresses
        self._is_alone = is_alone
        self._remember = remember
        #: The address of its last response, and other possible ones: after changes without a response, or a rest.
        self._known_at = settings.unit
        self._maybe_at: list[int] = []
        addresses.place(self.name, self.unit)

    def begin_at(self, unit: int) -> None:
        """The device has its address changed to `unit`, in an earlier run or by another gateway."""
        self.unit = self._known_at = unit
        self._maybe_at = []
        self._addresses.place(self.name, unit)

    def finished(self, transaction: Transaction, response: Frame | None) -> None:
        """Update address and baud rate from the result of a transaction."""
        if isinstance(transaction, AddressChange) and response is None:
            self._doubt_change(transaction.new_unit)
        elif response is None:
            self._try_next_address()
        else:
            self._confirm(response.unit)
        if isinstance(transaction, BaudChange):
            self._change_baud(transaction.baud, response)

    def _transaction(self, request: Request, asked: RequestPdu) -> Transaction:
        if "moves" in self._quirks and _writes(asked, ADDRESS_REGISTER):
            return AddressChange(request, asked, self, self._addresses)
        if "changes_baud" in self._quirks and _writes(asked, BAUD_REGISTER, 2):
            return BaudChange(request, asked, self)
        return super()._transaction(request, asked)

    def _doubt_change(self, unit: int) -> None:
        """The change to `unit` got no response: it may have happened or not."""
        if unit != self._known_at and unit not in self._maybe_at:
            self._doubt(unit, "old or new: no answer came")

    def _doubt(self, unit: int, why: str) -> None:
        """It may have the address `unit` too. All of them are reserved until it responds from one."""
        self._maybe_at.append(unit)
        places = [self._known_at, *self._maybe_at]
        self._addresses.place(self.name, *places)
        advice = f"{why}; it is at {' or '.join(map(str, places))}, and its next answer settles it"
        self._emit(AddressMoved(self._line_name, self.name, unit, self._known_at, advice))

    def _try_next_address(self) -> None:
        """It did not respond: the next request goes to the next possible address, if there are several.

        If it rests, the configured address is possible too: somebody may have set it back by hand.
        """
        configured = self.settings.unit
        may_be_back = not self._maybe_at and self.breaker.failures >= FAILURES and configured != self._known_at
        if may_be_back and self._addresses.is_free(configured, self.name):
            self._doubt(configured, "it does not answer where it moved to")
        if self._maybe_at:
            places = [self._known_at, *self._maybe_at]
            self.unit = places[(places.index(self.unit) + 1) % len(places)]

    def _confirm(self, unit: int) -> None:
        """It responded from `unit`."""
        if unit != self._known_at:
            is_configured = unit == self.settings.unit
            remedy = "as the config says" if is_configured else f"set unit = {unit} in {self.source}"
            advice = f"requests follow it; {remedy}"
            self._emit(AddressMoved(self._line_name, self.name, unit, self._known_at, advice))
            self._remember(unit)
        elif not self._maybe_at:
            return
        self.unit = self._known_at = unit
        self._maybe_at = []
        self._addresses.place(self.name, unit)

    def _change_baud(self, baud: float, response: Frame | None) -> None:
        if response is not None and response.pdu[0] & EXCEPTION_BIT:
            return
        if response is None:
            advice = "old or new: no answer came, so the device may speak at either rate"
        elif self._is_alone and baud.is_integer() and int(baud) in BAUD_RATES:  # a range looks through all for a float
            self._change_rate(int(baud))
            advice = f"the line follows it; set baud = {baud:g} in {self._line_source}"
        else:
            advice = "the line stays at its rate, so this device cannot be reached until both are the same again"
        self._emit(BaudChanged(self._line_name, self.name, baud, advice))


def _writes(asked: RequestPdu, register: int, count: int = 1) -> bool:
    """Whether the request carries values for these holding registers."""
    span = asked.write
    if span is None or span.area is not Area.HOLDING or not asked.values:
        return False
    return span.start <= register and register + count <= span.end


def _registers(asked: RequestPdu, register: int, count: int) -> bytes:
    """The values that the request writes to `count` registers from `register` on."""
    at = 2 * (register - cast("Span", asked.write).start)
    return asked.values[at : at + 2 * count]
