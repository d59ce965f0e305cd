"""The latest known values of points, out of what has passed anyway: no unit is asked for them.

A value comes from one response of the device itself that has all registers of the point, with those of its scale. The
polls of mirrors, virtual units and MQTT are reads too, as those of clients are.
"""

import asyncio
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from shlex import quote
from typing import Final, NamedTuple

from gateway.clock.slices import in_slices
from gateway.clock.times import rfc_3339
from gateway.config.plan.line_load import wanted_polls
from gateway.devices.device import Device
from gateway.images.polls import Poll
from gateway.lines.last_reads import LastRead
from gateway.operator.operations.answers.known_values import KnownValue, KnownValues, ValueState
from gateway.operator.operations.answers.unit import UnitPicture
from gateway.operator.operations.asked import KnownOf
from gateway.operator.operations.operation import Asker
from gateway.operator.operator import Operator, until_reload
from gateway.operator.units.reached import device_of, readable_for
from gateway.operator.units.units import picture, points_within, units_of
from gateway.profiles.point import NO_VALUE, Point
from gateway.profiles.reading import Reading
from gateway.registers.items import has_bits, items_read, reference

#: How old a value may be that is polled, in intervals of its poll, and one that only clients read, in seconds.
STALE_AFTER: Final = 3
STALE_BY_CLIENTS: Final = 60.0

_HOW_TO_GET_POINTS: Final = (
    "modbus-gateway profile list shows the kinds of devices whose points are known, and modbus-gateway import csv "
    "makes a profile of a table of registers"
)


class Known(NamedTuple):
    """A point, and the last read that has all of it; None if there was none. It is stale after so many seconds."""

    point: Point
    read: LastRead | None
    stale_after: float

    @property
    def reading(self) -> Reading | None:
        """What was read of the point; None if nothing was."""
        if self.read is None:
            return None
        first, count = self.point.read_span.start - self.read.span.start, self.point.read_span.count
        items = items_read(self.read.span, self.read.response, self.point.width)
        size = len(items) // self.read.span.count
        return Reading(self.point, items[first * size : (first + count) * size])

    def age(self, now: float) -> float | None:
        """Return how long ago it was asked for, in seconds; None if it never was. It may have been after `now`."""
        return None if self.read is None else max(0.0, now - self.read.asked_at)

    def is_stale(self, now: float) -> bool:
        """Return whether it is known, and too old, or from before a write."""
        return self.read is not None and (self.read.outdated or now - self.read.asked_at > self.stale_after)


async def tell_values(operator: Operator, asked: KnownOf, asker: Asker) -> KnownValues:
    """Return the latest known values of all devices, or of one.

    Raises:
        WrongQuestion: there is no such unit.
    """
    units = devices_with_points(operator) if asked.unit is None else [picture(operator, asked.unit)]
    clock = asyncio.get_running_loop().time(), time.time()
    values = (told(unit, known, *clock) for unit in units for known in known_points(operator, unit, asker))
    return KnownValues(await in_slices(values), hint_for(operator, None if asked.unit is None else units[0]))


def devices_with_points(operator: Operator) -> Sequence[UnitPicture]:
    """List the devices, on lines and behind other servers, that have points."""
    return [unit for unit in units_of(operator) if unit.points and unit.is_device]


def hint_for(operator: Operator, unit: UnitPicture | None = None) -> str:
    """Say what to do if a unit, or without one all devices, have no points; empty if they have some."""
    if unit is None:
        return "" if devices_with_points(operator) else f"no device has points: {_HOW_TO_GET_POINTS}"
    if not unit.is_device:
        return f"{unit.name} is answered by the gateway itself: modbus-gateway read {quote(unit.name)} tells its values"
    return "" if unit.points else f"{unit.name} has no points: {_HOW_TO_GET_POINTS}"


def known_points(operator: Operator, unit: UnitPicture, asker: Asker) -> Iterator[Known]:
    """Yield what is known of each point of a unit that can be read, and that the asker may read."""
    device = device_of(operator.gateway, unit.key)
    if device is None or device.name != unit.name:  # a reload came between
        return
    reads, intervals = _newest(operator, unit, device), _intervals(operator).get(unit.name, {})
    readable = readable_for(operator, unit, asker)
    for point in unit.points:
        if point.write != "only" and readable.has(point.read_span):
            every = intervals.get(point.name)
            yield Known(point, reads.get(point.name), STALE_BY_CLIENTS if every is None else STALE_AFTER * every)


def state_of(known: Known, reading: Reading | None, now: float) -> ValueState:
    """Decide whether a value is known, and young enough."""
    if known.read is None or reading is None:
        return "never"
    if known.is_stale(now):
        return "stale"
    return "fresh" if reading.value is not None else "invalid"


def _newest(operator: Operator, unit: UnitPicture, device: Device) -> Mapping[str, LastRead]:
    """Find the newest read with all of each point, by the point's name."""
    found: dict[str, LastRead] = {}
    reads = () if device.last_reads is None else device.last_reads.of(device.unit)
    for read in sorted(reads, key=lambda each: each.asked_at):
        for point in points_within(operator, unit, read.span):
            if _has_all(read, point):
                found[point.name] = read
    return found


def _has_all(read: LastRead, point: Point) -> bool:
    """Tell whether a read has all of a point; not one from before a reload that gave the registers another width."""
    fits = has_bits(read.span.area) or len(read.response) == 2 + read.span.count * point.width
    return fits and read.span.has(point.read_span)


@until_reload
def _intervals(operator: Operator) -> Mapping[str, Mapping[str, float]]:
    """Find the shortest interval of the polls that read each point, by device and the point's name."""
    units = {unit.name: unit for unit in devices_with_points(operator)}
    polls = wanted_polls(operator.gateway.plan, units)
    return {name: _shortest(operator, units[name], (each.poll for each in wanted)) for name, wanted in polls.items()}


def _shortest(operator: Operator, unit: UnitPicture, polls: Iterable[Poll]) -> Mapping[str, float]:
    every: dict[str, float] = {}
    for poll in polls:
        for point in points_within(operator, unit, poll.span):
            if poll.span.has(point.read_span):
                every[point.name] = min(poll.every, every.get(point.name, poll.every))
    return every


def told(unit: UnitPicture, known: Known, now: float, day: float) -> KnownValue:
    """Convert it to the result type; `now` is the time of the event loop, `day` the same in seconds since 1970."""
    point, read, reading = known.point, known.read, known.reading
    age = known.age(now)
    return KnownValue(
        unit=unit.unit,
        name=unit.name,
        point=point.name,
        area=point.area,
        address=point.address,
        reference=reference(point.area, point.address),
        bits=point.bits,
        value=None if reading is None else reading.value,
        text=NO_VALUE if reading is None else reading.text,
        measure=point.unit or None,
        registers=() if reading is None else reading.registers,
        state=state_of(known, reading, now),
        age_ms=None if age is None else round(age * 1000, 1),
        time=None if age is None else rfc_3339(day - age),
        source=None if read is None else read.caller.client,
        stale_ms=round(known.stale_after * 1000, 1),
    )
