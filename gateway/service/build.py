"""The composition root: the only place where a plan becomes parts."""

import asyncio
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from gateway.config.plan import LinePlan, Plan
from gateway.events import Emit
from gateway.images.image import Image
from gateway.lines.device import Device, EveryDevice
from gateway.lines.driver import LineDriver
from gateway.lines.line import Line, LineSettings
from gateway.listeners.session import ListenSettings
from gateway.listeners.tcp import TcpListener
from gateway.modbus.ascii import AsciiFramer
from gateway.modbus.frame import ResponseFramer
from gateway.modbus.rtu import ResponseFramer as RtuFramer
from gateway.ports.keeper import Keeper
from gateway.ports.port import OpenPort, SerialSettings
from gateway.request import Target
from gateway.routing.broadcast import Broadcast
from gateway.routing.router import Router

#: How a port with these settings is opened: serial ports in the service, memory ports in tests.
Opener = Callable[[SerialSettings], OpenPort]


@dataclass(frozen=True)
class Gateway:
    """All parts of a running gateway."""

    listeners: tuple[TcpListener, ...]
    drivers: tuple[LineDriver, ...]
    keepers: Mapping[str, Keeper]
    images: tuple[Image, ...]


def build(plan: Plan, loop: asyncio.AbstractEventLoop, opener: Opener, emit: Emit) -> Gateway:
    """The parts of `plan`, joined but not started: nothing is opened yet."""
    routes: dict[int, Target] = {}
    everyone: list[Target] = []
    drivers: list[LineDriver] = []
    keepers: dict[str, Keeper] = {}
    for line_plan in plan.lines:
        driver = _driver(line_plan.line, loop, emit)
        drivers.append(driver)
        name, serial = line_plan.line.name, line_plan.serial
        keepers[name] = Keeper(name, serial.port, opener(serial), driver, emit)
        routes |= _devices(line_plan, driver)
        if line_plan.line.broadcast:
            everyone.append(EveryDevice(driver, line_plan.line.timing))
    images = tuple(Image(settings) for settings in plan.images)
    routes |= {image.settings.unit: image for image in images}
    everyone += images
    listeners = tuple(
        TcpListener(settings, Router(_with_unit0(routes, settings, everyone), emit), emit)
        for settings in plan.listeners
    )
    return Gateway(listeners, tuple(drivers), keepers, images)


def _driver(settings: LineSettings, loop: asyncio.AbstractEventLoop, emit: Emit) -> LineDriver:
    framer: ResponseFramer = AsciiFramer() if settings.timing.mode == "ascii" else RtuFramer(settings.silence)
    return LineDriver(Line(settings, framer, emit), loop, emit)


def _devices(plan: LinePlan, driver: LineDriver) -> dict[int, Target]:
    return {settings.known_as: Device(settings, driver, plan.line.timing) for settings in plan.devices}


def _with_unit0(routes: dict[int, Target], settings: ListenSettings, everyone: list[Target]) -> dict[int, Target]:
    """The routes of one listener: unit 0 leads nowhere, to everyone, or where another unit's requests go."""
    if settings.unit0 == "refuse":
        return routes
    if settings.unit0 == "broadcast":
        return {**routes, 0: Broadcast(everyone)}
    return {**routes, 0: routes[settings.unit0]}
