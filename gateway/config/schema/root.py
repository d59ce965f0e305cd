"""Every key of the config file: its type, its default, and what it means. docs/configuration.md is made from this."""

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import Field

from gateway.config.plan.plan import DEFAULT_LISTENER, DEFAULT_RING
from gateway.config.schema.fleet import Fleet
from gateway.config.schema.mqtt import Mqtt
from gateway.config.schema.profile import PointTable, ProfileTable
from gateway.config.schema.table import Count, FunctionNumber, Table
from gateway.config.schema.web import Web
from gateway.config.values.address import Address
from gateway.config.values.fleet import Site
from gateway.config.values.kinds import (
    CredentialFile,
    Duration,
    DurationOrAuto,
    DurationOrOffOrAuto,
    DurationOrZeroOrAuto,
    Format,
    IdleDuration,
    Item,
    LeaseName,
    ListenAddress,
    ListOf,
    LongerDuration,
    Name,
    NetworksOrSites,
    OtherServer,
    OwnUnit,
    Ranges,
    Role,
    SerialPort,
    Size,
    SocketPath,
    Unit0,
    Units,
    UnitsFrom0,
    UnitsOrAll,
)
from gateway.config.values.port import DEVICE_SERVER_MODES
from gateway.modbus.codes import FIRST_UNIT, LAST_UNIT, Area
from gateway.ports.port import Wire
from gateway.routing.access import Network


class Listen(Table):
    """An address where clients connect."""

    name: Name | None = Field(None, description="Its name in logs and in `[[access]]`. Default: the address.")
    bind: ListenAddress = Field(
        description="Protocol, host and port: `tcp://`, `tls://` ([Modbus/TCP Security](certificates.md)), "
        "`rtu+tcp://`, `ascii+tcp://` or `udp://`. Default port: 502, with `tls://` 802; none for RTU and ASCII over "
        "TCP. Port 0 uses a free one. "
        "`0.0.0.0` is every IPv4 address. `[::]` is every address, except IPv4 if another listener has an IPv4 address "
        "on the same port.",
    )
    clients: Count = Field(
        32,
        description="Maximum number of connections; with `udp://` of clients. When it is reached, a new client "
        "replaces one without a request in progress, in [this order](operations.md#when-a-listener-is-full).",
    )
    reserve: Annotated[int, Field(ge=0)] = Field(
        0,
        description="How many of `clients` are reserved for addresses that get rights by the `from` of an `[[access]]` "
        "row, with `tls://` for clients that get rights by their role; without `[[access]]`, for local clients.",
    )
    idle: IdleDuration = Field(
        600.0, description='Clients without a request for this time are disconnected (UDP: forgotten). `"0"`: never.'
    )
    in_flight: Count = Field(
        16,
        description="Requests in progress for each connection; at the limit the gateway stops reading. RTU and ASCII "
        "over TCP: one is in progress, and this many may wait. UDP: requests beyond the limit are answered 06.",
    )
    unit0: Unit0 = Field(
        "refuse",
        description='Requests to unit 0. `"refuse"`: answer 0A. A number: use that unit instead. `"broadcast"`: send '
        "a write once to every line that accepts broadcasts, and to the images, without a response (client tools "
        "report a time-out); answer a read with 01. With RTU and ASCII over TCP, unit 0 gets no response at all "
        "unless this is a number.",
    )
    on_failure: Literal["exception", "silent"] = Field(
        "exception",
        description="What a client gets instead of a device's response: exception 0A, 0B or 06, or nothing, as from a "
        "device that is switched off. Exceptions 01 to 03, and responses of units, are always sent. With RTU and ASCII "
        "over TCP, if one of several requests that were sent together gets no response, none of them does.",
    )

    line: Name | None = Field(
        None,
        description="Makes this a listener for one line: unit IDs are addresses on that line, regardless of "
        "`as`, and nothing else can be reached. If the line has no `devices`, 1-247 are passed through. "
        "`unit0`, and `[[access]]` rows that name this listener, use these addresses too.",
    )
    upstream: Name | None = Field(
        None,
        description="Makes this a listener for one upstream: clients use the unit IDs of that server, 0-255, "
        "regardless of `as`, and nothing else can be reached. Units that its `units` do not name are passed through. "
        "Unit 0 is a unit of the server, with a response. `[[access]]` rows that name this listener use these unit "
        "IDs too.",
    )
    certificate: CredentialFile | None = Field(
        None, description="With `tls://`: the file with the certificate and its chain (PEM)."
    )
    key: CredentialFile | None = Field(
        None, description="With `tls://`: the file with the private key (PEM); only its owner and group may read it."
    )
    clients_ca: CredentialFile | None = Field(
        None,
        description="With `tls://`: the file with the certificates of the authorities of clients (PEM).",
    )
    crl: CredentialFile | None = Field(
        None,
        description="With `tls://`: the file with the revocation list of each of these authorities (PEM). A list that "
        "has expired refuses every client.",
    )

    @property
    def label(self) -> str:
        """Its name, or its default name."""
        return self.name or str(self.bind)

    @property
    def only(self) -> str | None:
        """The name of the one line or upstream that it leads to; None for all units."""
        return self.line if self.line is not None else self.upstream


class Device(Table):
    """A device on a line, or several alike in one row."""

    units: UnitsFrom0 = Field(
        alias="unit",
        description="Its unit ID on the wire, 1-247; a set means several devices. 248-255 are reserved by the "
        "specification, but some devices have them. 0: for a single device with an unknown address; only its holding "
        "registers can be read.",
    )
    known_as: Units | None = Field(
        None,
        alias="as",
        description="Its unit ID for clients, 1-255; as many as in `unit`. Default: the same.",
    )
    name: Name | None = Field(
        None,
        description="Its name in logs; `*` stands for the unit ID for clients. Default: line name and unit ID.",
    )
    profile: str | None = Field(None, description="The kind of device. Default: the `profile` of the line.")
    priority: Literal["normal", "high"] = Field(
        "normal",
        description="Who waits for a device with high priority is the first in each round of those who wait for its "
        "line, like who waits with a write.",
    )
    timeout: Duration | None = Field(
        None, description="How long it may take to begin its response, regardless of its profile."
    )
    points: Annotated[tuple[PointTable, ...], ListOf] = Field(
        (), description="What its registers mean, in addition to the points of its profile."
    )

    @property
    def client_units(self) -> tuple[int, ...]:
        """The units that clients use for `units`, in the same order."""
        return self.units if self.known_as is None else self.known_as


class Line(Table):
    """A serial line: its port and settings, and its devices."""

    name: Name | None = Field(None, description="Its name in logs and metrics. Default: the last part of the port.")
    port: SerialPort = Field(
        description="The serial device, preferably by its name in `/dev/serial/by-id/`; or a device server in raw TCP "
        "mode: `rtu+tcp://host:port`, `ascii+tcp://host:port`, which sets the `mode` too. `baud` and `format` must "
        "then equal the settings of the server.",
    )
    mode: Literal["rtu", "ascii"] = Field("rtu", description="What is spoken on the line.")
    baud: Annotated[int, Field(ge=1, le=100_000_000)] = Field(
        19200, description="Any rate; 14400 and other odd ones are set as custom rates."
    )
    format: Format | None = Field(
        None, description="Data bits, parity, stop bits. Default: `8E1` for RTU, `7E1` for ASCII."
    )
    role: Literal["client", "server"] = Field(
        "client",
        description="`client`: the gateway polls the devices. `server`: the gateway answers a client on the line "
        "(HMI, PLC).",
    )
    rs485: Literal["adapter", "kernel"] = Field(
        "adapter", description="What controls the direction of an RS-485 line: the adapter, or the kernel (TIOCSRS485)."
    )
    echo: bool = Field(
        False,
        description="True if the adapter echoes what is sent; exactly that is then removed. With `wire` = `serial` an "
        "echo is detected and logged; with `direct` only on server lines.",
    )
    wire: Wire = Field(
        "auto",
        description="`serial`: there is a wire, so a response that arrives before the request can have been sent is "
        "rejected. `direct`: for a device without a wire (USB CDC, a virtual machine, a soft PLC), which may respond "
        "at once; an echo then cannot be told from the response to 05 or 06. `auto`: `direct` for virtual ports and "
        "device servers, otherwise `serial`, also for `ttyACM`, because some adapters use that name. If that is "
        "wrong, the log says `answer_too_early`.",
    )
    latency: DurationOrAuto = Field(
        None,
        description='The delay of a response by adapter and driver, at most. `"auto"`: 5 ms; USB adapters whose driver '
        "cannot be set to that, 20 ms; TCP, 100 ms.",
    )
    profile: str = Field(
        "generic", description="The profile of devices without their own, and of passed-through units."
    )
    timeout: Duration | None = Field(
        None,
        description="How long a device without its own profile may take to begin its response, for functions without a "
        "row in `timing`. Default: the `timeout` of `profile` (`generic`: 1 s).",
    )
    gap: DurationOrZeroOrAuto = Field(
        None,
        description="Silence before each request; on server lines, before each response. "
        '`"auto"`: the larger of t3.5 and the `idle_chars` of its devices, or of the units that it serves; '
        'none for ASCII. `"0"`: none.',
    )
    turnaround: DurationOrAuto = Field(
        None,
        description='Silence after a broadcast. `"auto"`: 100 ms, or `margin` x `timing` of the slowest device if '
        "longer.",
    )
    late_window: DurationOrAuto = Field(
        None,
        description="How long a late response is expected after a time-out or a damaged response. Until then no "
        "request with the same function is sent to that unit: it gets 0B at once, or waits if 250 ms or less are "
        'left. `"auto"`: twice the time limit of the request, or the longest time that the device may take for any '
        "request (its `timeout`, `margin` x its table) if that is more. With a time-out of 1 s, one lost response "
        "blocks that function of the unit for 2 s.",
    )
    queue: Count = Field(
        64,
        description="Maximum number of waiting requests. When it is exceeded, the client with most of them, by "
        "connection, then by address, gets 06 for its newest. Requests that share a transaction count separately.",
    )
    max_wait: LongerDuration = Field(2.0, description="A request that has waited longer is answered 06 and not sent.")
    retries: Annotated[int, Field(ge=0)] = Field(
        0,
        description="How often a read is repeated: at once after a damaged frame, after the late window when nothing "
        "came. Writes are never repeated.",
    )
    retry_within: DurationOrAuto = Field(
        None,
        description="The longest that a read with its repeats may take, counted from the first attempt. A repeat that "
        "cannot end by then is not sent: the client gets 0B at once. A repeat after silence needs at least limit + "
        'late window + limit. `max_wait` does not apply to repeats. `"auto"`: twice the sum of limit and late window, '
        "or more where that is too short for one repeat; `check` shows how long.",
    )
    rest: DurationOrOffOrAuto = Field(
        None,
        description='The longest back-off of a unit that does not answer. `"auto"`: one minute, or nine time limits if '
        'longer. With a short one, or `"off"`, a dead unit delays the other units more.',
    )
    coalesce: bool = Field(
        True,
        description="Waiting reads of different clients that are equal share one transaction. Reads of one client are "
        "sent one after the other.",
    )
    broadcast: bool = Field(True, description="Whether broadcasts go to this line too.")
    lease: LeaseName | None = Field(
        None,
        description="The name of a lease: of all gateways whose lines have it, one opens its port and sends requests. "
        "See [fleet](fleet.md).",
    )
    devices: Annotated[tuple[Device, ...], ListOf] | None = Field(
        None,
        description="Its devices. Without this key, every unit 1-247 is passed through if the line is the only one "
        "with `role` = `client`. If it is not, the key may be left out only if a `[[listen]]` names the line; only "
        "such listeners then lead to it.",
    )
    serves: Units | None = Field(
        None, description="Server lines: the units that the gateway answers for; others get no response."
    )
    on_failure: Literal["exception", "silent"] = Field(
        "exception",
        description="Server lines: what the client gets instead of a device's response, as in `[[listen]]`.",
    )
    answer_within: LongerDuration = Field(1.0, description="Server lines: a response that takes longer is not sent.")
    broadcast_to: Literal["images", "all", "none"] = Field(
        "images",
        description="Server lines: where broadcasts go: to the images that the line serves, also to every line that "
        "accepts broadcasts, or nowhere.",
    )

    @property
    def label(self) -> str:
        """Its name, or its default name."""
        return self.name or str(self.port).rstrip("/").rsplit("/", 1)[-1]

    @property
    def spoken(self) -> Literal["rtu", "ascii"]:
        """What is spoken on it: what the scheme of a device server says, else its `mode`."""
        return DEVICE_SERVER_MODES[self.port.scheme] if isinstance(self.port, Address) else self.mode

    def device_names(self, row: Device) -> list[str]:
        """What the devices of a row are called, in the order of its units."""
        if row.name is None:
            return [f"{self.label}/{unit}" for unit in row.client_units]
        return [row.name.replace("*", str(unit)) for unit in row.client_units]

    @property
    def all_device_names(self) -> list[str]:
        """What all its devices are called, those that nobody has named included."""
        if self.devices is None:
            return [f"{self.label}/{unit}" for unit in range(FIRST_UNIT, LAST_UNIT + 1)]
        return [name for row in self.devices for name in self.device_names(row)]


class Polled(Table):
    """A range of addresses that a mirror polls."""

    holding: Ranges | None = Field(None, description="Holding registers to read.")
    input: Ranges | None = Field(None, description="Input registers to read.")
    coils: Ranges | None = Field(None, description="Coils to read.")
    discrete: Ranges | None = Field(None, description="Discrete inputs to read.")
    every: LongerDuration = Field(description="Time from one poll to the next.")

    def ranges(self, area: Area) -> tuple[tuple[int, int], ...]:
        """The addresses of one area that it reads."""
        ranges: tuple[tuple[int, int], ...] | None = getattr(self, area)
        return ranges or ()


class InitialValues(Table):
    """Initial values from one address on."""

    at: Annotated[int, Field(ge=0, le=65535)] = Field(description="Address of the first value.")
    values: Annotated[tuple[Item, ...], ListOf] = Field(description="The values: 0-65535, or `true` and `false`.")


class Initial(Table):
    """Initial values of an image; all others are 0."""

    holding: Annotated[tuple[InitialValues, ...], ListOf] = Field((), description="Holding registers.")
    input: Annotated[tuple[InitialValues, ...], ListOf] = Field((), description="Input registers.")
    coils: Annotated[tuple[InitialValues, ...], ListOf] = Field((), description="Coils.")
    discrete: Annotated[tuple[InitialValues, ...], ListOf] = Field((), description="Discrete inputs.")

    def rows(self, area: Area) -> tuple[InitialValues, ...]:
        """The rows of one area."""
        rows: tuple[InitialValues, ...] = getattr(self, area)
        return rows


class Image(Table):
    """A unit that the gateway answers itself: a register image, or with `of` a mirror of a device."""

    unit: OwnUnit = Field(
        description="Its unit ID for clients, 1-247; or 255, which many Modbus TCP clients use for the server itself."
    )
    name: Name | None = Field(None, description="Its name in logs. Default: `image-` and the unit ID.")
    profile: str = Field("generic", description="What it accepts: functions, limits, addresses.")
    holding: Ranges = Field((), description="Its holding registers.")
    input: Ranges = Field((), description="Its input registers.")
    coils: Ranges = Field((), description="Its coils.")
    discrete: Ranges = Field((), description="Its discrete inputs.")
    persist: Literal["never", "interval", "always"] = Field(
        "never",
        description="`interval`: a crash loses at most 1 s of writes, a normal stop none. `always`: each write is on "
        "disk before it is acknowledged.",
    )
    initial: Initial = Field(
        Initial(), description="Initial values, such as `initial.holding = [{ at = 0, values = [1, 2, 3] }]`."
    )
    of: str | None = Field(
        None, description="Makes it a mirror: the name of the device to poll, once for any number of clients."
    )
    read: Annotated[tuple[Polled, ...], ListOf] = Field((), description="Mirrors: what to poll, and how often.")
    stale: LongerDuration = Field(2.0, description="Mirrors: older values are answered with exception 0B.")

    @property
    def label(self) -> str:
        """Its name, or its default name."""
        return self.name or f"image-{self.unit}"

    def ranges(self, area: Area) -> tuple[tuple[int, int], ...]:
        """The addresses of one area that exist."""
        ranges: tuple[tuple[int, int], ...] = getattr(self, area)
        return ranges


class UpstreamUnit(Table):
    """Units behind another server."""

    known_as: Units = Field(alias="as", description="Their unit IDs for clients, 1-255.")
    units: UnitsFrom0 = Field(alias="unit", description="The units that the other server knows.")


class Upstream(Table):
    """Another Modbus TCP server, and the units behind it."""

    name: Name | None = Field(None, description="Its name in logs. Default: the address.")
    to: OtherServer = Field(
        description="Its address: `tcp://`, or `tls://` for a server with Modbus/TCP Security. Default port: 502, with "
        "`tls://` 802. Or `fleet://SITE` for the gateway of another site, with [`[fleet]`](fleet.md)."
    )
    units: Annotated[tuple[UpstreamUnit, ...], ListOf] | None = Field(
        None,
        description="The units behind it. This key may be left out if a `[[listen]]` names the upstream; only such "
        "listeners then lead to it.",
    )
    timeout: Duration = Field(1.0, description="How long a response may take.")
    in_flight: Annotated[int, Field(ge=1, le=64)] = Field(
        16, description="Requests in progress at once; 1 for a server that can only handle one."
    )
    certificate: CredentialFile | None = Field(
        None, description="With `tls://`: the file with the certificate that the gateway shows, and its chain (PEM)."
    )
    key: CredentialFile | None = Field(
        None, description="With `tls://`: the file with its private key (PEM); only its owner and group may read it."
    )
    ca: CredentialFile | None = Field(
        None,
        description="With `tls://`: the file with the certificates of the authorities of the server (PEM).",
    )
    server_name: Name | None = Field(
        None,
        description="With `tls://`: the name or address in the certificate of the server. Default: the host in `to`.",
    )

    @property
    def label(self) -> str:
        """Its name, or its default name."""
        return self.name or str(self.to)

    @property
    def rows(self) -> tuple[UpstreamUnit, ...]:
        """The units that it names."""
        return self.units or ()

    def unit_names(self, row: UpstreamUnit) -> list[str]:
        """What the units of a row are called, in the order of its units."""
        return [f"{self.label}/{unit}" for unit in row.known_as]

    @property
    def unnamed(self) -> dict[int, str]:
        """The units of the server that no row names, and what they are called."""
        named = {unit for row in self.rows for unit in row.units}
        taken = {unit for row in self.rows for unit in row.known_as}
        return {
            unit: f"{self.label}/unit-{unit}" if unit in taken else f"{self.label}/{unit}"
            for unit in range(256)
            if unit not in named
        }


class Own(Table):
    """The state of the gateway as a unit with [registers](own-registers.md); without this table there is none."""

    unit: OwnUnit = Field(description="Its unit ID for clients, 1-247 or 255.")


class Access(Table):
    """Access rights. First match wins, by client and unit; no match means denied."""

    networks: NetworksOrSites | None = Field(
        None,
        alias="from",
        description='Networks or addresses of the clients; with `listen = ["fleet"]` the sites. Default: all.',
    )
    listen: Annotated[tuple[Name, ...], ListOf] | None = Field(
        None,
        description="Names of listeners, server lines, `control`, `web`, `mqtt` or `fleet`. Default: all. A server "
        "line, the control socket, the web page and the MQTT client keep their rights until a row names them. UDP "
        "clients can write only through a row that names their listener, other sites through one that names `fleet`. A "
        "row names either listeners for one line or upstream, or others.",
    )
    role: Role | None = Field(
        None,
        description='The role in the certificate of a TLS client; `""` for one without a role. For clients of `tls://` '
        "a row without this key counts only if it names the listener.",
    )
    units: UnitsOrAll = Field(
        "all",
        description="Unit IDs for clients, 1-255; in a row that names a listener for one line, addresses on "
        "that line, and in one that names a listener for one upstream, unit IDs of that server, 0-255. A broadcast "
        "needs the right at every unit.",
    )
    allow: Annotated[tuple[Literal["read", "write"], ...], ListOf] | None = Field(
        None,
        description="What is allowed; alternatively use `functions`. `read`: functions 1, 2, 3, 4, 7, 11, 12, 17, 20, "
        "24 and 43/14. `write`: all others. `[]`: nothing.",
    )
    functions: Annotated[tuple[FunctionNumber, ...], ListOf] | None = Field(
        None, description="Functions that are allowed, and no others."
    )

    @property
    def addresses(self) -> tuple[Network, ...]:
        """What `from` names, without sites."""
        return tuple(each for each in self.networks or () if not isinstance(each, Site))

    @property
    def sites(self) -> tuple[str, ...]:
        """The sites that `from` names."""
        return tuple(each.name for each in self.networks or () if isinstance(each, Site))


class Control(Table):
    """The control socket, which the commands use: `status`, `reload`, `read`, `trace` and others."""

    socket: SocketPath | None = Field(
        None,
        description="Its path. Default: `/run/modbus-gateway/control.sock`; without root "
        "`$XDG_RUNTIME_DIR/modbus-gateway/control.sock`, or `control.sock` beside the config if that is not set. "
        "[Commands](tools.md#which-gateway-a-command-speaks-to) find another path by `--config FILE` or "
        "`--control PATH`.",
    )


class Trace(Table):
    """The last transactions, which are always kept in memory: `modbus-gateway trace` shows them."""

    ring: Size = Field(
        DEFAULT_RING,
        description='How much memory they may take. `"0"`: none is kept, and there is nothing to show.',
    )


class Log(Table):
    """The log on standard error."""

    level: Literal["debug", "info", "warning", "error"] = Field("info", description="The lowest level that is written.")
    format: Literal["auto", "console", "json", "journald"] = Field(
        "auto",
        description="`console`: text. `json`: one object on each line. `journald`: systemd's journal, with a field for "
        "each field of an event. `auto`: `journald` under systemd, otherwise `console`.",
    )


class Config(Table):
    """A whole file."""

    site: str = Field(
        "",
        description="The name of the plant: in the titles of web pages, in the topics of `[mqtt]`, and its name in "
        "`[fleet]`.",
    )
    listen: Annotated[tuple[Listen, ...], ListOf] = ()
    line: Annotated[tuple[Line, ...], ListOf] = ()
    image: Annotated[tuple[Image, ...], ListOf] = ()
    upstream: Annotated[tuple[Upstream, ...], ListOf] = ()
    profile: Mapping[str, ProfileTable] = Field({})
    access: Annotated[tuple[Access, ...], ListOf] = ()
    own: Own | None = Field(None, alias="self")
    web: Web | None = None
    mqtt: Mqtt | None = None
    fleet: Fleet | None = None
    trace: Trace = Trace()
    control: Control | None = None
    log: Log = Log()

    @property
    def binds(self) -> tuple[tuple[Address, str], ...]:
        """Where clients can connect, each with its place in the file."""
        default = Address(DEFAULT_LISTENER.scheme, DEFAULT_LISTENER.host, DEFAULT_LISTENER.port)
        return tuple((each.bind, each.source) for each in self.listen) or ((default, "the default listener"),)

    @property
    def leads_everywhere(self) -> bool:
        """Whether a listener leads to all units; the one that is there without any does."""
        return not self.listen or any(listen.only is None for listen in self.listen)

    def listeners_for(self, part: Line | Upstream) -> list[Listen]:
        """The listeners that are for this line or upstream alone."""
        return [listen for listen in self.listen if listen.only == part.label]

    def is_apart(self, line: Line) -> bool:
        """Whether no other listeners lead to a client line: it has no devices, and is not the only one."""
        has_company = any(other.role == "client" and other is not line for other in self.line)
        return line.devices is None and has_company and bool(self.listeners_for(line))
