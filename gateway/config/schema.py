"""Every key of the config file: its type, its default, and what it means. docs/configuration.md is made from this."""

from collections.abc import Mapping
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, PrivateAttr

from gateway.config.address import Address
from gateway.config.problem import Path
from gateway.config.values import (
    DEVICE_SERVER_MODES,
    AnswerDuration,
    ClientUnit,
    ClientUnits,
    Duration,
    DurationOrAuto,
    DurationOrOffOrAuto,
    DurationOrZeroOrAuto,
    Format,
    IdleDuration,
    Item,
    Kind,
    Limits,
    ListenAddress,
    ListOf,
    LongerDuration,
    Name,
    Networks,
    Ranges,
    SerialPort,
    ServerAddress,
    SocketPath,
    Unit0,
    Units,
    UnitsOrAll,
    UpstreamUnits,
    WebAddress,
    WireUnits,
)
from gateway.lines.quirks import Quirk
from gateway.modbus.codes import FIRST_UNIT, LAST_UNIT, Area
from gateway.ports.wire import Wire

FunctionNumber = Annotated[int, Field(ge=1, le=127), Kind("function")]
Count = Annotated[int, Field(ge=1)]


class Table(BaseModel):
    """A table of the file. `path` and `source` say where it stands in it, once `placed` was called."""

    # Deferred: of most tables the validator is only needed inside that of the whole file, which builds it anyway.
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, defer_build=True)

    _path: Path = PrivateAttr(default=())
    _source: str = PrivateAttr(default="")

    @property
    def path(self) -> Path:
        """The way to the table from the top of the file."""
        return self._path

    @property
    def source(self) -> str:
        """File and line of the table, such as `gateway.toml:31`."""
        return self._source

    def placed(self, path: Path, source: str) -> Self:
        """This table, which now knows where it stands. To be called once, by whoever has read the file."""
        self._path = path
        self._source = source
        return self

    def has(self, key: str) -> bool:
        """Whether the user has written the field `key`."""
        return key in self.model_fields_set


class Listen(Table):
    """An address where clients connect."""

    name: Name | None = Field(None, description="What logs and `[[access]]` call it; the address when there is none.")
    bind: ListenAddress = Field(
        description="Where to listen, and what is spoken there: `tcp://`, `tls://`, `rtu+tcp://`, `ascii+tcp://` or "
        "`udp://`, then host and port. Without a port it is 502, with `tls://` 802; RTU and ASCII over TCP need one. "
        "Port 0 takes a free one. `0.0.0.0` is every IPv4 address; `[::]` is every address, but leaves IPv4 to another "
        "listener that has an IPv4 address with the same port.",
    )
    clients: Count = Field(
        32,
        description="Connections at once; with `udp://` clients that are known at once. When full, one without a "
        "request under way is closed for the next, in [this order](operations.md#when-a-listener-is-full).",
    )
    reserve: Annotated[int, Field(ge=0)] = Field(
        0,
        description="So many of `clients` are kept for addresses that the `from` of a row of `[[access]]` names and "
        "gives rights to; without `[[access]]` for those of this machine.",
    )
    idle: IdleDuration = Field(
        600.0, description='Close, or with UDP forget, who asks nothing for so long; `"0"`: never.'
    )
    in_flight: Count = Field(
        16,
        description="Requests under way per connection; beyond it the gateway stops reading. RTU and ASCII over TCP: "
        "one is under way, and so many may wait behind it. UDP: what is beyond it is answered 06.",
    )
    unit0: Unit0 = Field(
        "refuse",
        description='Requests to unit 0: `"refuse"` answers 0A, a number is the unit to use instead. `"broadcast"` '
        "sends a write once to every line that accepts broadcasts, and to the images; it is never answered, so that a "
        "client tool will show a time-out. A read is answered 01. With RTU and ASCII over TCP there is no answer "
        "from unit 0 at all, unless this is a number.",
    )
    on_failure: Literal["exception", "silent"] = Field(
        "exception",
        description="What a client gets when the gateway has no answer for it: exception 0A, 0B or 06, or nothing at "
        "all, as from a device that is off. 01 to 03 are always answered, and so is what a unit itself says. With RTU "
        "and ASCII over TCP, requests that were sent together with one that gets nothing get nothing either.",
    )

    line: Name | None = Field(
        None,
        description="The name of a line makes it a listener for that line alone: unit identifiers 1-247 are addresses "
        "on its wire, whatever `as` says, and nothing else can be reached. If the line has no `devices`, every address "
        "passes through. `unit0`, and rows of `[[access]]` that name this listener, are about these addresses too.",
    )

    @property
    def label(self) -> str:
        """Its name, or what it is called without one."""
        return self.name or str(self.bind)


class Device(Table):
    """A device on a line, or several of one kind in one row."""

    units: WireUnits = Field(
        alias="unit",
        description="Its unit on the wire, 1-247; a set stands for several devices. 0 asks whoever is there: for a "
        "lone device whose address is not known, and only its holding registers can be read.",
    )
    known_as: ClientUnits | None = Field(
        None,
        alias="as",
        description="The unit that clients use, 1-247 or 255; as many as there are in `unit`. Default: the same.",
    )
    name: Name | None = Field(
        None,
        description="What logs call it; `*` stands for the unit that clients use. Default: line name and unit.",
    )
    profile: str | None = Field(None, description="What kind of device it is; the line's `profile` when there is none.")
    priority: Literal["normal", "high"] = Field(
        "normal", description="Requests to a device with high priority go before others that wait."
    )
    timeout: Duration | None = Field(
        None, description="How long it may take to begin its answer, whatever its profile says."
    )

    @property
    def client_units(self) -> tuple[int, ...]:
        """The units that clients use for `units`, in the same order."""
        return self.units if self.known_as is None else self.known_as


class Line(Table):
    """A serial line: its port, how it is spoken to, and its devices."""

    name: Name | None = Field(
        None, description="What logs and metrics call it; the last part of the port when there is none."
    )
    port: SerialPort = Field(
        description="The serial device, best by its name in `/dev/serial/by-id/`; or a device server in raw TCP mode: "
        "`rtu+tcp://host:port`, `ascii+tcp://host:port`, which says the `mode` too. `baud` and `format` are then those "
        "that are set in the server.",
    )
    mode: Literal["rtu", "ascii"] = Field("rtu", description="What is spoken on the line.")
    baud: Annotated[int, Field(ge=1, le=100_000_000)] = Field(
        19200, description="Any rate; 14400 and other odd ones are set as custom rates."
    )
    format: Format | None = Field(
        None, description="Data bits, parity, stop bits. Default: `8E1` for RTU, `7E1` for ASCII."
    )
    role: Literal["client", "server"] = Field(
        "client", description="`client`: we ask its devices. `server`: an outside client asks us."
    )
    rs485: Literal["adapter", "kernel"] = Field(
        "adapter", description="Who switches the direction of an RS-485 line: the adapter, or the kernel (TIOCSRS485)."
    )
    echo: bool = Field(
        False,
        description="True when the adapter returns what we send; exactly that is stripped. Where `wire` is `serial` it "
        "is noticed and said; where that is `direct` it cannot be.",
    )
    wire: Wire = Field(
        "auto",
        description="`serial`: bytes take their time on a wire, and what comes before a request can have left is no "
        "answer. `direct`: a device that is its own adapter (USB CDC, a virtual machine, a soft PLC) may answer at "
        "once; an echo cannot be told from the answer to 05 or 06 then. `auto`: `direct` for virtual ports and device "
        "servers, else `serial`; for `ttyACM` too, as adapters are among them. Where that is wrong, the log says "
        "`answer_too_early`.",
    )
    latency: DurationOrAuto = Field(
        None,
        description='What adapter and driver may add to an answer. `"auto"`: 5 ms, other USB adapters 20 ms, '
        "TCP 100 ms.",
    )
    profile: str = Field("generic", description="For pass-through, and for devices that name none.")
    timeout: Duration | None = Field(
        None,
        description="How long a device that names no profile may take to begin its answer, where `profile` has no row "
        "for the function. Default: the `timeout` of `profile` (`generic`: 1 s).",
    )
    gap: DurationOrZeroOrAuto = Field(
        None,
        description="Silence before each request, on server lines before each response. "
        '`"auto"`: the larger of t3.5 and the `idle_chars` of its devices, or of the units that it serves; '
        'none for ASCII. `"0"`: none.',
    )
    turnaround: DurationOrAuto = Field(
        None,
        description='Silence after a broadcast. `"auto"`: 100 ms, or the `margin` x `timing` of the slowest device '
        "if that is longer.",
    )
    late_window: DurationOrAuto = Field(
        None,
        description="After a time-out or a broken answer: how long the late answer may still come. So long no request "
        "with the same function goes to that unit: it gets 0B at once, or waits if no more than 250 ms are left. "
        '`"auto"`: twice the limit of the request, or the longest time that the device is allowed for anything (its '
        "`timeout`, `margin` x its table) if that is more. With a time-out of 1 s, one lost answer costs the unit 2 s "
        "of that function.",
    )
    queue: Count = Field(
        64,
        description="Requests that may wait; beyond it the client that has most waiting, by connection, then by "
        "address, gets exception 06 for its newest. Those that share a transaction count each.",
    )
    max_wait: LongerDuration = Field(2.0, description="A request that waited longer is answered 06 and never sent.")
    retries: Annotated[int, Field(ge=0)] = Field(
        0,
        description="How often a read is sent again: after a broken frame at once, after silence when its late window "
        "is over. Writes are never repeated.",
    )
    retry_within: DurationOrAuto = Field(
        None,
        description="The longest that a read and its repeats may take, from the first sending. A repeat that could not "
        "end by then is not sent: the client gets 0B at once. After silence it needs at least limit + late window + "
        'limit. `max_wait` does not count for repeats. `"auto"`: twice the sum of limit and late window.',
    )
    rest: DurationOrOffOrAuto = Field(
        None,
        description='The longest rest of a unit that does not answer. `"auto"`: a minute, or nine time limits if that '
        'is longer. With a short one, or `"off"`, a dead unit takes more of the line\'s time from the others.',
    )
    coalesce: bool = Field(
        True,
        description="Equal reads of different clients that wait share one transaction. Those of one client are asked "
        "one after the other.",
    )
    broadcast: bool = Field(True, description="Whether broadcasts go to this line too.")
    devices: Annotated[tuple[Device, ...], ListOf] | None = Field(
        None,
        description="Its devices. Left out on the only client line, every unit 1-247 passes through. Beside other "
        "client lines it can be left out if a `[[listen]]` names the line; only those that do so lead to it then.",
    )
    serves: Units | None = Field(None, description="Server lines: the units that we answer for; others get silence.")
    on_failure: Literal["exception", "silent"] = Field(
        "exception",
        description="Server lines: what the outside client gets when the gateway has no answer, as in `[[listen]]`.",
    )
    answer_within: LongerDuration = Field(1.0, description="Server lines: older answers are never put on the line.")
    broadcast_to: Literal["images", "all", "none"] = Field(
        "images",
        description="Server lines: who takes broadcasts: the images that the line serves, every line that accepts "
        "broadcasts too, or nobody.",
    )

    @property
    def label(self) -> str:
        """Its name, or what it is called without one."""
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
    """A range that a mirror reads: one area, and how often."""

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
    """Values that an image starts with, from one address on."""

    at: Annotated[int, Field(ge=0, le=65535)] = Field(description="Address of the first value.")
    values: Annotated[tuple[Item, ...], ListOf] = Field(description="The values: 0-65535, or `true` and `false`.")


class Initial(Table):
    """What an image starts with; everything else is 0."""

    holding: Annotated[tuple[InitialValues, ...], ListOf] = Field((), description="Holding registers.")
    input: Annotated[tuple[InitialValues, ...], ListOf] = Field((), description="Input registers.")
    coils: Annotated[tuple[InitialValues, ...], ListOf] = Field((), description="Coils.")
    discrete: Annotated[tuple[InitialValues, ...], ListOf] = Field((), description="Discrete inputs.")

    def rows(self, area: Area) -> tuple[InitialValues, ...]:
        """The rows of one area."""
        rows: tuple[InitialValues, ...] = getattr(self, area)
        return rows


class Image(Table):
    """A unit that the gateway itself answers for: a local register image, or with `of` a mirror of a device."""

    unit: ClientUnit = Field(
        description="The unit that clients use, 1-247; or 255, which many clients of Modbus TCP send when "
        "they mean the server itself."
    )
    name: Name | None = Field(None, description="What logs call it. Default: `image-` and the unit.")
    profile: str = Field("generic", description="What it accepts: functions, limits, addresses.")
    holding: Ranges = Field((), description="Its holding registers.")
    input: Ranges = Field((), description="Its input registers.")
    coils: Ranges = Field((), description="Its coils.")
    discrete: Ranges = Field((), description="Its discrete inputs.")
    persist: Literal["never", "interval", "always"] = Field(
        "never",
        description="`interval`: at most 1 s of writes is lost, none at a stop. `always`: on disk before a write is "
        "acknowledged.",
    )
    initial: Initial = Field(
        Initial(), description="Values to start with, such as `initial.holding = [{ at = 0, values = [1, 2, 3] }]`."
    )
    of: str | None = Field(
        None, description="Makes it a mirror: the device that is polled once for any number of clients."
    )
    read: Annotated[tuple[Polled, ...], ListOf] = Field((), description="Mirrors: what to poll, and how often.")
    stale: LongerDuration = Field(2.0, description="Mirrors: older values are answered with exception 0B.")

    @property
    def label(self) -> str:
        """Its name, or what it is called without one."""
        return self.name or f"image-{self.unit}"

    def ranges(self, area: Area) -> tuple[tuple[int, int], ...]:
        """The addresses of one area that exist."""
        ranges: tuple[tuple[int, int], ...] = getattr(self, area)
        return ranges


class UpstreamUnit(Table):
    """Units behind another server."""

    known_as: ClientUnits = Field(alias="as", description="The units that clients use, 1-247 and 255.")
    units: UpstreamUnits = Field(alias="unit", description="The units that the other server knows.")


class Upstream(Table):
    """Another Modbus TCP server, and the units that live behind it."""

    name: Name | None = Field(None, description="What logs call it; the address when there is none.")
    to: ServerAddress = Field(description="Its address.")
    units: Annotated[tuple[UpstreamUnit, ...], ListOf] = Field(description="The units behind it.")
    timeout: Duration = Field(1.0, description="How long an answer may take.")
    in_flight: Annotated[int, Field(ge=1, le=64)] = Field(
        16, description="Requests under way at once; 1 for a server that can only take one after the other."
    )

    @property
    def label(self) -> str:
        """Its name, or what it is called without one."""
        return self.name or str(self.to)

    def unit_names(self, row: UpstreamUnit) -> list[str]:
        """What the units of a row are called, in the order of its units."""
        return [f"{self.label}/{unit}" for unit in row.known_as]


class TimingRow(Table):
    """A point of a timing table."""

    fc: FunctionNumber = Field(description="The function.")
    items: Count = Field(description="Coils or registers in the request.")
    time: AnswerDuration = Field(description="How long the device takes for them.")


class ProfileTable(Table):
    """What a kind of device accepts, and how fast it answers."""

    title: str = Field("", description="What kind of device it is, for people.")
    mode: Literal["rtu", "ascii"] | None = Field(
        None, description="What these devices speak, if it is one of both only: `check` warns of a line with the other."
    )
    functions: Annotated[tuple[FunctionNumber, ...], ListOf] | None = Field(
        None, description="Others get exception 01, and nothing goes on the line. Default: all."
    )
    limits: Limits = Field({}, description="Most items per request, by function; more: exception 03.")
    holding: Ranges | None = Field(
        None, description="Holding registers that exist; others: exception 02. Default: all."
    )
    input: Ranges | None = Field(None, description="Input registers that exist. Default: all.")
    coils: Ranges | None = Field(None, description="Coils that exist. Default: all.")
    discrete: Ranges | None = Field(None, description="Discrete inputs that exist. Default: all.")
    idle_chars: Annotated[float, Field(gt=0, le=1000)] = Field(
        3.5, description="The silence that ends a frame, in characters."
    )
    timing: Annotated[tuple[TimingRow, ...], ListOf] = Field(
        (), description="Answer time by function and item count; points are joined by straight lines."
    )
    margin: Annotated[float, Field(ge=1, le=100)] = Field(1.5, description="Times are multiplied by it, to be safe.")
    timeout: Duration = Field(1.0, description="For functions that `timing` does not name.")
    quirks: Annotated[tuple[Quirk, ...], ListOf] = Field(
        (),
        description="How the device strays from the protocol. `moves`: a write to holding register 0x0100 sets its"
        " address. `changes_baud`: a float32 written to 0x0200-1 sets its baud rate.",
    )


class Access(Table):
    """Who may do what. The first row that fits client and unit counts; what no row fits is refused."""

    networks: Networks | None = Field(
        None, alias="from", description="Networks of the clients that are meant, or single addresses. Default: all."
    )
    listen: Annotated[tuple[Name, ...], ListOf] | None = Field(
        None,
        description="Listeners that are meant, by name; server lines and `control` too. Default: all. A server line "
        "keeps all rights until a row names it, and UDP clients write only by a row that names their listener. A row "
        "names either listeners for one line, or others.",
    )
    role: str | None = Field(None, description="The role that a TLS client's certificate names.")
    units: UnitsOrAll = Field(
        "all",
        description="Units that are meant, as clients call them, 1-247 and 255; in a row that names a listener for one "
        "line, addresses on its wire. A broadcast needs the right at every unit.",
    )
    allow: Annotated[tuple[Literal["read", "write"], ...], ListOf] | None = Field(
        None,
        description="What is allowed; or name `functions`. `read` is functions 1, 2, 3, 4, 7, 11, 12, 17, 20, 24 and "
        "43/14, `write` is every other one. `[]`: nothing.",
    )
    functions: Annotated[tuple[FunctionNumber, ...], ListOf] | None = Field(
        None, description="Functions that are allowed, and no others."
    )


class Web(Table):
    """The web page and the metrics; without this table there are none over TCP."""

    bind: WebAddress = Field(description="Where to listen.")


class Control(Table):
    """The control socket, through which the other commands talk to the daemon."""

    socket: SocketPath | None = Field(
        None,
        description="Its path. Default: `/run/modbus-gateway/control.sock`; without root "
        "`$XDG_RUNTIME_DIR/modbus-gateway/control.sock`, or `control.sock` beside the config when that is not set. "
        "`status` and `reload` read it in `/etc/modbus-gateway/gateway.toml`; for another file they need `--control`.",
    )


class Log(Table):
    """The log on standard error."""

    level: Literal["debug", "info", "warning", "error"] = Field("info", description="The least that is told.")
    format: Literal["auto", "console", "json", "journald"] = Field(
        "auto",
        description="How it is written: `console` for people; `json` for programs, one object a line; `journald` into "
        "systemd's journal, each field for itself. `auto` is `journald` under systemd, else `console`.",
    )


class Config(Table):
    """A whole file."""

    site: str = Field("", description="The name of the plant, for logs and metrics; it has no effect yet.")
    listen: Annotated[tuple[Listen, ...], ListOf] = ()
    line: Annotated[tuple[Line, ...], ListOf] = ()
    image: Annotated[tuple[Image, ...], ListOf] = ()
    upstream: Annotated[tuple[Upstream, ...], ListOf] = ()
    profile: Mapping[str, ProfileTable] = Field({})
    access: Annotated[tuple[Access, ...], ListOf] = ()
    web: Web | None = None
    control: Control | None = None
    log: Log = Log()

    @property
    def leads_everywhere(self) -> bool:
        """Whether a listener leads to all units: one that is not for a line, or the one that is there without any."""
        return not self.listen or any(listen.line is None for listen in self.listen)

    def listeners_for(self, line: Line) -> list[Listen]:
        """The listeners that are for this line alone."""
        return [listen for listen in self.listen if listen.line == line.label]

    def is_apart(self, line: Line) -> bool:
        """Whether no other listeners lead to a client line: it has no devices, and is not the only one."""
        has_company = any(other.role == "client" and other is not line for other in self.line)
        return line.devices is None and has_company and bool(self.listeners_for(line))
