"""The composition root: the only place where a plan becomes parts."""

import asyncio
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

from gateway.config.forecast import longest_wait, longest_wait_behind
from gateway.config.plan import LinePlan, Plan, ServerPlan, UpstreamPlan
from gateway.events import Emit
from gateway.images.image import Image, ImageSettings
from gateway.images.mirror_driver import MirrorDriver
from gateway.images.persistent import PersistentImage
from gateway.images.store import Store
from gateway.lines.device import Device, DeviceSettings, EveryDevice
from gateway.lines.driver import LineDriver
from gateway.lines.line import Line
from gateway.lines.quirks import LoneDevice, RestlessDevice, Whereabouts
from gateway.lines.upstream import Upstream
from gateway.lines.upstream_driver import UpstreamDriver
from gateway.listeners.serial import SerialListener
from gateway.listeners.session import ListenSettings
from gateway.listeners.tcp import TcpListener
from gateway.listeners.udp import UdpListener
from gateway.modbus.codes import BROADCAST_UNIT
from gateway.ports.keeper import Keeper
from gateway.ports.port import OpenPort, Port, PortSettings, PortUser, SerialSettings
from gateway.request import Target
from gateway.routing.broadcast import Broadcast, Recipient
from gateway.routing.router import Router
from gateway.service import remembered
from gateway.service.state import Memory

#: Where clients connect, whatever they speak.
Listener = TcpListener | UdpListener

#: How a port with these settings is opened: real ones in the service, memory ports in tests.
Opener = Callable[[PortSettings], OpenPort]


@dataclass(frozen=True)
class Gateway:
    """All parts of a running gateway, in the order of the config.

    `drivers` are those of the lines on which we ask, `servers` the lines on which we are asked. `keepers` hold the
    ports of all of them, and the connections of the upstreams.
    """

    listeners: tuple[Listener, ...]
    lines: "tuple[GatewayLine, ...]"
    servers: tuple[SerialListener, ...]
    drivers: tuple[LineDriver, ...]
    upstreams: "tuple[GatewayUpstream, ...]"
    keepers: Mapping[str, Keeper]
    images: tuple[Image, ...]
    mirrors: tuple[MirrorDriver, ...]


def build(
    plan: Plan,
    loop: asyncio.AbstractEventLoop,
    opener: Opener,
    memory: Memory,
    emit: Emit,
    store: Store | None = None,
) -> Gateway:
    """The parts of `plan`, joined but not started: nothing is opened yet. Persistent images need a `store`."""
    lines = tuple(GatewayLine(line_plan, loop, opener, memory, emit) for line_plan in plan.lines)
    upstreams = tuple(GatewayUpstream(upstream_plan, loop, opener, emit) for upstream_plan in plan.upstreams)
    images = tuple(_image(settings, store, emit) for settings in plan.images)
    parts: tuple[GatewayLine | GatewayUpstream, ...] = (*lines, *upstreams)
    devices = {device.name: device for part in parts for device in part.devices.values()}
    mirrors = tuple(MirrorDriver(settings, devices[settings.of], loop, emit) for settings in plan.mirrors)
    routes: dict[int, Target] = {image.settings.unit: image for image in images}
    for part in parts:
        routes |= part.devices
    routes |= {driver.mirror.settings.unit: driver for driver in mirrors}
    everyone = [Recipient(line.every_device, line.plan.broadcasts) for line in lines]
    everyone += [_recipient(image) for image in images]
    listeners = tuple(
        _listener(settings, Router(_with_unit0(routes, settings, everyone), emit), emit) for settings in plan.listeners
    )
    servers = tuple(
        SerialListener(server.line, Router(_served(routes, server, everyone), emit), loop, emit)
        for server in plan.servers
    )
    keepers = {part.name: part.keeper for part in parts}
    for server, listener in zip(plan.servers, servers, strict=True):
        keepers[server.line.name] = Keeper(server.line.name, server.port.port, opener(server.port), listener, emit)
    drivers = tuple(line.driver for line in lines)
    return Gateway(listeners, lines, servers, drivers, upstreams, keepers, images, mirrors)


def _image(settings: ImageSettings, store: Store | None, emit: Emit) -> Image:
    if settings.persist == "never":
        return Image(settings, emit)
    assert store is not None  # noqa: S101 - whoever builds a plan with persistent images has one
    keep = store.keep_at_once if settings.persist == "always" else store.keep_soon
    return PersistentImage(settings, store.values(settings.name), keep, emit)


def _listener(settings: ListenSettings, router: Router, emit: Emit) -> Listener:
    return (UdpListener if settings.scheme == "udp" else TcpListener)(settings, router, emit)


def _recipient(image: Image) -> Recipient:
    return Recipient(image, image.settings.profile.broadcasts)


def _served(routes: dict[int, Target], server: ServerPlan, everyone: list[Recipient]) -> dict[int, Target]:
    """The routes of a server line: the units that it serves, and those who take its broadcasts as unit 0."""
    served = {unit: routes[unit] for unit in server.line.serves}
    images = [_recipient(target) for target in served.values() if isinstance(target, Image)]
    recipients = {"images": images, "all": everyone, "none": []}[server.broadcast_to]
    return {**served, BROADCAST_UNIT: Broadcast(recipients)}


def _with_unit0(routes: dict[int, Target], settings: ListenSettings, everyone: list[Recipient]) -> dict[int, Target]:
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
        self.name = name = plan.line.name
        timing = plan.line.timing
        self._port = _RememberedPort(plan, opener, memory)
        settings = replace(plan.line, timing=replace(timing, baud=self._port.baud))
        self.driver = LineDriver(Line(settings, emit), loop, emit, self._port.rate_changed)
        self.keeper = Keeper(name, plan.port.port, self._port.open, self.driver, emit)
        self.every_device = EveryDevice(self.driver)
        self._addresses = remembered.addresses(plan, memory)
        self.devices: dict[int, Device] = {each.known_as: self._device(each) for each in plan.devices}
        self.longest_wait = {each.known_as: longest_wait(plan, each) for each in plan.devices}

    def _device(self, settings: DeviceSettings) -> Device:
        if settings.unit == BROADCAST_UNIT:
            return LoneDevice(settings, self.driver, self._emit)
        if not settings.profile.quirks:
            self._whereabouts.place(settings.name, settings.unit)
            return Device(settings, self.driver, self._emit)
        return self._restless_device(settings)

    def _restless_device(self, settings: DeviceSettings) -> Device:
        line, key = self.plan.line, remembered.address_key(self.plan, settings)
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
        device.begin_at(self._addresses[settings.name])
        return device


class GatewayUpstream:
    """One upstream with everything that belongs to it, as a GatewayLine has it."""

    def __init__(self, plan: UpstreamPlan, loop: asyncio.AbstractEventLoop, opener: Opener, emit: Emit) -> None:
        self.plan = plan
        self.name = plan.upstream.name
        self.driver = UpstreamDriver(Upstream(plan.upstream, emit), loop, emit)
        self.keeper = Keeper(self.name, plan.port.port, opener(plan.port), self.driver, emit)
        self.devices = {each.known_as: Device(each, self.driver, emit) for each in plan.devices}
        self.longest_wait = {each.known_as: longest_wait_behind(plan) for each in plan.devices}


class _RememberedPort:
    """A line's port, opened at the rate that the line has changed to, if it has. A device server keeps its own."""

    def __init__(self, plan: LinePlan, opener: Opener, memory: Memory) -> None:
        self._plan = plan
        self._opener = opener
        self._memory = memory

    @property
    def baud(self) -> int:
        """The rate at the moment."""
        return remembered.rate(self._plan, self._memory)

    def rate_changed(self, baud: int) -> None:
        """The line goes on at another rate."""
        self._memory.remember(remembered.rate_key(self._plan), self._plan.line.timing.baud, baud)

    async def open(self, user: PortUser) -> Port:
        """Open the port. Raises PortError."""
        settings = self._plan.port
        if isinstance(settings, SerialSettings):
            settings = replace(settings, baud=self.baud)
        return await self._opener(settings)(user)
