"""Builds the parts of a gateway from a plan; nothing else does."""

import asyncio
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, NamedTuple, Union

from gateway.config.plan import LinePlan, Plan, ServerPlan, UpstreamPlan
from gateway.config.reserved import CONTROL, FLEET, MQTT, WEB
from gateway.devices.device import Device
from gateway.events import Emit
from gateway.images.image import Image, ImageSettings
from gateway.images.mirror_driver import MirrorDriver
from gateway.images.persistent import PersistentImage
from gateway.images.polls import MirrorSettings
from gateway.images.self_image import SelfImage
from gateway.images.store import Store
from gateway.lines.driver import LineDriver
from gateway.listeners.serial import SerialListener
from gateway.listeners.session import ListenSettings
from gateway.listeners.tcp import TcpListener
from gateway.listeners.tls import TlsListener
from gateway.listeners.udp import UdpListener
from gateway.modbus.codes import BROADCAST_UNIT
from gateway.ports.port import Opener, OpenPort, SiteSettings
from gateway.request import NamedTarget
from gateway.routing.access import EntryPoint, KnownAs, Rights
from gateway.routing.broadcast import Broadcast, Recipient
from gateway.routing.router import Router
from gateway.service.fleet import Fleet
from gateway.service.parts import GatewayLine, GatewayServer, GatewayUpstream
from gateway.service.plant import Publishing
from gateway.service.reach import Reach, everything, one_line
from gateway.service.state import Memory
from gateway.tls.store import TlsStore
from gateway.trace.ring import Ring
from gateway.upstreams.tcp_driver import TcpDriver

if TYPE_CHECKING:
    from gateway.fleet.asker import Asker

#: A listener of any protocol.
Listener = TcpListener | UdpListener

#: A part that keeps a port or a connection open.
Part = GatewayLine | GatewayUpstream | GatewayServer
#: What drives one. The one of a site is loaded only for it.
Driver = Union[LineDriver, TcpDriver, SerialListener, "Asker"]


class Way(NamedTuple):
    """A router, its routes, and the units for access rows that name no listener."""

    router: Router
    routes: Mapping[int, NamedTarget]
    known_as: KnownAs


@dataclass(frozen=True)
class Gateway:
    """All parts of a gateway, in the order of the config: `lines` are client lines, `servers` are server lines.

    `ways` are the routes of each router, `devices` those of each line. They apply after `route` was called.
    `ring` keeps the last transactions; a reload keeps it.
    """

    listeners: tuple[Listener, ...]
    lines: tuple[GatewayLine, ...]
    servers: tuple[GatewayServer, ...]
    upstreams: tuple[GatewayUpstream, ...]
    images: tuple[Image, ...]
    mirrors: tuple[MirrorDriver, ...]
    devices: tuple[dict[int, Device], ...]
    #: The router of the control socket: it has all rights until a row names it.
    control: Router
    #: The way of requests over HTTP: it too has all rights until a row names it. What a user may is seen to before.
    web: Router
    #: The way of what a broker delivers: it has all rights until a row names it. What may be written is seen to before.
    mqtt: Router
    #: The way of requests from other sites: they only read until a row names it.
    sites: Router
    ways: tuple[Way, ...]
    ring: Ring
    plan: Plan
    #: What is published at a broker, by this gateway or the one before a reload.
    publishing: Publishing
    #: The connection to the other sites, likewise.
    fleet: Fleet
    #: The certificates in use.
    contexts: TlsStore = field(default_factory=TlsStore)

    @property
    def parts(self) -> tuple[Part, ...]:
        """All parts that keep a port or a connection open."""
        return (*self.lines, *self.servers, *self.upstreams)

    def route(self) -> None:
        """Apply the routes and rights of the plan to all requests, and its file and lines to events.

        Persistent images now load the values of those with the same name.
        """
        self.ring.resize(self.plan.ring)
        for image in self.images:
            if isinstance(image, PersistentImage):
                image.start()
        for way in self.ways:
            way.router.routes = dict(way.routes)
            way.router.rights = Rights(self.plan.access, way.router.entry, way.known_as)
        for line, line_plan, devices in zip(self.lines, self.plan.lines, self.devices, strict=True):
            line.adopt(line_plan, devices)
        for server, server_plan in zip(self.servers, self.plan.servers, strict=True):
            server.plan = server_plan
        for upstream, upstream_plan in zip(self.upstreams, self.plan.upstreams, strict=True):
            upstream.adopt(upstream_plan)
        for listener, settings in zip(self.listeners, self.plan.listeners, strict=True):
            listener.settings = settings
        for image, image_settings in zip(self.images, self.plan.images, strict=True):
            image.settings = image_settings
        for driver, mirror_settings in zip(self.mirrors, self.plan.mirrors, strict=True):
            driver.mirror.settings = mirror_settings


def build(
    plan: Plan,
    loop: asyncio.AbstractEventLoop,
    opener: Opener,
    memory: Memory,
    emit: Emit,
    store: Store | None = None,
    running: Gateway | None = None,
    contexts: TlsStore | None = None,
) -> Gateway:
    """Build the parts of `plan` without starting them: nothing is opened, and the new routes do not apply yet.

    Persistent images need a `store`, and TLS listeners `contexts`. Parts of the `running` gateway that are the same in
    `plan` are reused.
    """
    old, ring, contexts = _Old(running), running.ring if running else Ring(), contexts or TlsStore()
    sites = running.sites if running else Router(EntryPoint(FLEET, "site"), loop.time, emit, ring=ring)
    fleet = running.fleet if running else Fleet(sites, emit, contexts)
    lines = tuple(
        old.line(one) or GatewayLine(one, loop, opener, memory, emit, ring, fleet.bucket) for one in plan.lines
    )
    upstreams = tuple(
        old.upstream(one) or GatewayUpstream(one, loop, _way_to(one, opener, fleet), emit, ring)
        for one in plan.upstreams
    )
    servers = tuple(old.server(one) or GatewayServer(one, loop, opener, emit, ring) for one in plan.servers)
    listeners = tuple(old.listener(one) or _listener(one, loop, emit, ring, contexts) for one in plan.listeners)
    images = tuple(old.image(one) or _image(one, store, emit, ring) for one in plan.images)
    on_lines = tuple(line.devices_of(one) for line, one in zip(lines, plan.lines, strict=True))
    devices = [device for units in (*on_lines, *(one.devices for one in upstreams)) for device in units.values()]
    named = {device.name: device for device in devices}
    mirrors = tuple(
        old.mirror(one, named[one.of]) or MirrorDriver(one, named[one.of], loop, emit, ring) for one in plan.mirrors
    )
    targets: dict[int, NamedTarget] = {image.settings.unit: image for image in images}
    for units, line_plan in zip(on_lines, plan.lines, strict=True):
        targets |= {unit: device for unit, device in units.items() if unit not in line_plan.own_units}
    for upstream in upstreams:
        targets |= upstream.devices
    targets |= {driver.mirror.settings.unit: driver for driver in mirrors}
    on_line = [Recipient(line.every_device, one.broadcasts) for line, one in zip(lines, plan.lines, strict=True)]
    everyone = everything(targets, [*on_line, *map(_recipient, images)])
    alone = {
        one.line.name: one_line(units.values(), recipient, targets)
        for one, units, recipient in zip(plan.lines, on_lines, on_line, strict=True)
    }
    control = running.control if running else Router(EntryPoint(CONTROL, "local"), loop.time, emit, ring=ring)
    web = running.web if running else Router(EntryPoint(WEB, "local"), loop.time, emit, ring=ring)
    mqtt = running.mqtt if running else Router(EntryPoint(MQTT, "local"), loop.time, emit, ring=ring)
    publishing = running.publishing if running else Publishing(emit, contexts)
    ways = (
        Way(mqtt, everyone.routes, everyone.known_as),
        Way(sites, everyone.routes, everyone.known_as),
        Way(control, everyone.routes, everyone.known_as),
        Way(web, everyone.routes, everyone.known_as),
        *(_way(one, alone[one.settings.line] if one.settings.line else everyone, ring) for one in listeners),
        *(Way(one.router, _served(everyone, one.plan, ring), everyone.known_as) for one in servers),
    )
    return Gateway(
        listeners,
        lines,
        servers,
        upstreams,
        images,
        mirrors,
        on_lines,
        control,
        web,
        mqtt,
        sites,
        ways,
        ring,
        plan,
        publishing,
        fleet,
        contexts,
    )


class _Old:
    """The parts of a running gateway that can be reused for unchanged tables."""

    def __init__(self, running: Gateway | None) -> None:
        self._lines = {one.name: one for one in running.lines} if running else {}
        self._servers = {one.name: one for one in running.servers} if running else {}
        self._upstreams = {one.name: one for one in running.upstreams} if running else {}
        self._listeners = {one.settings.name: one for one in running.listeners} if running else {}
        self._images = {one.settings.name: one for one in running.images} if running else {}
        self._mirrors = {one.mirror.settings.name: one for one in running.mirrors} if running else {}

    def line(self, plan: LinePlan) -> GatewayLine | None:
        old = self._lines.get(plan.line.name)
        return old if old is not None and old.means(plan) else None

    def server(self, plan: ServerPlan) -> GatewayServer | None:
        old = self._servers.get(plan.line.name)
        return old if old is not None and old.plan == plan else None

    def upstream(self, plan: UpstreamPlan) -> GatewayUpstream | None:
        old = self._upstreams.get(plan.upstream.name)
        return old if old is not None and old.plan == plan else None

    def listener(self, settings: ListenSettings) -> Listener | None:
        old = self._listeners.get(settings.name)
        return old if old is not None and old.settings == settings else None

    def image(self, settings: ImageSettings) -> Image | None:
        old = self._images.get(settings.name)
        return old if old is not None and old.settings == settings else None

    def mirror(self, settings: MirrorSettings, device: Device) -> MirrorDriver | None:
        """A mirror is rebuilt if its device was."""
        old = self._mirrors.get(settings.name)
        return old if old is not None and old.mirror.settings == settings and old.device is device else None


def _way_to(upstream: UpstreamPlan, opener: Opener, fleet: Fleet) -> OpenPort:
    port = upstream.port
    return fleet.opener(port.site) if isinstance(port, SiteSettings) else opener(port)


def _image(settings: ImageSettings, store: Store | None, emit: Emit, ring: Ring) -> Image:
    if settings.shows_gateway:
        return SelfImage(settings, emit, ring)
    if settings.persist == "never":
        return Image(settings, emit, ring)
    assert store is not None  # noqa: S101 - required for plans with persistent images
    store.open()
    return PersistentImage(settings, store, emit, ring)


def _listener(
    settings: ListenSettings, loop: asyncio.AbstractEventLoop, emit: Emit, ring: Ring, contexts: TlsStore
) -> Listener:
    why_no_route = "no such unit"
    if settings.line:
        why_no_route += f": {settings.name} leads to line {settings.line} only"
    router = Router(_entry_point(settings), loop.time, emit, why_no_route, ring)
    if settings.tls is not None:
        return TlsListener(settings, router, emit, contexts)
    return (UdpListener if settings.scheme == "udp" else TcpListener)(settings, router, emit)


def _entry_point(settings: ListenSettings) -> EntryPoint:
    kinds: dict[str, Literal["certified", "datagram", "connection"]] = {"tls": "certified", "udp": "datagram"}
    kind = kinds.get(settings.scheme, "connection")
    return EntryPoint(settings.name, kind, settings.unit0 if isinstance(settings.unit0, int) else None)


def _recipient(image: Image) -> Recipient:
    return Recipient(image, image.settings.profile.broadcasts)


def _served(reach: Reach, server: ServerPlan, ring: Ring) -> dict[int, NamedTarget]:
    """The routes of a server line: the units that it serves, and as unit 0 the recipients of its broadcasts."""
    served = {unit: reach.routes[unit] for unit in server.line.serves}
    images = [_recipient(target) for target in served.values() if isinstance(target, Image)]
    recipients = {"images": images, "all": reach.recipients, "none": []}[server.broadcast_to]
    return {**served, BROADCAST_UNIT: Broadcast(recipients, ring)}


def _way(listener: Listener, reach: Reach, ring: Ring) -> Way:
    """The routes of a listener; unit 0 is refused, goes to all recipients of broadcasts, or to another unit."""
    routes, unit0 = reach.routes, listener.settings.unit0
    if unit0 == "broadcast":
        routes = {**routes, BROADCAST_UNIT: Broadcast(reach.recipients, ring)}
    elif unit0 != "refuse":
        routes = {**routes, BROADCAST_UNIT: routes[unit0]}
    return Way(listener.router, routes, reach.known_as)
