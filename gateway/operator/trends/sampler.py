"""Looks at the last reads of all devices with points, and adds the numbers of new responses to their trends."""

import asyncio
from collections.abc import Iterator
from typing import Final

from gateway.clock.slices import in_slices
from gateway.devices.device import Device
from gateway.lines.last_reads import LastRead
from gateway.modbus.pdu import Span
from gateway.operator.operations.answers.unit import UnitPicture
from gateway.operator.operator import Operator
from gateway.operator.trends.numbers import Read
from gateway.operator.trends.trends import Trends, key_of
from gateway.operator.units.reached import device_of
from gateway.operator.units.units import points_within
from gateway.operator.values.known_values import devices_with_points

#: How often it looks, in seconds: of responses that come faster the last one counts.
LOOK_EVERY: Final = 1.0
#: So many different reads are known by heart.
_MOST_SHARED: Final = 1024

#: The name of a device and a read of it: devices with the same unit on the wire share their reads.
Seen = tuple[str, LastRead]
#: A read, and the numbers of the trends of its points.
Prepared = tuple[Read, tuple[int, ...]]


class Sampler:
    """Looks at devices. What it has prepared for a read is kept as long as the device keeps the read."""

    def __init__(self, operator: Operator, trends: Trends) -> None:
        self._operator = operator
        self._trends = trends
        self._gateway: object = None
        #: When each read was asked for that was last looked at, and how its numbers are found.
        self._asked_at: dict[Seen, float] = {}
        self._prepared: dict[Seen, Prepared] = {}
        #: The same reads of devices of one kind, by span and points: what is prepared for one is good for all of them.
        self._shared: dict[tuple[Span, tuple[int, ...]], Read] = {}

    async def keep_looking(self) -> None:
        """Look once a second, until cancelled."""
        while True:
            await asyncio.sleep(LOOK_EVERY)
            await self.look()

    async def look(self) -> None:
        """Add the numbers of all responses that are new, with pauses in which lines work."""
        await in_slices(self._trends.at(self._operator.clock()))
        await in_slices(self._look())

    def _look(self) -> Iterator[None]:
        if self._gateway is not self._operator.gateway:  # what a read means may have changed
            self._gateway, self._prepared, self._shared = self._operator.gateway, {}, {}
        before, self._asked_at = self._asked_at, {}
        for unit in devices_with_points(self._operator):
            device = device_of(self._operator.gateway, unit.key)
            if device is None or device.last_reads is None:
                continue
            for last in device.last_reads.of(device.unit):
                seen = device.name, last
                self._asked_at[seen] = last.asked_at
                if before.get(seen) != last.asked_at:
                    yield from self._add(unit, device, last)
                    yield
        self._prepared = {seen: self._prepared[seen] for seen in self._asked_at if seen in self._prepared}

    def _add(self, unit: UnitPicture, device: Device, last: LastRead) -> Iterator[None]:
        prepared = self._prepared.get((device.name, last))
        if prepared is None:
            read = self._read(unit, last.span)
            of_device, keys = (device.line_name, device.settings.unit, device.name), []
            for point in read.points:
                keys.append(key_of(*of_device, point))
                yield
            prepared = self._prepared[device.name, last] = read, tuple(keys)
        read, trends = prepared
        for key, number in zip(trends, read.numbers(last.response), strict=False):
            if number is not None:
                self._trends.add(key, number)
            yield

    def _read(self, unit: UnitPicture, span: Span) -> Read:
        points = points_within(self._operator, unit, span)
        key = span, tuple(map(id, points))
        if key not in self._shared:
            if len(self._shared) >= _MOST_SHARED:
                self._shared.clear()
            self._shared[key] = Read.of(span, points)
        return self._shared[key]
