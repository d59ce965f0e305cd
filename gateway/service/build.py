"""The composition root: the only place where a plan becomes parts."""

import asyncio
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

from gateway.config.forecast import longest_wait
from gateway.config.plan import LinePlan, Plan
from gateway.events import Emit
from gateway.images.image import Image
from gateway.lines.device import Device, DeviceSettings, EveryDevice
from gateway.lines.driver import LineDriver
from gateway.lines.line import Line
from gateway.lines.quirks import LoneDevice, RestlessDevice, Whereabouts
from gateway.listeners.session import ListenSettings
from gateway.listeners.tcp import TcpListener
from gateway.modbus.codes import BROADCAST_UNIT
from gateway.ports.keeper import Keeper
from gateway.ports.port import OpenPort, Port, PortUser, SerialSettings
from gateway.request import Target
from gateway.routing.broadcast import Broadcast
from gateway.routing.router import Router
from gateway.service.state import Memory

#: How a port with these settings is opened: serial ports in the service, memory ports in tests.
Opener = Callable[[SerialSettings], OpenPort]


@dataclass(frozen=True)
class Gateway:
    """All parts of a running gateway. Drivers and keepers are those of the lines, in the order of the config."""

    listeners: tuple[TcpListener, ...]
    lines: "tuple[GatewayLine, ...]"
    drivers: tuple[LineDriver, ...]
    keepers: Mapping[str, Keeper]
    images: tuple[Image, ...]


def build(plan: Plan, loop: asyncio.AbstractEventLoop, opener: Opener, memory: Memory, emit: Emit) -> Gateway:
    """The parts of `plan`, joined but not started: nothing is opened yet."""
    lines = tuple(GatewayLine(line_plan, loop, opener, memory, emit) for line_plan in plan.lines)
    images = tuple(Image(settings) for settings in plan.images)
    routes: dict[int, Target] = {image.settings.unit: image for image in images}
    for line in lines:
        routes |= line.devices
    everyone: list[Target] = [*(line.every_device for line in lines if line.plan.line.broadcast), *images]
    listeners = tuple(
        TcpListener(settings, Router(_with_unit0(routes, settings, everyone), emit), emit)
        for settings in plan.listeners
    )
    drivers = tuple(line.driver for line in lines)
    return Gateway(listeners, lines, drivers, {line.plan.line.name: line.keeper for line in lines}, images)


def _with_unit0(routes: dict[int, Target], settings: ListenSettings, everyone: list[Target]) -> dict[int, Target]:
    """The routes of one listener: unit 0 leads nowhere, to everyone, or where another unit's requests go."""
    if settings.unit0 == "refuse":
        return routes
    if settings.unit0 == "broadcast":
        return {**routes, BROADCAST_UNIT: Broadcast(everyone)}
    return {**routes, BROADCAST_UNIT: routes[settings.unit0]}


class GatewayLine:
    """One line with everything that belongs to it. Devices and the longest waits for them go by the clients' units."""

    def __init__(
        self, plan: LinePlan, loop: asyncio.AbstractEventLoop, opener: Opener, memory: Memory, emit: Emit
    ) -> None:
        self.plan = plan
        self._memory = memory
        self._emit = emit
        self._whereabouts = Whereabouts()
        name, timing = plan.line.name, plan.line.timing
        self._port = _RememberedPort(name, plan.serial, opener, memory)
        settings = replace(plan.line, timing=replace(timing, baud=self._port.baud))
        self.driver = LineDriver(Line(settings, emit), loop, emit, self._port.rate_changed)
        self.keeper = Keeper(name, plan.serial.port, self._port.open, self.driver, emit)
        self.every_device = EveryDevice(self.driver)
        self.devices = {each.known_as: self._device(each) for each in plan.devices}
        self.longest_wait = {each.known_as: longest_wait(plan, each) for each in plan.devices}

    def _device(self, settings: DeviceSettings) -> Device:
        if settings.unit == BROADCAST_UNIT:
            return LoneDevice(settings, self.driver)
        if not settings.profile.quirks:
            self._whereabouts.place(settings.name, settings.unit)
            return Device(settings, self.driver)
        return self._restless_device(settings)

    def _restless_device(self, settings: DeviceSettings) -> Device:
        line, key = self.plan.line, f"{self.plan.line.name}/{settings.name}"
        device = RestlessDevice(
            settings,
            self.driver,
            line_name=line.name,
            line_source=line.source,
            whereabouts=self._whereabouts,
            is_alone=len(self.plan.devices) == 1,
            remember=partial(self._memory.remember, key, settings.unit),
            emit=self._emit,
        )
        device.begin_at(self._memory.recall(key, settings.unit))
        return device


class _RememberedPort:
    """A line's port, opened at the rate that the line has changed to, if it has."""

    def __init__(self, line: str, settings: SerialSettings, opener: Opener, memory: Memory) -> None:
        self._key = line
        self._settings = settings
        self._opener = opener
        self._memory = memory

    @property
    def baud(self) -> int:
        """The rate at the moment."""
        return self._memory.recall(self._key, self._settings.baud)

    def rate_changed(self, baud: int) -> None:
        """The line goes on at another rate."""
        self._memory.remember(self._key, self._settings.baud, baud)

    async def open(self, user: PortUser) -> Port:
        """Open the port. Raises PortError."""
        return await self._opener(replace(self._settings, baud=self.baud))(user)
