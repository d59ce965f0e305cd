"""Commands from the broker: each is carried out at most once, as a write of the client `mqtt`, and gets a result."""

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from hashlib import blake2b
from typing import Final

from gateway.errors import DoesNotFit
from gateway.events import CommandRefused, Emit, WriteAudit
from gateway.modbus.codes import EXCEPTION_BIT
from gateway.modbus.functions import only_reads
from gateway.plant.messages import Command, Delivery, Misdirected
from gateway.profiles.writing import Write, request_to_write, written
from gateway.registers.items import WRITERS, items_read, read_request, write_function
from gateway.request import Caller, Origin, Request, Target
from gateway.trace.pdus import exception_in_words

#: The name of this client of devices, in rights and events.
CLIENT: Final = "mqtt"
CALLER: Final = Caller.without_address(CLIENT)
#: At most this many commands are carried out at once, and this many are remembered to recognize repeated ones.
MOST_COMMANDS: Final = 32
MOST_REMEMBERED: Final = 1000
_CLOSED: Final = "the gateway stops, or takes up another config: send it again"


#: Takes the response to a request of a command: the write, or the read of the scale before it.
TakesResponse = Callable[[Command, Request, bytes | None], None]


@dataclass(slots=True)
class CommandCounts:
    """The number of commands, and of those that were refused or failed."""

    received: int = 0
    refused: int = 0


class CarriedOut:
    """The latest commands with a correlation. A reload keeps them, because they may come again afterwards."""

    def __init__(self) -> None:
        self._keys: OrderedDict[bytes, None] = OrderedDict()

    def __contains__(self, delivery: Delivery) -> bool:
        """Tell whether a delivery with this topic and correlation was added."""
        return delivery.correlation is not None and _key(delivery.topic, delivery.correlation) in self._keys

    def add(self, delivery: Delivery) -> None:
        """Remember a delivery, if it has a correlation."""
        if delivery.correlation is None:
            return
        self._keys[_key(delivery.topic, delivery.correlation)] = None
        if len(self._keys) > MOST_REMEMBERED:
            self._keys.popitem(last=False)


class Commands:
    """Carries out commands as writes to `writes_to`; `responses_to` takes the responses.

    `tell` is called with the result of each: the error, or None. Commands in `carried_out` are refused. `clock` is the
    clock of every `now`.
    """

    def __init__(
        self,
        writes_to: Target,
        responses_to: TakesResponse,
        emit: Emit,
        clock: Callable[[], float],
        tell: Callable[[Command | Misdirected, str | None, float], None],
        carried_out: CarriedOut,
    ) -> None:
        self.counts = CommandCounts()
        self._target = writes_to
        self._responses_to = responses_to
        self._emit = emit
        self._clock = clock
        self._tell = tell
        self._in_progress = 0
        self._is_closed = False
        self._carried_out = carried_out

    def close(self) -> None:
        """Refuse all further commands: the units may be other devices from now on."""
        self._is_closed = True

    def refusal(self, delivery: Delivery) -> str:
        """Say why no command in this message may be carried out; empty if one may."""
        if self._is_closed:
            return _CLOSED
        if delivery.is_retained:
            return "it is retained, so it may be old: send it without retain"
        if delivery.is_duplicate:
            return "it may have been delivered before"
        if delivery.expiry is not None and delivery.expiry <= 0:
            return "it has expired"
        if delivery in self._carried_out:
            return "one with this correlation was received before"
        return ""

    def carry_out(self, command: Command, refusal: str, now: float) -> None:
        """Write the value of a command, unless there is a `refusal`."""
        self.counts.received += 1
        refusal = command.refusal or refusal
        if not refusal and self._in_progress >= MOST_COMMANDS:
            refusal = f"{MOST_COMMANDS} others are not finished yet"
        first = Write(b"", command.point.point.span)
        try:
            first = first if refusal else _first_request(command)
        except (ValueError, ArithmeticError, DoesNotFit) as wrong:
            refusal = str(wrong)
        if refusal:
            self._refused(command, refusal, now)
            return
        self._carried_out.add(command.delivery)
        self._in_progress += 1
        expiry = command.delivery.expiry
        origin = _Writer(self._responses_to, command, self._clock, None if expiry is None else now + expiry)
        self._send(command, first, origin, now)

    def refuse(self, misdirected: Misdirected, now: float) -> None:
        """Log and tell why this is not a valid command."""
        self.counts.received += 1
        self._emit(CommandRefused(CLIENT, misdirected.delivery.topic, misdirected.refusal))
        self._failed(misdirected, misdirected.refusal, now)

    def written(self, command: Command, request: Request, response: bytes | None, now: float) -> None:
        """Take the response to a request of a command. Tell the result, or write now if the scale was read."""
        has_failed = request.error is not None or response is None or response[0] & EXCEPTION_BIT
        if only_reads(request.pdu) and response is not None and not has_failed:
            self._go_on(command, request.origin, response, now)
            return
        self._in_progress -= 1
        if request.error is not None:
            self._failed(command, str(request.error) or request.error.result, now)
        elif response is not None and response[0] & EXCEPTION_BIT:
            self._failed(command, f"the device answers: {exception_in_words(response[1])}", now)
        else:
            self._tell(command, None, now)

    def _go_on(self, command: Command, origin: Origin, response: bytes, now: float) -> None:
        """Write, with the scale that was read."""
        point, refusal = command.point.point, _CLOSED if self._is_closed else ""
        write = Write(b"", point.span)
        try:
            write = write if refusal else _write(command, items_read(point.read_span, response, point.width))
        except (ValueError, ArithmeticError, DoesNotFit) as wrong:
            refusal = str(wrong)
        if refusal:
            self._in_progress -= 1
            self._refused(command, refusal, now)
        else:
            self._send(command, write, origin, now)

    def _send(self, command: Command, write: Write, origin: Origin, now: float) -> None:
        request = Request(command.device.unit, write.pdu, origin, now)
        request.in_one_turn = write.in_one_turn
        self._target.submit(request, now)

    def _refused(self, command: Command, why: str, now: float) -> None:
        self._emit(_audit(command))
        self._failed(command, why, now)

    def _failed(self, command: Command | Misdirected, why: str, now: float) -> None:
        self.counts.refused += 1
        self._tell(command, why, now)


class _Writer(Origin):
    """The Origin of a command's requests, which are not sent after `until`."""

    def __init__(
        self, responses_to: TakesResponse, command: Command, clock: Callable[[], float], until: float | None
    ) -> None:
        self.caller = CALLER
        self._responses_to = responses_to
        self._command = command
        self._clock = clock
        self._until = until

    def wants(self, request: Request) -> bool:  # noqa: ARG002 - it has one
        """Tell whether the request may still be sent."""
        return self._until is None or self._clock() < self._until

    def answer(self, request: Request, pdu: bytes | None) -> None:
        """Hand on the response."""
        self._responses_to(self._command, request, pdu)


def _audit(command: Command) -> WriteAudit:
    """Make the audit event of a command that becomes no request."""
    point, functions = command.point.point, command.device.functions
    span = point.write_span
    is_writable = point.area in WRITERS or point.write_at is not None
    function = write_function(span.area, span.count, functions, how=point.write_function) if is_writable else 0
    return WriteAudit(
        client=CLIENT,
        listener=CLIENT,
        unit=command.device.told_unit,
        function=int(function),
        address=span.start,
        count=span.count,
        result="refused",
        code="",
        elapsed_ms=0.0,
        device="" if command.device.on_the_wire is None else command.device.name,
    )


def _first_request(command: Command) -> Write:
    """Make the request that writes the value, or the one that reads the scale first.

    Raises:
        ValueError, ArithmeticError, DoesNotFit: the point cannot be written, or not with this value.
    """
    point = command.point.point
    if point.scale_at is not None:
        return Write(read_request(point.read_span), point.read_span)
    return _write(command)


def _write(command: Command, before: bytes | None = None) -> Write:
    """Make the request that writes the value; `before` are the items of the `read_span`, if they were read.

    Raises:
        ValueError, ArithmeticError, DoesNotFit: the point cannot be written, or not with this value.
    """
    device = command.device
    return request_to_write([written(command.point.point, command.text, before)], device.limits, device.functions)


def _key(topic: str, correlation: bytes) -> bytes:
    """Make a short key for a delivery, whose correlation may have 64 KiB."""
    return blake2b(correlation, digest_size=16, key=blake2b(topic.encode()).digest()).digest()
