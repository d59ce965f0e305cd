"""The status of a gateway. Counts are since the start; durations have their unit in their name."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from gateway.fleet.status import FleetStatus, SiteStatus
from gateway.lines.counts import Counts
from gateway.listeners.sessions.server_counts import ServerCounts
from gateway.operator.operations.answers.trouble import Trouble
from gateway.plant.status import BrokerStatus
from gateway.ports.port import Wire
from gateway.state.status import StateFileStatus
from gateway.timing.measured import Phases
from gateway.tls.status import CertificateStatus


@dataclass(frozen=True, slots=True)
class ListenerStatus:
    """An address where at most `most` clients connect. `denied` and `no_route` count requests that went to no unit."""

    name: str
    address: str
    clients: int
    accepted: int
    rejected: int
    denied: int
    no_route: int
    most: int = 0


@dataclass(frozen=True, slots=True)
class ClientStatus:
    """A client that is connected, or has sent datagrams. `asked_ms` is the age of its last request, None without any.

    Of its `requests`, those `in_progress` have no response yet.
    """

    client: str
    listener: str
    asked_ms: float | None
    requests: int
    in_progress: int


@dataclass(frozen=True, slots=True)
class RejectionStatus:
    """Rejected clients at the address `host`: their `count`, the age of the last rejection, and its reason."""

    host: str
    listener: str
    count: int
    last_ms: float
    reason: str


@dataclass(frozen=True, slots=True)
class LineUserStatus:
    """A user of a line in the last minute: a client's requests with one function to the unit `on_the_wire`.

    `share` is the share of the line's time. `client` is an address, the name of a mirror or of a server line,
    `control`, or `others` for all that the table has no room for; `device` is empty then, and for broadcasts.
    """

    client: str
    on_the_wire: int
    device: str
    function: int
    share: float
    requests_per_s: float


@dataclass(frozen=True, slots=True)
class LeaseStatus:
    """The lease of a `line`. `holder` is the present holder, empty if unknown; `is_held`: it is this gateway.

    `taken` counts how often this gateway took it. `trouble` is why NATS could not be reached last, empty if it was.
    """

    line: str
    name: str
    is_held: bool
    holder: str
    taken: int
    trouble: str


@dataclass(frozen=True, slots=True)
class LineStatus:
    """A client line. `reason` says why it is down, or on standby: then another gateway holds its lease and may ask.

    `late_windows` counts late responses that are still expected. `wire` may be `auto` until the port has been open
    once.

    `phases` are the seconds spent on requests, waiting for responses, responses, and the silences after them; `busy_s`
    is their sum. `busy_share` and `requests_per_s` are of the last minute; None in the first second. `counts` are those
    of all its units and of its broadcasts. `users` are the largest users of its time in the last minute.
    """

    name: str
    source: str
    port: str
    state: Literal["up", "down", "standby", "not tried"]
    reason: str
    wire: Wire
    mode: str
    baud: int
    format: str
    queue: int
    late_windows: int
    busy_s: float
    busy_share: float | None
    requests_per_s: float | None
    phases: Phases
    unasked_bytes: int
    counts: Counts
    users: tuple[LineUserStatus, ...]


@dataclass(frozen=True, slots=True)
class ServerStatus:
    """A server line, which answers for the units in `serves`. `reason` says why it is down.

    `programs` counts those that use a virtual port, None for another port.
    """

    name: str
    source: str
    port: str
    state: Literal["up", "down", "not tried"]
    reason: str
    programs: int | None
    wire: Wire
    mode: str
    baud: int
    format: str
    serves: tuple[int, ...]
    counts: ServerCounts


@dataclass(frozen=True, slots=True)
class UpstreamStatus:
    """A connection to another server. `reason` says why there is none. `queue` requests wait, `under_way` are sent.

    `overdue` counts late responses that are still expected. `busy_share` and `requests_per_s` are of the last minute,
    None in the first second; `busy_share` is the mean share of the requests in flight that may be. `counts` are those
    of all its units.
    """

    name: str
    source: str
    to: str
    state: Literal["up", "down", "not tried"]
    reason: str
    queue: int
    under_way: int
    overdue: int
    busy_share: float | None
    requests_per_s: float | None
    unasked_frames: int
    counts: Counts


@dataclass(frozen=True, slots=True)
class UnknownUnitStatus:
    """A unit that is asked on a monitor line, and is none of its devices: `requests` to it were heard."""

    on_the_wire: int
    requests: int


@dataclass(frozen=True, slots=True)
class HeardCounts:
    """What was heard on a line: `requests`, and `answers` to them; the values of `sure` ones were taken.

    `unanswered` requests had none within their late windows. `strays` are responses to no request that was heard, and
    requests that violate the specification; `both_ways` are frames that may be a request or a response; `noise` are
    stretches of bytes that are no frames.
    """

    requests: int
    answers: int
    sure: int
    unanswered: int
    strays: int
    both_ways: int
    noise: int


@dataclass(frozen=True, slots=True)
class MonitorStatus:
    """A line on which others ask, and the gateway only listens. `reason` says why it is down.

    The last request was heard `heard_ms` ago, None if none was. `unknown_units` are asked, and not among its devices.

    `busy_share` and `requests_per_s` are of the last minute; None in the first second. `users` are the largest users of
    its time in the last minute.
    """

    name: str
    source: str
    port: str
    state: Literal["up", "down", "not tried"]
    reason: str
    wire: Wire
    mode: str
    baud: int
    format: str
    heard_ms: float | None
    busy_share: float | None
    requests_per_s: float | None
    counts: HeardCounts
    unknown_units: tuple[UnknownUnitStatus, ...]
    users: tuple[LineUserStatus, ...]


#: A client line, a server line, an upstream, or a monitor line.
AnyLine = LineStatus | ServerStatus | UpstreamStatus | MonitorStatus


@dataclass(frozen=True, slots=True)
class Lines:
    """All lines and upstreams, in the order of the config."""

    lines: tuple[LineStatus, ...]
    servers: tuple[ServerStatus, ...]
    upstreams: tuple[UpstreamStatus, ...]
    monitors: tuple[MonitorStatus, ...] = ()


@dataclass(frozen=True, slots=True)
class Sites:
    """The sites of a fleet, by name."""

    sites: tuple[SiteStatus, ...]


@dataclass(frozen=True, slots=True)
class TimesStatus:
    """Times of requests: median and 99th percentile, estimated from fixed buckets; None before the first request.

    `wait` lasts until a request was sent; `answer` from its last character to the last one of a valid response;
    `limit_share` is the share of the limit that this took. `limit_ms` is the last limit, of several functions the
    longest. `late` counts further responses that came after their limit.
    """

    wait_p50_ms: float | None
    wait_p99_ms: float | None
    answer_p50_ms: float | None
    answer_p99_ms: float | None
    limit_share_p50: float | None
    limit_share_p99: float | None
    limit_ms: float | None
    late: int


@dataclass(frozen=True, slots=True)
class UnitStatus:
    """A unit on a line or behind an upstream, which `line` names: `unit` to clients, `on_the_wire` there.

    `unit` is None if clients ask it by its name, or by a listener for the line or upstream. Its last `failures`
    requests have failed; after three it rests, and `rests_ms` are left of that. The last valid response came
    `last_answer_ms` ago, the last error after a request was sent `last_error_ms` ago. `exceptions` are those of the
    unit itself, by code. `functions` and `function_times` are by function code, 0 for all unknown ones; `counts` and
    `times` are of all functions. A client's time-out should be longer than `longest_wait_ms`.
    """

    line: str
    unit: int | None
    on_the_wire: int
    name: str
    source: str
    profile: str
    state: Literal["fine", "failing", "resting", "line down"]
    failures: int
    rests_ms: float
    last_answer_ms: float | None
    last_error: str
    last_error_ms: float | None
    longest_wait_ms: float
    counts: Counts
    times: TimesStatus
    exceptions: Mapping[int, int]
    functions: Mapping[int, Counts]
    function_times: Mapping[int, TimesStatus]


@dataclass(frozen=True, slots=True)
class MovedStatus:
    """A unit that is, or may be, at another address than `configured`: at one of those in `on_the_wire`.

    Its last `failures` requests have failed.
    """

    line: str
    unit: int | None
    name: str
    on_the_wire: tuple[int, ...]
    configured: int
    failures: int


@dataclass(frozen=True, slots=True)
class ImageStatus:
    """A unit that the gateway answers itself.

    `python` is the class of one that is made in Python, and `timeout_ms` how long it may take for a request. Only
    such a unit has a `state`, and rests for `rests_ms` after failures.
    """

    unit: int
    name: str
    source: str
    requests: int
    exceptions: int
    python: str = ""
    timeout_ms: float = 0.0
    state: Literal["", "fine", "failing", "resting"] = ""
    rests_ms: float = 0.0


@dataclass(frozen=True, slots=True)
class RangeStatus:
    """Addresses of a mirror, how often they are polled (0: only heard), and the age of their values; None: unknown."""

    addresses: str
    every_ms: float
    age_ms: float | None


@dataclass(frozen=True, slots=True)
class MirrorStatus:
    """A mirror of the device `of`."""

    unit: int
    name: str
    source: str
    of: str
    requests: int
    exceptions: int
    polls: int
    failed_polls: int
    ranges: tuple[RangeStatus, ...]


@dataclass(frozen=True, slots=True)
class SourceStatus:
    """A device, or an image, of which a virtual unit has `rows`; so many of them are `fresh`.

    `age_ms` is the age of the oldest value; None while one is unknown.
    """

    device: str
    rows: int
    fresh: int
    age_ms: float | None

    @property
    def is_fresh(self) -> bool:
        """Whether all of its rows are fresh."""
        return self.fresh == self.rows

    def state(self, stale_ms: float) -> Literal["fresh", "stale", "unknown", "invalid"]:
        """Return the state of the oldest value, or of any that is not valid; values are stale when so old."""
        if self.is_fresh:
            return "fresh"
        return "unknown" if self.age_ms is None else "stale" if self.age_ms > stale_ms else "invalid"


@dataclass(frozen=True, slots=True)
class VirtualStatus:
    """A virtual unit, whose values come from `sources`. `polls` counts those for it; others may share them.

    `age_ms` is the age of the oldest value; None while one is unknown.
    """

    unit: int
    name: str
    source: str
    requests: int
    exceptions: int
    polls: int
    failed_polls: int
    age_ms: float | None
    sources: tuple[SourceStatus, ...]

    @property
    def fresh_sources(self) -> int:
        """The number of sources whose values are all fresh."""
        return sum(each.is_fresh for each in self.sources)


@dataclass(frozen=True, slots=True)
class Status:
    """The whole gateway, in the order of its config. `at` is the time of the loop's clock, in seconds."""

    at: float
    listeners: tuple[ListenerStatus, ...]
    clients: tuple[ClientStatus, ...]
    rejections: tuple[RejectionStatus, ...]
    lines: tuple[LineStatus, ...]
    servers: tuple[ServerStatus, ...]
    upstreams: tuple[UpstreamStatus, ...]
    units: tuple[UnitStatus, ...]
    images: tuple[ImageStatus, ...]
    mirrors: tuple[MirrorStatus, ...]
    virtual: tuple[VirtualStatus, ...] = ()
    certificates: tuple[CertificateStatus, ...] = ()
    brokers: tuple[BrokerStatus, ...] = ()
    fleets: tuple[FleetStatus, ...] = ()
    leases: tuple[LeaseStatus, ...] = ()
    moved: tuple[MovedStatus, ...] = ()
    state_files: tuple[StateFileStatus, ...] = ()
    troubles: tuple[Trouble, ...] = ()
    monitors: tuple[MonitorStatus, ...] = ()
    #: The name of the plant, and the address of the web page; empty if there is none.
    site: str = ""
    page: str = ""

    @property
    def all_lines(self) -> "tuple[AnyLine, ...]":
        """All lines and upstreams."""
        return (*self.lines, *self.servers, *self.upstreams, *self.monitors)
