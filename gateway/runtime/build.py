"""Builds the parts of a gateway from a plan; nothing else does."""

import asyncio
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal, Union

from gateway.config.plan.settings import LinePlan, Plan, ServerPlan, UpstreamPlan
from gateway.config.values.reserved_names import CONTROL, FLEET, MQTT, WEB
from gateway.devices.device import Device
from gateway.events import Emit
from gateway.images.drivers.mirror_driver import MirrorDriver
from gateway.images.drivers.store import Store
from gateway.images.image import Image, ImageSettings
from gateway.images.persistent import PersistentImage
from gateway.images.polls import MirrorSettings
from gateway.images.self_image import SelfImage
from gateway.lines.driver import LineDriver
from gateway.listeners.serial import SerialListener
from gateway.listeners.settings import ListenSettings
from gateway.listeners.tcp import TcpListener
from gateway.listeners.tls import TlsListener
from gateway.listeners.udp import UdpListener
from gateway.ports.port import Opener, SiteSettings
from gateway.routing.access import EntryPoint, Rights
from gateway.routing.router import CertifiedRouter, Router
from gateway.runtime.fleet import Fleet
from gateway.runtime.parts import GatewayLine, GatewayServer, GatewayUpstream
from gateway.runtime.publishing import Publishing
from gateway.runtime.reach import Routing, routings
from gateway.state.memory import Memory
from gateway.tls.store import TlsStore
from gateway.trace.ring import Ring
from gateway.upstreams.driver import TcpDriver

if TYPE_CHECKING:
    from gateway.fleet.asker import Asker

#: A listener of any protocol.
Listener = TcpListener | UdpListener

#: A part that keeps a port or a connection open.
Part = GatewayLine | GatewayUpstream | GatewayServer
#: What drives one. The one of a site is loaded only for it.
Driver = Union[LineDriver, TcpDriver, SerialListener, "Asker"]


@dataclass(frozen=True, kw_only=True)
class Gateway:
    """All parts of a gateway, in the order of the config: `lines` are client lines, `servers` are server lines.

    `routings` are the routes of each router, `devices` those of each line. They apply after `route` was called.
    `ring` keeps the last transactions; a reload keeps it.
    """

    #: The router of the control socket: it has all rights until a row names it.
    control: Router
    #: That of requests over HTTP: it too has all rights until a row names it. What a user may is seen to before.
    web: Router
    #: That of what a broker delivers: it has all rights until a row names it. What may be written is seen to before.
    mqtt: Router
    #: That of requests from other sites: they only read until a row names it.
    sites: Router
    ring: Ring
    plan: Plan
    #: What is published at a broker, by this gateway or the one before a reload.
    publishing: Publishing
    #: The connection to the other sites, likewise.
    fleet: Fleet
    #: The certificates in use.
    contexts: TlsStore = field(default_factory=TlsStore)
    listeners: tuple[Listener, ...] = ()
    lines: tuple[GatewayLine, ...] = ()
    servers: tuple[GatewayServer, ...] = ()
    upstreams: tuple[GatewayUpstream, ...] = ()
    images: tuple[Image, ...] = ()
    mirrors: tuple[MirrorDriver, ...] = ()
    devices: tuple[dict[int, Device], ...] = ()
    routings: tuple[Routing, ...] = ()

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
        for router, routes, known_as in self.routings:
            router.routes = dict(routes)
            router.rights = Rights(self.plan.access, router.entry, known_as)
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
    contexts = contexts or TlsStore()
    before = running or _without_parts(plan, loop, emit, contexts)
    parts = _Parts(before, loop, opener, memory, emit, store, contexts)
    lines = tuple(map(parts.line, plan.lines))
    upstreams = tuple(map(parts.upstream, plan.upstreams))
    on_lines = tuple(line.devices_of(one) for line, one in zip(lines, plan.lines, strict=True))
    behind = (*on_lines, *(upstream.devices for upstream in upstreams))
    devices = {device.name: device for units in behind for device in units.values()}
    gateway = replace(
        before,
        listeners=tuple(map(parts.listener, plan.listeners)),
        lines=lines,
        servers=tuple(map(parts.server, plan.servers)),
        upstreams=upstreams,
        images=tuple(map(parts.image, plan.images)),
        mirrors=tuple(parts.mirror(one, devices[one.of]) for one in plan.mirrors),
        devices=on_lines,
        plan=plan,
        contexts=contexts,
    )
    return replace(gateway, routings=tuple(routings(gateway)))


def _without_parts(plan: Plan, loop: asyncio.AbstractEventLoop, emit: Emit, contexts: TlsStore) -> Gateway:
    """What every gateway has, and every reload keeps."""
    ring = Ring()

    def router(name: str, kind: Literal["local", "site"] = "local") -> Router:
        return Router(EntryPoint(name, kind), loop.time, emit, ring=ring)

    sites = router(FLEET, "site")
    return Gateway(
        control=router(CONTROL),
        web=router(WEB),
        mqtt=router(MQTT),
        sites=sites,
        ring=ring,
        plan=plan,
        publishing=Publishing(emit, contexts),
        fleet=Fleet(sites, emit, contexts),
    )


class _Parts:
    """Builds parts, or takes them from the gateway `before` where their tables are unchanged."""

    def __init__(
        self,
        before: Gateway,
        loop: asyncio.AbstractEventLoop,
        opener: Opener,
        memory: Memory,
        emit: Emit,
        store: Store | None,
        contexts: TlsStore,
    ) -> None:
        self._lines = {one.name: one for one in before.lines}
        self._servers = {one.name: one for one in before.servers}
        self._upstreams = {one.name: one for one in before.upstreams}
        self._listeners = {one.settings.name: one for one in before.listeners}
        self._images = {one.settings.name: one for one in before.images}
        self._mirrors = {one.mirror.settings.name: one for one in before.mirrors}
        self._ring = before.ring
        self._fleet = before.fleet
        self._loop = loop
        self._opener = opener
        self._memory = memory
        self._emit = emit
        self._store = store
        self._contexts = contexts

    def line(self, plan: LinePlan) -> GatewayLine:
        old = self._lines.get(plan.line.name)
        if old is not None and old.means(plan):
            return old
        return GatewayLine(plan, self._loop, self._opener, self._memory, self._emit, self._ring, self._fleet.bucket)

    def server(self, plan: ServerPlan) -> GatewayServer:
        old = self._servers.get(plan.line.name)
        if old is not None and old.plan == plan:
            return old
        return GatewayServer(plan, self._loop, self._opener, self._emit, self._ring)

    def upstream(self, plan: UpstreamPlan) -> GatewayUpstream:
        old = self._upstreams.get(plan.upstream.name)
        if old is not None and old.plan == plan:
            return old
        port = plan.port
        open_port = self._fleet.opener(port.site) if isinstance(port, SiteSettings) else self._opener(port)
        return GatewayUpstream(plan, self._loop, open_port, self._emit, self._ring)

    def listener(self, settings: ListenSettings) -> Listener:
        old = self._listeners.get(settings.name)
        if old is not None and old.settings == settings:
            return old
        return _listener(settings, self._loop, self._emit, self._ring, self._contexts)

    def image(self, settings: ImageSettings) -> Image:
        old = self._images.get(settings.name)
        if old is not None and old.settings == settings:
            return old
        if settings.shows_gateway:
            return SelfImage(settings, self._emit, self._ring)
        if settings.persist == "never":
            return Image(settings, self._emit, self._ring)
        assert self._store is not None  # noqa: S101 - required for plans with persistent images
        self._store.open()
        return PersistentImage(settings, self._store, self._emit, self._ring)

    def mirror(self, settings: MirrorSettings, device: Device) -> MirrorDriver:
        """A mirror is rebuilt if its device was."""
        old = self._mirrors.get(settings.name)
        if old is not None and old.mirror.settings == settings and old.device is device:
            return old
        return MirrorDriver(settings, device, self._loop, self._emit, self._ring)


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
