"""Commands from the broker: each is carried out at most once, as a write of the client `mqtt`, and gets a result."""

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from hashlib import blake2b
from typing import Final, Protocol

from gateway.events import CommandRefused, Emit, WriteAudit
from gateway.modbus.codes import EXCEPTION_BIT
from gateway.plant.messages import Command, Delivery, Misdirected
from gateway.registers.items import WRITERS, most_written, write_function, write_request
from gateway.request import Caller, Origin, Request, Target
from gateway.trace.pdus import exception_in_words

#: The name of this client of devices, in rights and events.
CLIENT: Final = "mqtt"
CALLER: Final = Caller.without_address(CLIENT)
#: At most this many commands are carried out at once, and this many are remembered to recognize repeated ones.
MOST_COMMANDS: Final = 32
MOST_REMEMBERED: Final = 1000


class PlantOrigin(Origin, Protocol):
    """An Origin of reads that also takes the responses to writes."""

    def written(self, command: Command, request: Request, response: bytes | None) -> None:
        """Take the response to the write that carries out a command."""


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
    """Carries out commands as writes to `writes_to`; the responses come to `origin`.

    `tell` is called with the result of each: the error, or None. Commands in `carried_out` are refused. `clock` is the
    clock of every `now`.
    """

    def __init__(
        self,
        writes_to: Target,
        origin: PlantOrigin,
        emit: Emit,
        clock: Callable[[], float],
        tell: Callable[[Command | Misdirected, str | None, float], None],
        carried_out: CarriedOut,
    ) -> None:
        self.counts = CommandCounts()
        self._target = writes_to
        self._origin = origin
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
            return "the gateway stops, or takes up another config: send it again"
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
        try:
            pdu = b"" if refusal else _write_request(command)
        except ValueError as wrong:
            refusal = str(wrong)
        if refusal:
            self._emit(_audit(command))
            self._failed(command, refusal, now)
            return
        self._carried_out.add(command.delivery)
        self._in_progress += 1
        expiry = command.delivery.expiry
        origin = _Writer(self._origin, command, self._clock, None if expiry is None else now + expiry)
        self._target.submit(Request(command.device.unit, pdu, origin, now), now)

    def refuse(self, misdirected: Misdirected, now: float) -> None:
        """Log and tell why this is not a valid command."""
        self.counts.received += 1
        self._emit(CommandRefused(CLIENT, misdirected.delivery.topic, misdirected.refusal))
        self._failed(misdirected, misdirected.refusal, now)

    def written(self, command: Command, request: Request, response: bytes | None, now: float) -> None:
        """Tell the result of a command: its request is over."""
        self._in_progress -= 1
        if request.error is not None:
            self._failed(command, str(request.error) or request.error.result, now)
        elif response is not None and response[0] & EXCEPTION_BIT:
            self._failed(command, f"the device answers: {exception_in_words(response[1])}", now)
        else:
            self._tell(command, None, now)

    def _failed(self, command: Command | Misdirected, why: str, now: float) -> None:
        self.counts.refused += 1
        self._tell(command, why, now)


class _Writer:
    """The Origin of a command's request, which is not sent after `until`."""

    caller = CALLER

    def __init__(self, origin: PlantOrigin, command: Command, clock: Callable[[], float], until: float | None) -> None:
        self._origin = origin
        self._command = command
        self._clock = clock
        self._until = until

    def wants(self, request: Request) -> bool:  # noqa: ARG002 - it has one
        """Tell whether the request may still be sent."""
        return self._until is None or self._clock() < self._until

    def answer(self, request: Request, pdu: bytes | None) -> None:
        """Pass the response to the origin of the reads."""
        self._origin.written(self._command, request, pdu)


def _audit(command: Command) -> WriteAudit:
    """Make the audit event of a command that becomes no request."""
    point, functions = command.point.point, command.device.functions
    function = write_function(point.area, point.count, functions) if point.area in WRITERS else 0
    return WriteAudit(
        client=CLIENT,
        listener=CLIENT,
        unit=command.device.told_unit,
        function=int(function),
        address=point.address,
        count=point.count,
        result="refused",
        code="",
        elapsed_ms=0.0,
        device="" if command.device.on_the_wire is None else command.device.name,
    )


def _write_request(command: Command) -> bytes:
    """Make the PDU that writes the value.

    Raises:
        ValueError: the point cannot be written, or not with this value.
    """
    point = command.point.point
    if point.area not in WRITERS:
        raise ValueError(f"{point.area} cannot be written")
    items = point.items(command.text)
    if point.count > most_written(point.area, command.device.rules.limits):
        raise ValueError("it does not fit into one request")
    return write_request(point.area, point.address, items, command.device.functions)


def _key(topic: str, correlation: bytes) -> bytes:
    """Make a short key for a delivery, whose correlation may have 64 KiB."""
    return blake2b(correlation, digest_size=16, key=blake2b(topic.encode()).digest()).digest()
