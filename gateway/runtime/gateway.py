"""A gateway: the parts that one plan asks for, and the routes between them. Another plan makes another one."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple, Union

from gateway.config.plan.settings import Plan
from gateway.devices.device import Device
from gateway.images.drivers.unit_driver import UnitDriver
from gateway.images.image import Image
from gateway.images.mirror import Mirror
from gateway.images.persistent import PersistentImage
from gateway.images.virtual.unit import VirtualUnit
from gateway.lines.driver import LineDriver
from gateway.lines.monitor.driver import MonitorDriver
from gateway.listeners.programs import ProgramListener
from gateway.listeners.serial import SerialListener
from gateway.listeners.tcp import TcpListener
from gateway.listeners.udp import UdpListener
from gateway.request import NamedTarget
from gateway.routing.access import KnownAs
from gateway.routing.router import Router
from gateway.runtime.gateway_line import GatewayLine
from gateway.runtime.gateway_monitor import GatewayMonitor
from gateway.runtime.gateway_server import GatewayServer
from gateway.runtime.gateway_upstream import GatewayUpstream
from gateway.upstreams.driver import TcpDriver

if TYPE_CHECKING:
    from gateway.fleet.asker import Asker

#: A listener of any protocol.
Listener = TcpListener | UdpListener

#: A part that has devices.
Owner = GatewayLine | GatewayUpstream | GatewayMonitor
#: A part that keeps a port or a connection open.
Part = Owner | GatewayServer
#: The driver of a part. That of a site is loaded only if needed.
Driver = Union[LineDriver, TcpDriver, SerialListener, ProgramListener, MonitorDriver, "Asker"]


class Reach(NamedTuple):
    """The units that clients reach: what answers for each, and which units it is for access rows without listeners."""

    routes: Mapping[int, NamedTarget]
    known_as: KnownAs


NOWHERE: Final = Reach({}, ())


@dataclass(frozen=True, kw_only=True)
class Gateway:
    """All parts of a gateway, in the order of the config: `lines` are client lines, `servers` are server lines.

    `devices` are those of each line. `everywhere` is what clients reach that use neither a listener nor a server line;
    `routings` is what those of each listener and server line reach. They apply after `Running.apply`.
    """

    plan: Plan
    listeners: tuple[Listener, ...] = ()
    lines: tuple[GatewayLine, ...] = ()
    servers: tuple[GatewayServer, ...] = ()
    upstreams: tuple[GatewayUpstream, ...] = ()
    monitors: tuple[GatewayMonitor, ...] = ()
    images: tuple[Image, ...] = ()
    mirrors: tuple[UnitDriver[Mirror], ...] = ()
    virtual: tuple[UnitDriver[VirtualUnit], ...] = ()
    devices: tuple[dict[int, Device], ...] = ()
    everywhere: Reach = NOWHERE
    routings: tuple[tuple[Router, Reach], ...] = ()

    @property
    def parts(self) -> tuple[Part, ...]:
        """All parts that keep a port or a connection open."""
        return (*self.lines, *self.servers, *self.upstreams, *self.monitors)

    @property
    def owners(self) -> tuple[Owner, ...]:
        """The lines, upstreams and monitor lines: the parts that have devices."""
        return (*self.lines, *self.upstreams, *self.monitors)

    @property
    def polling_units(self) -> tuple[UnitDriver[Mirror] | UnitDriver[VirtualUnit], ...]:
        """The units whose reads are answered from polls."""
        return (*self.mirrors, *self.virtual)

    @property
    def tables(self) -> tuple[Image, ...]:
        """The images, and the own registers of virtual units."""
        return (*self.images, *(driver.unit.own for driver in self.virtual))

    @property
    def longest_waits(self) -> Mapping[str, float]:
        """The longest wait for each unit, in seconds, by its name."""
        waits = {name: wait for owner in self.owners for name, wait in owner.longest_wait.items()}
        waits |= {image.name: image.settings.longest_wait for image in self.images}
        through = {
            each.name: max((waits.get(name, 0.0) for name in each.pollers), default=0.0) for each in self.polling_units
        }
        return waits | through

    def load_images(self) -> None:
        """Let new persistent images load the values saved under their names."""
        for image in self.tables:
            if isinstance(image, PersistentImage):
                image.start()

    def adopt_plan(self) -> None:
        """Give each part its table of the plan: a reused part may be elsewhere in the file now."""
        for line, line_plan, devices in zip(self.lines, self.plan.lines, self.devices, strict=True):
            line.adopt(line_plan, devices)
        for server, server_plan in zip(self.servers, self.plan.servers, strict=True):
            server.adopt(server_plan)
        for upstream, upstream_plan in zip(self.upstreams, self.plan.upstreams, strict=True):
            upstream.adopt(upstream_plan)
        for monitor, monitor_plan in zip(self.monitors, self.plan.monitors, strict=True):
            monitor.adopt(monitor_plan)
        for listener, settings in zip(self.listeners, self.plan.listeners, strict=True):
            listener.settings = settings
        for image, image_settings in zip(self.images, self.plan.images, strict=True):
            image.settings = image_settings
        for driver, mirror_settings in zip(self.mirrors, self.plan.mirrors, strict=True):
            driver.unit.settings = mirror_settings
        for virtual, virtual_settings in zip(self.virtual, self.plan.virtual, strict=True):
            virtual.unit.settings = virtual_settings
            virtual.unit.own.settings = virtual_settings.own
