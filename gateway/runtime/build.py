"""Builds the parts of a gateway from a plan; nothing else does."""

import asyncio
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from gateway.config.plan.settings import LinePlan, MonitorPlan, Plan, ServerPlan, UpstreamPlan
from gateway.devices.device import Device
from gateway.events import Emit
from gateway.images.drivers.polls_driver import Pollers
from gateway.images.drivers.store import Store
from gateway.images.drivers.unit_driver import UnitDriver
from gateway.images.image import Image, ImageSettings
from gateway.images.mirror import Mirror
from gateway.images.persistent import PersistentImage
from gateway.images.polls import MirrorSettings
from gateway.images.self_image import SelfImage
from gateway.images.virtual.row import Source
from gateway.images.virtual.settings import VirtualSettings
from gateway.images.virtual.unit import VirtualUnit
from gateway.listeners.settings import ListenSettings
from gateway.listeners.tcp import TcpListener
from gateway.listeners.tls import TlsListener
from gateway.listeners.udp import UdpListener
from gateway.ports.addresses import Addresses
from gateway.ports.port import Opener, OpenPort, SiteSettings
from gateway.routing.access import EntryPoint
from gateway.routing.router import CertifiedRouter, Router
from gateway.runtime.custom_images import CustomImages
from gateway.runtime.gateway import Gateway, Listener
from gateway.runtime.gateway_line import GatewayLine
from gateway.runtime.gateway_monitor import GatewayMonitor
from gateway.runtime.gateway_server import GatewayServer
from gateway.runtime.gateway_upstream import GatewayUpstream
from gateway.runtime.polls import supply_of
from gateway.runtime.reach import with_routes
from gateway.state.memory import Memory
from gateway.tls.store import TlsStore
from gateway.trace.ring import Ring

if TYPE_CHECKING:
    from gateway.runtime.fleet.shared_line import Buckets


@dataclass(frozen=True, kw_only=True)
class Builder:
    """Builds gateways with what all their parts use.

    `opener` opens ports, `open_site` those that are units of another site, and `buckets` has the leases of lines.
    Persistent images need a `store`, and TLS listeners `contexts`. `pollers` poll devices, `custom` makes the images of
    units made in Python.
    """

    loop: asyncio.AbstractEventLoop
    emit: Emit
    ring: Ring
    memory: Memory
    store: Store | None
    contexts: TlsStore
    opener: Opener
    open_site: Callable[[str], OpenPort]
    buckets: "Buckets"
    pollers: Pollers
    custom: CustomImages

    def prepare(self, plan: Plan, before: Plan) -> None:
        """Read what persistent images of a plan have saved, and make its new units made in Python. Blocks.

        An image may have a hundred thousand values.

        Raises:
            StateError: what was saved cannot be read.
            ConfigError: a class that the config names cannot be used.
        """
        self.custom.prepare(plan, before)
        if plan.has_kept_images:
            self.opened_store()

    def build(self, plan: Plan, before: Gateway | None = None) -> Gateway:
        """Build the parts of `plan` without starting them: nothing is opened, and the new routes do not apply yet.

        Parts of the gateway `before` that are the same in `plan` are reused.
        """
        parts = _Parts(self, before or Gateway(plan=plan))
        lines = tuple(map(parts.line, plan.lines))
        upstreams = tuple(map(parts.upstream, plan.upstreams))
        on_lines = tuple(line.devices_of(one) for line, one in zip(lines, plan.lines, strict=True))
        monitors = tuple(map(parts.monitor, plan.monitors))
        behind: list[Mapping[int, Device]] = [*on_lines, *(upstream.devices for upstream in upstreams)]
        behind += [monitor.devices for monitor in monitors]
        devices = {device.name: device for units in behind for device in units.values()}
        parts.hand_on_holes(devices.values())
        images = tuple(map(parts.image, plan.images))
        sources: dict[str, Device | Image] = {**{image.settings.name: image for image in images}, **devices}
        gateway = Gateway(
            plan=plan,
            listeners=tuple(map(parts.listener, plan.listeners)),
            lines=lines,
            servers=tuple(map(parts.server, plan.servers)),
            upstreams=upstreams,
            monitors=monitors,
            images=images,
            mirrors=tuple(parts.mirror(one, devices[one.of]) for one in plan.mirrors),
            virtual=tuple(parts.virtual(one, {name: sources[name] for name in one.devices}) for one in plan.virtual),
            devices=on_lines,
        )
        return with_routes(gateway, self.ring)

    def opened_store(self) -> Store:
        """Return the store of persistent images once it has read its files. Blocks. Raises StateError."""
        assert self.store is not None  # noqa: S101 - required for plans with persistent images
        self.store.open()
        return self.store


class _Parts:
    """Builds parts, or takes them from the gateway `before` where their tables are unchanged."""

    def __init__(self, by: Builder, before: Gateway) -> None:
        self._by = by
        self._lines = {one.name: one for one in before.lines}
        self._servers = {one.name: one for one in before.servers}
        self._upstreams = {one.name: one for one in before.upstreams}
        self._monitors = {one.name: one for one in before.monitors}
        self._listeners = {one.settings.name: one for one in before.listeners}
        self._images = {one.settings.name: one for one in before.tables}
        self._mirrors = {one.name: one for one in before.mirrors}
        self._virtual = {one.name: one for one in before.virtual}
        behind = (*before.devices, *(one.devices for one in before.upstreams))
        self._devices = {device.name: device for units in behind for device in units.values()}

    def line(self, plan: LinePlan) -> GatewayLine:
        old = self._lines.get(plan.line.name)
        if old is not None and old.means(plan):
            return old
        by = self._by
        return GatewayLine(plan, by.loop, by.opener, by.memory, by.emit, by.ring, by.buckets)

    def server(self, plan: ServerPlan) -> GatewayServer:
        old = self._servers.get(plan.line.name)
        if old is not None and old.means(plan):
            return old
        by = self._by
        return GatewayServer(plan, by.loop, by.opener, by.emit, by.ring)

    def monitor(self, plan: MonitorPlan) -> GatewayMonitor:
        old = self._monitors.get(plan.name)
        if old is not None and old.plan == plan:
            return old
        by = self._by
        return GatewayMonitor(plan, by.loop, by.opener, by.emit, by.ring)

    def upstream(self, plan: UpstreamPlan) -> GatewayUpstream:
        old = self._upstreams.get(plan.upstream.name)
        if old is not None and old.plan == plan:
            return old
        by, port = self._by, plan.port
        if isinstance(port, SiteSettings):
            addresses = Addresses({port.port: by.open_site(port.site)})
        else:
            addresses = Addresses({one.port: by.opener(one) for one in (port, *plan.others)}, port.after_connect)
        return GatewayUpstream(plan, by.loop, addresses, by.emit, by.ring)

    def hand_on_holes(self, devices: Iterable[Device]) -> None:
        """Let devices that are the same know what they have refused, also if their line was rebuilt."""
        for device in devices:
            old = self._devices.get(device.name)
            if old is not None and old.settings == device.settings:
                device.holes = old.holes

    def listener(self, settings: ListenSettings) -> Listener:
        old = self._listeners.get(settings.name)
        if old is not None and old.settings == settings:
            return old
        by = self._by
        return _listener(settings, by.loop, by.emit, by.ring, by.contexts)

    def image(self, settings: ImageSettings) -> Image:
        old = self._images.get(settings.name)
        if old is not None and old.settings == settings:
            return old
        by = self._by
        if settings.python:
            return by.custom.image(settings)
        if settings.shows_gateway:
            return SelfImage(settings, by.emit, by.ring)
        if settings.persist == "never":
            return Image(settings, by.emit, by.ring)
        return PersistentImage(settings, by.opened_store(), by.emit, by.ring)

    def mirror(self, settings: MirrorSettings, device: Device) -> UnitDriver[Mirror]:
        """Build a mirror, also if only its device was rebuilt."""
        old, by, polls = self._mirrors.get(settings.name), self._by, supply_of(device, self._by.pollers)
        if old is not None and old.unit.settings == settings and old.pollers == {settings.of: polls}:
            return old

        def made(driver: UnitDriver[Mirror]) -> Mirror:
            return Mirror(settings, polls.polls, device, driver, by.emit, by.ring)

        return UnitDriver(made, {settings.of: polls}, by.loop, by.emit)

    def virtual(self, settings: VirtualSettings, devices: Mapping[str, Device | Image]) -> UnitDriver[VirtualUnit]:
        """Build a virtual unit, also if only one of its sources was rebuilt."""
        old, by, own = self._virtual.get(settings.name), self._by, self.image(settings.own)
        polls = {name: supply_of(device, by.pollers) for name, device in devices.items()}
        if old is not None and old.unit.settings == settings and old.pollers == polls:
            return old
        sources = {name: Source(polls[name].polls, device, device.settings.profile) for name, device in devices.items()}

        def made(driver: UnitDriver[VirtualUnit]) -> VirtualUnit:
            return VirtualUnit(settings, sources, own, driver, by.emit, by.ring)

        return UnitDriver(made, polls, by.loop, by.emit)


def _listener(
    settings: ListenSettings, loop: asyncio.AbstractEventLoop, emit: Emit, ring: Ring, contexts: TlsStore
) -> Listener:
    why_no_route = "no such unit"
    if settings.line:
        why_no_route += f": {settings.name} leads to line {settings.line} only"
    entry = _entry_point(settings)
    if settings.tls is not None:
        return TlsListener(settings, CertifiedRouter(entry, loop.time, emit, why_no_route, ring), emit, contexts)
    router = Router(entry, loop.time, emit, why_no_route, ring)
    return (UdpListener if settings.scheme == "udp" else TcpListener)(settings, router, emit)


def _entry_point(settings: ListenSettings) -> EntryPoint:
    kinds: dict[str, Literal["certified", "datagram", "connection"]] = {"tls": "certified", "udp": "datagram"}
    kind = kinds.get(settings.scheme, "connection")
    return EntryPoint(settings.name, kind, settings.unit0 if isinstance(settings.unit0, int) else None)
