"""The settings of every part of a gateway. What reads and checks a config is not needed to know them."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar, Final, Literal, NamedTuple

from gateway.config.values.address import Address
from gateway.config.values.broker import PREFIX, Broker, Sparkplug
from gateway.config.values.duration import DEFAULT_RING
from gateway.config.values.reserved_names import FLEET, MQTT, WEB
from gateway.config.values.unitset import show_units
from gateway.devices.device import DeviceSettings
from gateway.images.image import ImageSettings
from gateway.images.polls import MirrorSettings
from gateway.images.virtual.settings import VirtualSettings
from gateway.lines.settings import LineSettings
from gateway.listeners.sessions.server_line import ServerSettings
from gateway.listeners.settings import ListenSettings
from gateway.modbus.codes import BROADCAST_UNIT
from gateway.ports.port import PortSettings, SerialSettings, SiteSettings, TcpSettings
from gateway.profiles.point import Point
from gateway.profiles.published import PublishedDevice
from gateway.routing.access import DEFAULT_ROWS, AccessRow, Network
from gateway.timing.budget import Budget, ServerBudget
from gateway.tls.settings import ClientTls, SecretFile, Secured, ServerTls
from gateway.upstreams.settings import UpstreamSettings

#: The listener without any [[listen]].
DEFAULT_LISTENER: Final = ListenSettings(name="default", host="127.0.0.1", port=5020)

#: The latency of adapter and driver, until the port is open and has determined it.
ASSUMED_LATENCY: Final = 0.005
#: How long what was written may be under way to a device server that others use too, in seconds. TCP repeats what is
#: lost after a fifth of a second, and again.
SHARED_ARRIVES_WITHIN: Final = 1.0


@dataclass(frozen=True, slots=True)
class LeasePlan:
    """The lease of a line, for the gateway of this `site`.

    It lasts `ttl` seconds; `fallback` is what its holder does when it cannot reach NATS.
    """

    name: str
    site: str
    ttl: float = 5.0
    fallback: Literal["release", "hold"] = "release"


def _known_latency(port: PortSettings) -> float:
    latency = ASSUMED_LATENCY if port.latency is None else port.latency
    return latency + port.driver_delay if isinstance(port, SerialSettings) else latency


@dataclass(frozen=True, slots=True)
class _WithDevices:
    """A line with devices: its port, its settings, and the devices."""

    port: PortSettings
    line: LineSettings
    devices: tuple[DeviceSettings, ...] = ()

    @property
    def name(self) -> str:
        """The name of the line."""
        return self.line.name

    @property
    def latency(self) -> float:
        """Give the latency of the port, as far as it is known before the port is open."""
        return _known_latency(self.port)

    @property
    def budget(self) -> Budget:
        """Give what the time limits of its devices are computed with."""
        return Budget(self.line.timing, self.latency)


@dataclass(frozen=True, slots=True)
class LinePlan(_WithDevices):
    """A client line. With a `lease` gateways ask there in turn."""

    #: No device is configured: all units without another destination are passed through.
    passes_through: bool = False
    #: Units that only the listeners for this line lead to.
    own_units: frozenset[int] = frozenset()
    lease: LeasePlan | None = None

    @property
    def meaning(self) -> "LinePlan":
        """Give what a reload compares. A pass-through line is unchanged if other tables take some of its units."""
        if not self.passes_through:
            return self
        devices = tuple(replace(each, unit=0, known_as=0, name="") for each in self.devices[:1])
        return replace(self, devices=devices, own_units=frozenset())

    @property
    def shared(self) -> tuple[DeviceSettings, ...]:
        """List the devices that more than the listeners for this line lead to: general ones, or their names."""
        return tuple(device for device in self.devices if device.known_as not in self.own_units)

    @property
    def addresses(self) -> frozenset[int]:
        """Give the unit identifiers of a listener for this line."""
        return frozenset(device.unit for device in self.devices) - {BROADCAST_UNIT}

    @property
    def broadcasts(self) -> frozenset[int]:
        """Find the functions that at least one device carries out as a broadcast; none if the line accepts none."""
        if not self.line.broadcast:
            return frozenset()
        return frozenset().union(*(device.profile.broadcasts for device in self.devices))


@dataclass(frozen=True, slots=True)
class UpstreamPlan:
    """Another Modbus TCP server, or the gateway of another site: its address, its settings, and the units behind it."""

    port: TcpSettings | SiteSettings
    upstream: UpstreamSettings
    devices: tuple[DeviceSettings, ...]
    #: Other addresses of the same server.
    others: tuple[TcpSettings, ...] = ()
    #: What its other units have in common, and their names if there are listeners for it, which lead to them. The
    #: connection is the same without.
    usual: DeviceSettings | None = None
    unlisted: Mapping[int, str] = field(default_factory=dict, compare=False)

    @property
    def name(self) -> str:
        """The name of the upstream."""
        return self.upstream.name

    @property
    def unnamed(self) -> Iterator[DeviceSettings]:
        """Describe the units that the config does not name: hundreds of upstreams would have too many to keep."""
        return map(self.unlisted_unit, self.unlisted)

    def unlisted_unit(self, unit: int) -> DeviceSettings:
        """Describe one of the units that the config does not name."""
        assert self.usual is not None  # noqa: S101 - every config gives it
        return replace(self.usual, name=self.unlisted[unit], unit=unit, known_as=unit, source=self.upstream.source)

    @property
    def budget(self) -> ServerBudget:
        """Give what the time limits of its devices are computed with."""
        return ServerBudget()


class MonitorPlan(_WithDevices):
    """A line on which the gateway only listens, and whose devices others ask."""

    __slots__ = ()


#: A part that has devices.
OwnerPlan = LinePlan | UpstreamPlan | MonitorPlan


@dataclass(frozen=True, slots=True)
class ServerPlan:
    """A server line: its port, its settings, and the recipients of its broadcasts. Perhaps it serves all units."""

    port: PortSettings
    line: ServerSettings
    broadcast_to: Literal["images", "all", "none"]
    serves_all: bool = False

    @property
    def latency(self) -> float:
        """Give the latency of the port, as far as it is known before the port is open."""
        return _known_latency(self.port)


@dataclass(frozen=True, slots=True)
class LogSettings:
    """The level and the format of the log."""

    level: Literal["debug", "info", "warning", "error"] = "info"
    format: Literal["auto", "console", "json", "journald"] = "auto"


class UsualRight(NamedTuple):
    """What clients of an add-on may do until a row of `[[access]]` names it, in words."""

    clients: str
    units: str
    may: str


@dataclass(frozen=True, slots=True)
class WebPlan:
    """Where the gateway answers over HTTP, by which names, and the files that say who is let in.

    Requests of a `proxy` name their user themselves. Operators may `write` if that is set. The `history` is kept over a
    restart. Trends of points are kept for `values` seconds.
    """

    #: Whether a change of it applies after a restart only.
    needs_restart: ClassVar[bool] = True
    bind: Address
    hosts: tuple[str, ...]
    token: str | None
    users: str | None = None
    tls: ServerTls | None = None
    proxy: tuple[Network, ...] = ()
    write: bool = False
    history: bool = True
    values: float = 0.0
    source: str = field(default="", compare=False)

    @property
    def secured(self) -> tuple[Secured, ...]:
        """Give its address, if it is https://."""
        return () if self.tls is None else (Secured(WEB, self.source, self.tls),)

    @property
    def usual_rights(self) -> tuple[UsualRight, ...]:
        """Say who may do what without a row of `[[access]]` that names it."""
        operators = (UsualRight("operators", "all", "read, write"),) if self.write else ()
        return (*operators, UsualRight("other users of the page", "all", "read"))


@dataclass(frozen=True, slots=True)
class MqttPlan:
    """Where values are published, and which. `home_assistant` is the prefix of its discovery; None without.

    With `write`, points are written from there. Topics begin with `prefix`. What cannot be published is kept on disk:
    at most `keep` bytes, written every `keep_every` seconds; nothing if `keep` is 0. `source` is its place in the
    config. Patterns mean devices in `heard` too, which are not published because only others ask them.
    """

    needs_restart: ClassVar[bool] = False
    site: str
    broker: Broker
    devices: tuple[PublishedDevice, ...]
    user: str | None = None
    password: SecretFile | None = None
    tls: ClientTls | None = None
    write: bool = False
    prefix: str = PREFIX
    keep: int = 0
    keep_every: float = 10.0
    home_assistant: str | None = None
    sparkplug: Sparkplug | None = None
    source: str = field(default="", compare=False)
    heard: tuple[str, ...] = field(default=(), compare=False)

    @property
    def secured(self) -> tuple[Secured, ...]:
        """Give the broker, if the connection is one of TLS."""
        return () if self.tls is None else (Secured(MQTT, self.source, self.tls),)

    @property
    def usual_rights(self) -> tuple[UsualRight, ...]:
        """Say who may do what without a row of `[[access]]` that names it."""
        units = show_units(device.unit for device in self.devices if device.on_the_wire is None)
        named = sum(device.on_the_wire is not None for device in self.devices)
        units = ", ".join(filter(None, (units, f"{named} by name" if named else "")))
        return (UsualRight("the broker", units, "read, write" if self.write else "read"),)


@dataclass(frozen=True, slots=True)
class FleetPlan:
    """Where NATS is, and how the gateway of this `site` logs in.

    A lease lasts `lease` seconds. `source` is its place in the config.
    """

    needs_restart: ClassVar[bool] = False
    site: str
    servers: tuple[Address, ...]
    user: str | None = None
    password: SecretFile | None = None
    credentials: SecretFile | None = None
    tls: ClientTls | None = None
    lease: float = 5.0
    fallback: Literal["release", "hold"] = "release"
    source: str = field(default="", compare=False)

    @property
    def secured(self) -> tuple[Secured, ...]:
        """Give the servers, if the connection is one of TLS."""
        return () if self.tls is None else (Secured(FLEET, self.source, self.tls),)

    @property
    def usual_rights(self) -> tuple[UsualRight, ...]:
        """Say who may do what without a row of `[[access]]` that names it."""
        return (UsualRight("other sites", "all", "read"),)


@dataclass(frozen=True, slots=True)
class Plan:
    """The settings of every part of a gateway."""

    site: str = ""
    listeners: tuple[ListenSettings, ...] = (DEFAULT_LISTENER,)
    lines: tuple[LinePlan, ...] = ()
    servers: tuple[ServerPlan, ...] = ()
    upstreams: tuple[UpstreamPlan, ...] = ()
    monitors: tuple[MonitorPlan, ...] = ()
    images: tuple[ImageSettings, ...] = ()
    mirrors: tuple[MirrorSettings, ...] = ()
    virtual: tuple[VirtualSettings, ...] = ()
    access: tuple[AccessRow, ...] = DEFAULT_ROWS
    log: LogSettings = LogSettings()
    #: What the coils and registers of a unit mean. Units without points are not here.
    points: Mapping[int, tuple[Point, ...]] = field(default_factory=dict)
    #: Where the control socket is; None for the usual place.
    control: str | None = None
    web: WebPlan | None = None
    mqtt: MqttPlan | None = None
    fleet: FleetPlan | None = None
    #: How many bytes the ring of `trace` has; 0 for none.
    ring: int = DEFAULT_RING

    @property
    def owners(self) -> "tuple[OwnerPlan, ...]":
        """The lines, upstreams and monitor lines: the parts that have devices."""
        return (*self.lines, *self.upstreams, *self.monitors)

    @property
    def shared(self) -> tuple[DeviceSettings, ...]:
        """List the devices that not only the listeners for their line lead to."""
        on_lines = (device for line in self.lines for device in line.shared)
        others: tuple[OwnerPlan, ...] = (*self.upstreams, *self.monitors)
        return (*on_lines, *(device for part in others for device in part.devices))

    @property
    def heard_on(self) -> Mapping[str, str]:
        """Find the devices that only others ask, each with the name of its monitor line."""
        return {device.name: monitor.name for monitor in self.monitors for device in monitor.devices}

    @property
    def add_ons(self) -> Mapping[str, WebPlan | MqttPlan | FleetPlan]:
        """Give the settings of the add-ons that the config asks for, by the names that `[[access]]` has for them."""
        named = ((WEB, self.web), (MQTT, self.mqtt), (FLEET, self.fleet))
        return {name: part for name, part in named if part is not None}

    @property
    def has_kept_images(self) -> bool:
        """Whether an image outlives the process."""
        return any(image.persist != "never" for image in (*self.images, *(each.own for each in self.virtual)))

    @property
    def secured(self) -> tuple[Secured, ...]:
        """Give every address that TLS secures, but for web page, broker and NATS: without these, all else works."""
        listeners = ((f"listen {one.name}", one.source, one.tls) for one in self.listeners)
        servers = (
            (one, port) for one in self.upstreams for port in (one.port, *one.others) if isinstance(port, TcpSettings)
        )
        upstreams = ((f"upstream {one.upstream.name}", one.upstream.source, port.tls) for one, port in servers)
        every = (*listeners, *upstreams)
        return tuple(Secured(name, source, tls) for name, source, tls in every if tls is not None)
