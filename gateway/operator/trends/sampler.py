"""Looks at the last reads of all devices with points, and adds the numbers of new responses to their trends."""

import asyncio
from collections.abc import Iterator
from typing import Final

from gateway.clock.slices import in_slices
from gateway.devices.device import Device
from gateway.lines.last_reads import LastRead
from gateway.operator.answers.unit import UnitPicture
from gateway.operator.known_values import devices_with_points
from gateway.operator.operator import Operator
from gateway.operator.reached import device_of
from gateway.operator.trends.numbers import Read
from gateway.operator.trends.trends import Trends, key_of
from gateway.operator.units import points_within

#: How often it looks, in seconds: of responses that come faster the last one counts.
LOOK_EVERY: Final = 1.0


class Sampler:
    """Looks at devices. What it has prepared for a read is kept as long as the device keeps the read."""

    def __init__(self, operator: Operator, trends: Trends) -> None:
        self._operator = operator
        self._trends = trends
        self._gateway: object = None
        #: When each read was asked for that was last looked at, and how its numbers are found.
        self._asked_at: dict[LastRead, float] = {}
        self._prepared: dict[LastRead, Read] = {}

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
            self._gateway, self._prepared = self._operator.gateway, {}
        before, self._asked_at = self._asked_at, {}
        for unit in devices_with_points(self._operator):
            device = device_of(self._operator.gateway, unit.key)
            if device is None or device.last_reads is None:
                continue
            for last in device.last_reads.of(device.unit):
                self._asked_at[last] = last.asked_at
                if before.get(last) != last.asked_at:
                    yield from self._add(unit, device, last)
                    yield
        self._prepared = {last: self._prepared[last] for last in self._asked_at if last in self._prepared}

    def _add(self, unit: UnitPicture, device: Device, last: LastRead) -> Iterator[None]:
        read = self._prepared.get(last)
        if read is None:
            read = self._prepared[last] = self._prepare(unit, device, last)
        for key, number in read.numbers(last.response):
            self._trends.add(key, number)
            yield

    def _prepare(self, unit: UnitPicture, device: Device, last: LastRead) -> Read:
        points = points_within(self._operator, unit, last.span)
        of_device = device.line_name, device.settings.unit, device.name
        return Read.of(last.span, [(key_of(*of_device, point), point) for point in points])
