"""The status of a gateway. Counts are since the start; durations have their unit in their name."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from gateway.fleet.status import FleetStatus
from gateway.lines.counts import Counts
from gateway.listeners.sessions.server_counts import ServerCounts
from gateway.plant.status import BrokerStatus
from gateway.ports.port import Wire
from gateway.state.status import StateFileStatus
from gateway.timing.measured import Phases
from gateway.tls.status import CertificateStatus


@dataclass(frozen=True, slots=True)
class ListenerStatus:
    """An address where clients connect. `denied` and `no_route` are requests that were sent to no unit."""

    name: str
    address: str
    clients: int
    accepted: int
    rejected: int
    denied: int
    no_route: int


@dataclass(frozen=True, slots=True)
class ClientStatus:
    """A client that is connected, or has sent datagrams. Its last request was so long ago; None if there was none.

    Of its `requests` so many are `in_progress`: they have no response yet.
    """

    client: str
    listener: str
    asked_ms: float | None
    requests: int
    in_progress: int


@dataclass(frozen=True, slots=True)
class RejectionStatus:
    """Clients at the address `host` that were rejected: how many, how long ago the last one, and why."""

    host: str
    listener: str
    count: int
    last_ms: float
    reason: str


@dataclass(frozen=True, slots=True)
class LineUserStatus:
    """Who took up a line in the last minute: a client's requests with one function to the unit `on_the_wire`.

    `share` is that of the line's time. `client` is an address, the name of a mirror or of a server line, `control`, or
    `others` for all that the table had no place for; `device` is empty then, and for broadcasts.
    """

    client: str
    on_the_wire: int
    device: str
    function: int
    share: float
    requests_per_s: float


@dataclass(frozen=True, slots=True)
class LeaseStatus:
    """The lease of a `line`. `holder` is who holds it, empty if nobody is known; this gateway has it if it `is_held`.

    It was `taken` so often. `trouble` is why NATS was not reached last, empty if it was.
    """

    line: str
    name: str
    is_held: bool
    holder: str
    taken: int
    trouble: str


@dataclass(frozen=True, slots=True)
class LineStatus:
    """A client line. `reason` says why it is down, or standby: then another gateway may ask there, which has its lease.

    `late_windows` is how many late responses are still expected.

    `wire` may be `auto` until the port was open once.

    `phases` are the seconds spent on requests, waiting for responses, responses, and the silences after them; `busy_s`
    is their sum. `busy_share` and requests per second are of the last minute; None in the first second. `counts` are
    those of all its units and of its broadcasts. `users` took most of its time in the last minute, at
    most MOST_USERS of them.
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
    """A server line, which answers for the units in `serves`. `reason` says why it is down."""

    name: str
    source: str
    port: str
    state: Literal["up", "down", "not tried"]
    reason: str
    wire: Wire
    mode: str
    baud: int
    format: str
    serves: tuple[int, ...]
    counts: ServerCounts


@dataclass(frozen=True, slots=True)
class UpstreamStatus:
    """A connection to another server. `reason` says why there is none. `queue` requests wait, and `under_way` are sent.

    `overdue` is how many late responses are still expected. `counts` are those of all its units.
    """

    name: str
    source: str
    to: str
    state: Literal["up", "down", "not tried"]
    reason: str
    queue: int
    under_way: int
    overdue: int
    unasked_frames: int
    counts: Counts


#: A line, a line where the gateway is the server, or another server.
AnyLine = LineStatus | ServerStatus | UpstreamStatus


@dataclass(frozen=True, slots=True)
class TimesStatus:
    """How long requests took: median and 99th percentile, estimated from fixed buckets.

    `wait` is until a request was sent; `answer` is from its last character to the last one of a valid response;
    `limit_share` is the share of the limit that this took. `limit_ms` is the last limit. None before the first request.
    `late` more responses came after their limit.
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

    It is failing after `failures` in a row, and after three of them it backs off: `rests_ms` are left of that. The last
    valid response was `last_answer_ms` ago, the last error after a request was sent `last_error_ms` ago.
    `exceptions` are those of the unit itself, by code. `functions` are the counts of each function that was requested,
    0 for all unknown ones, and `function_times` their times; `times` are those of all. A client's time-out should be
    longer than `longest_wait_ms`.
    """

    line: str
    unit: int
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
    """A unit that is, or may be, at another address than the `configured` one: at one of those in `on_the_wire`.

    Its last `failures` requests in a row have failed.
    """

    line: str
    unit: int
    name: str
    on_the_wire: tuple[int, ...]
    configured: int
    failures: int


@dataclass(frozen=True, slots=True)
class ImageStatus:
    """A unit that the gateway answers itself."""

    unit: int
    name: str
    source: str
    requests: int
    exceptions: int


@dataclass(frozen=True, slots=True)
class RangeStatus:
    """Addresses that a mirror polls, and the age of their values; None while they are unknown."""

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
class Status:
    """The whole gateway, in the order of its config, at the time `at` of the loop's clock, in seconds."""

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
    certificates: tuple[CertificateStatus, ...] = ()
    brokers: tuple[BrokerStatus, ...] = ()
    fleets: tuple[FleetStatus, ...] = ()
    leases: tuple[LeaseStatus, ...] = ()
    moved: tuple[MovedStatus, ...] = ()
    state_files: tuple[StateFileStatus, ...] = ()
    #: The name of the plant, and the address of the web page; empty if there is none.
    site: str = ""
    page: str = ""
