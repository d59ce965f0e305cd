"""A unit, as the program asks it that the gateway is a part of."""

from collections.abc import Callable, Sequence
from struct import unpack
from typing import Final

from gateway.clock.slices import in_slices
from gateway.config.values.reserved_names import EMBEDDED
from gateway.errors import BrokenResponse, Busy, ChangedMeanwhile, DoesNotFit, NotConfigured, UnitFailed, WrongQuestion
from gateway.library.addresses import span_to_read, span_to_write
from gateway.library.anywhere import anywhere
from gateway.library.failures import failure
from gateway.library.reading import Reading, reading_of_age
from gateway.library.sampled import Sampled
from gateway.modbus.codes import EXCEPTION_BIT, MAX_PDU, Area
from gateway.modbus.pdu import Span
from gateway.operator.operations.answers.unit import UnitPicture
from gateway.operator.operations.operation import Asker
from gateway.operator.operator import Operator
from gateway.operator.units.reached import Readable, ReadableHoles, holes_of
from gateway.operator.units.units import picture
from gateway.operator.values.complaint import Complaint
from gateway.operator.values.last_values import readable
from gateway.operator.values.requests import Ask, AwaitedOrigin, ask_for, send
from gateway.operator.values.steps import Outcome, Step, Steps, reading, writing
from gateway.operator.values.unit_values import assigned, carried_out, point_named
from gateway.profiles.holes import Holes
from gateway.profiles.point import Point
from gateway.profiles.reading import Reading as PointRead
from gateway.registers.items import REGISTER, items_read, read_request, write_request
from gateway.request import Caller


def _is_there() -> bool:
    return True


#: Who asks: the program.
_ASKER: Final = Asker(Caller.without_address(EMBEDDED), _is_there, door="embedded")


class UnitClient:
    """A unit that the program reads and writes: as any client, with queue, limits, late windows, audit and rights.

    What a method returns is the answer to its own request. Methods may be awaited in the loop of another thread, too.
    Cancelling drops a request that waits; what was sent stays sent.

    Each method raises `ValueError` for what fits neither the protocol nor the config, before anything is sent;
    `NotConfigured` if the config has no such point, or since a reload no such unit; else `Refused`, `Busy`, `LineDown`
    or `NoResponse`, which have the `code` of the exception. After a `NoResponse` the device may have acted. Once the
    gateway has stopped it is `RuntimeError`.
    """

    def __init__(self, operator: Callable[[], Operator], unit: int | str) -> None:
        """Use `Gateway.unit` to get one. `operator` returns that of the gateway, and raises once this has stopped.

        Raises:
            NotConfigured: there is no such unit.
        """
        self._operator = operator
        self._wanted = unit
        now = operator()
        self._found = self._unit(now)
        self._loop = now.running.builder.loop

    @property
    def name(self) -> str:
        """Its name."""
        return self._found.name

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.name}>"

    @anywhere
    async def read(self, point: str) -> Reading:
        """Read a point."""
        return (await self._read_points((point,)))[point]

    @anywhere
    async def read_points(self, *points: str) -> dict[str, Reading]:
        """Read points in as few requests as the unit allows; without names all that can be read.

        Raises an error if one of them could not be read.
        """
        return await self._read_points(points)

    @anywhere
    async def read_holding(self, address: int, count: int = 1) -> list[int]:
        """Read holding registers from `address` on, as 0-65535; with one request, so at most 125."""
        return await self._read_registers(Area.HOLDING, address, count)

    @anywhere
    async def read_input(self, address: int, count: int = 1) -> list[int]:
        """Read input registers from `address` on, as 0-65535; with one request, so at most 125."""
        return await self._read_registers(Area.INPUT, address, count)

    @anywhere
    async def read_coils(self, address: int, count: int = 1) -> list[bool]:
        """Read coils from `address` on; with one request, so at most 2000."""
        return [*map(bool, (await self._read(Area.COILS, address, count))[0])]

    @anywhere
    async def read_discrete(self, address: int, count: int = 1) -> list[bool]:
        """Read discrete inputs from `address` on; with one request, so at most 2000."""
        return [*map(bool, (await self._read(Area.DISCRETE, address, count))[0])]

    @anywhere
    async def write(self, point: str, value: float | str | bool) -> None:  # noqa: FBT001 - what a bit is
        """Write a point: a number, one of its labels, text, or True or False for a bit."""
        operator = self._operator()
        unit = self._unit(operator)
        found = _named(unit, point)
        try:
            steps = writing(assigned(unit, [found], [value]))
            outcome = await self._carried_out(steps, ask_for(operator, unit.key, _ASKER))
        except DoesNotFit as wrong:
            raise ValueError(f"{unit.name}, {point}: {wrong}") from None
        if outcome.failures:
            raise failure(unit.name, point, outcome.failures[0].answer.complaint)

    @anywhere
    async def write_holding(self, address: int, values: Sequence[int]) -> None:
        """Write holding registers from `address` on, each 0-65535; with one request, so at most 123."""
        await self._write(Area.HOLDING, address, values)

    @anywhere
    async def write_coils(self, address: int, values: Sequence[bool]) -> None:
        """Write coils from `address` on; with one request, so at most 1968."""
        await self._write(Area.COILS, address, values)

    @anywhere
    async def request(self, pdu: bytes) -> bytes:
        """Send a request PDU, and return the response PDU; it is empty if there is none, as to function 08/04."""
        if not 1 <= len(pdu) <= MAX_PDU:
            raise ValueError(f"a request PDU has 1 to {MAX_PDU} bytes, and not {len(pdu)}")
        return await self._asked(self._operator(), bytes(pdu))

    async def _read_registers(self, area: Area, address: int, count: int) -> list[int]:
        items, width = await self._read(area, address, count)
        return [*unpack(f">{len(items) // width}{'H' if width == REGISTER else 'I'}", items)]

    async def _read(self, area: Area, address: int, count: int) -> tuple[bytes, int]:
        """Read items, and return the bytes of a register too."""
        operator = self._operator()
        span, width = span_to_read(self._unit(operator), area, address, count)
        response = await self._asked(operator, read_request(span), span)
        try:
            return items_read(span, response, width), width
        except ValueError as wrong:
            raise BrokenResponse(f"{self.name}, {_told(span)}: {wrong}") from None

    async def _write(self, area: Area, address: int, values: Sequence[int]) -> None:
        operator = self._operator()
        unit = self._unit(operator)
        span, width, items = span_to_write(unit, area, address, values)
        pdu = write_request(area, span.start, items, unit.functions, width=width)
        await self._asked(operator, pdu, span)

    async def _asked(self, operator: Operator, pdu: bytes, place: Span | None = None) -> bytes:
        """Send a request to the unit; `place` is where it reads or writes, for errors."""
        unit, origin = self._unit(operator), AwaitedOrigin(_is_there, _ASKER.caller)
        done = await send(operator.running.routers.embedded, unit.key, Step(pdu), origin)
        response, error = done.pdu or b"", done.error
        if error is None and not (response and response[0] & EXCEPTION_BIT):
            return response
        complaint = Complaint(response[1]) if error is None else Complaint(error.code, error.result, str(error))
        raise failure(unit.name, f"function {pdu[0]}" if place is None else _told(place), complaint)

    async def _read_points(self, names: Sequence[str]) -> dict[str, Reading]:
        operator = self._operator()
        unit = self._unit(operator)
        points = [_to_read(unit, name) for name in dict.fromkeys(names)] if names else readable(unit)
        if not points:
            raise NotConfigured(f"{unit.name} has no points to read: a profile would give its registers names")
        sampled = Sampled(operator.gateway, unit.key, _ASKER)
        steps = reading(points, unit.read_rules, _holes(operator, unit) if len(points) > 1 else Holes())
        outcome = await self._carried_out(steps, ask_for(operator, unit.key, _ASKER, sampled.origin))
        if outcome.failures:
            _refuse(unit, points, outcome)
        readings = await in_slices(_reading(each, sampled) for each in outcome.readings)
        return {each.point: each for each in readings}

    async def _carried_out(self, steps: Steps, ask: Ask) -> Outcome:
        try:
            return await carried_out(steps, ask)
        except ChangedMeanwhile as wrong:
            raise Busy(f"{self.name}: {wrong}") from None
        except UnitFailed as wrong:
            raise BrokenResponse(f"{self.name}: {wrong}") from None

    def _unit(self, operator: Operator) -> UnitPicture:
        """Describe the unit.

        Raises:
            NotConfigured: there is none any more.
        """
        try:
            self._found = picture(operator, self._wanted)
        except WrongQuestion as wrong:
            raise NotConfigured(str(wrong)) from None
        return self._found


def _holes(operator: Operator, unit: UnitPicture) -> Holes:
    """Find what must not be read with what is around it: the device has refused that, or [[access]] does."""
    may_read = Readable(operator.running.routers.embedded, "", unit.key)
    return ReadableHoles(holes_of(operator.gateway, unit.key), may_read)


def _told(place: Span) -> str:
    return f"{place.area} {place.addresses}"


def _named(unit: UnitPicture, name: str) -> Point:
    try:
        return point_named(unit, name)
    except WrongQuestion as wrong:
        raise NotConfigured(str(wrong)) from None


def _to_read(unit: UnitPicture, name: str) -> Point:
    point = _named(unit, name)
    if point.write == "only":
        raise ValueError(f"{unit.name}, {name}: it can be written, but not read")
    return point


def _reading(read: PointRead, sampled: Sampled) -> Reading:
    """Tell a program what was read at a point."""
    point, value = read.point, read.value
    told = bool(value) if point.is_bit and value in (0, 1) else value
    return reading_of_age(point.name, told, point.unit, sampled.age(point.read_span))


def _refuse(unit: UnitPicture, points: Sequence[Point], outcome: Outcome) -> None:
    """Raise the error for the first point that could not be read."""
    for point in points:
        trouble = outcome.trouble_of(point)
        if trouble is not None:
            raise failure(unit.name, point.name, trouble)
