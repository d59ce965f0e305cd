"""The evidence for the rules. Counters start with the gateway; times are in seconds."""

from dataclasses import dataclass
from typing import Final

from gateway.diagnosis.last import NOW, Last
from gateway.diagnosis.pauses import ENOUGH, NO_PAUSES, Pauses
from gateway.modbus.explain import OTHER_IDENTIFIER
from gateway.ports.port import CharacterErrors

_IDENTIFIER_ZERO: Final = OTHER_IDENTIFIER.format(0)


@dataclass(frozen=True, slots=True)
class Holder:
    """A program that has a serial port open; `is_interpreter` if it may run any script, as `python` does."""

    name: str
    pid: int
    is_interpreter: bool = False


@dataclass(frozen=True, slots=True)
class PortInUse:
    """A serial port of the config. The gateway has it open, or `is_standby`: another gateway may have it."""

    line: str
    source: str
    port: str
    is_open: bool
    is_standby: bool = False


@dataclass(frozen=True, slots=True)
class PortEvidence:
    """The facts about a serial port that are known without opening it.

    It belongs to `line`; `source` is its place in the config. `device` is its name in /dev. `stable_path` is a link to
    it that survives a replug, empty if there is none. `user` runs the gateway and has access if `may_open`; the port's
    group is `group`. `latency_timer` is that of an FTDI adapter in seconds, None for other adapters. `is_ours`: the
    gateway has it open. `holders` are other programs that have it open, `probers` programs that open serial ports when
    they appear. With `is_standby` another gateway may have it.
    """

    line: str
    source: str
    port: str
    device: str = ""
    exists: bool = True
    is_virtual: bool = False
    is_usb: bool = False
    stable_path: str = ""
    user: str = ""
    may_open: bool = True
    group: str = ""
    latency_timer: float | None = None
    is_ours: bool = False
    holders: tuple[Holder, ...] = ()
    probers: tuple[str, ...] = ()
    is_standby: bool = False


@dataclass(frozen=True, slots=True)
class UnitEvidence:
    """A unit on a line: `unit` for clients, `on_the_wire` there.

    `answered` includes `exceptions`. `late` answers came after their limit, the slowest one after `latest`, when the
    limit was `latest_limit`. `behind` answers came in time, but after one that another client may have requested, and
    were dropped. `limit` is the longest current limit of all functions, 0 before the first request; 99 of 100 answers
    took up to `limit_share` of theirs. `twice` answers came a second time. `instead` holds bytes received lately in
    place of answers. `explained` bad frames have a known reason; `why` is that of the last failure, empty if unknown.
    The last `in_a_row` requests failed. The last answer came `ago` seconds ago, None if none did. A unit that is not
    `is_configured` is known only from requests of clients. `last_failed` is the last request without a valid response,
    `last_bad` the last with a bad frame, `last_late` the last late answer and `last_twice` the last one that came a
    second time. If it `has_table`, its limits come from the timing table of its profile. `moved_from` is the address in
    the config, if the unit is, or may be, at another one.
    """

    unit: int | None
    on_the_wire: int
    name: str
    source: str
    profile: str
    answered: int = 0
    exceptions: int = 0
    timeouts: int = 0
    bad_frames: int = 0
    ambiguous: int = 0
    late: int = 0
    latest: float = 0.0
    latest_limit: float = 0.0
    behind: int = 0
    limit: float = 0.0
    limit_share: float | None = None
    twice: int = 0
    instead: tuple[bytes, ...] = ()
    explained: int = 0
    why: str = ""
    in_a_row: int = 0
    ago: float | None = None
    is_configured: bool = True
    has_table: bool = False
    moved_from: int | None = None
    last_failed: Last = NOW
    last_bad: Last = NOW
    last_late: Last = NOW
    last_twice: Last = NOW

    @property
    def asked(self) -> int:
        """Number of requests that were sent and have ended."""
        return self.answered + self.failed

    @property
    def failed(self) -> int:
        """Number of requests that were sent and got no valid response within their limit."""
        return self.timeouts + self.bad_frames + self.ambiguous

    @property
    def damaged(self) -> int:
        """Number of bad frames without a known reason."""
        return self.bad_frames - self.explained

    @property
    def is_silent(self) -> bool:
        """Whether requests were sent to it, and nothing was received."""
        return bool(self.timeouts) and not (self.answered or self.late or self.bad_frames or self.ambiguous)

    @property
    def is_answering(self) -> bool:
        """Whether it has answered, including its last request."""
        return bool(self.answered) and not self.in_a_row


@dataclass(frozen=True, slots=True)
class Search:
    """The search for silent units of a line.

    `addresses` that are not configured were read, and `found` responded; then `speeds` other rates and formats were
    tried. Without `has_parity` the port is virtual, and only rates can be tried.
    """

    addresses: tuple[int, ...] = ()
    found: tuple[int, ...] = ()
    speeds: int = 0
    has_parity: bool = True
    #: Rate and format at which a unit has answered, such as (9600, "8N1").
    speed: tuple[int, str] | None = None


@dataclass(frozen=True, slots=True)
class LineEvidence:
    """A client line, or an upstream, which gets up to `in_flight` requests at once.

    `reason` is why it is down or `is_standby`; empty while the line is up. In the last minute it was lost `losses`
    times, for the reason `loss` or others.

    `sent` requests have left; `copies` of them were received again, of the last `copies_in_a_row` each. `others`
    requests of other clients were heard; `last_copy` and `last_other` are the last of both. `errors` are the driver's
    counts of damaged characters, None where it has none; `last_parity` and `last_framing` are the last of these.

    Of an upstream: `pauses` is how its last requests fared by what was before them, and responses with identifier 0 are
    taken if it `takes_zero`.
    """

    name: str
    source: str
    baud: int
    format: str
    reason: str = ""
    is_standby: bool = False
    losses: int = 0
    loss: str = ""
    is_serial: bool = True
    echo: bool = False
    busy_share: float | None = None
    sent: int = 0
    copies: int = 0
    copies_in_a_row: int = 0
    last_copy: Last = NOW
    others: int = 0
    last_other: Last = NOW
    errors: CharacterErrors | None = None
    last_parity: Last = NOW
    last_framing: Last = NOW
    units: tuple[UnitEvidence, ...] = ()
    search: Search | None = None
    in_flight: int = 0
    pauses: Pauses = NO_PAUSES
    takes_zero: bool = False

    @property
    def with_zero(self) -> int:
        """Number of responses that were dropped because their transaction identifier was 0."""
        if not self.in_flight or self.takes_zero:
            return 0
        return sum(unit.explained for unit in self.units if unit.why == _IDENTIFIER_ZERO)

    @property
    def tells_losses(self) -> bool:
        """Whether a row of its own says why requests are lost."""
        return self.pauses.needs_gap or self.pauses.needs_turns or self.pauses.needs_wake

    @property
    def answers_zero(self) -> bool:
        """Whether the server does not return transaction identifiers."""
        return self.with_zero >= ENOUGH

    @property
    def is_silent(self) -> bool:
        """Whether several units were all sent requests, and nothing was received."""
        return len(self.units) > 1 and not self.others and all(unit.is_silent for unit in self.units)

    @property
    def has_stopped(self) -> bool:
        """Whether several units were asked, some have answered before, and the last requests to all of them failed."""
        asked = [unit for unit in self.units if unit.asked]
        if len(asked) < 2 or self.others or not any(unit.answered for unit in asked):
            return False
        failed = sum(unit.in_a_row or unit.timeouts for unit in asked)
        return failed >= 3 and all(unit.in_a_row or unit.is_silent for unit in asked)


@dataclass(frozen=True, slots=True)
class HeardUnitEvidence:
    """A device that others ask: requests that were heard, and those of them that need no answer or had one."""

    name: str
    on_the_wire: int
    requests: int
    answers: int


@dataclass(frozen=True, slots=True)
class MonitorEvidence:
    """A line on which the gateway only listens; `on_port` has what is known of its port.

    Counts as in MonitorStatus. The last request was heard `ago` seconds ago, None if none was. `unknown_units` are
    asked and not configured, each with the number of requests. It `asks_units` if requests were not all broadcasts.
    """

    name: str
    mode: str
    on_port: LineEvidence
    requests: int = 0
    answers: int = 0
    sure: int = 0
    strays: int = 0
    noise: int = 0
    ago: float | None = None
    units: tuple[HeardUnitEvidence, ...] = ()
    unknown_units: tuple[tuple[int, int], ...] = ()
    asks_units: bool = True


@dataclass(frozen=True, slots=True)
class SourceEvidence:
    """What a mirror or virtual unit polls of the device `name` on `line`; an image has no line.

    If it `is_heard`, others ask it, and nothing is polled.

    The oldest value was read `since` seconds ago; None if one never was. It `is_lost` if one is not known, and its last
    poll has failed. `invalid` values are none, or do not fit; `refused` ones the device answers with an exception.
    """

    name: str
    line: str = ""
    since: float | None = None
    is_lost: bool = False
    invalid: int = 0
    refused: int = 0
    is_heard: bool = False


@dataclass(frozen=True, slots=True)
class PolledEvidence:
    """A mirror or virtual unit; `label` is what logs call it. Its values are stale after so many seconds."""

    name: str
    label: str
    stale: float
    sources: tuple[SourceEvidence, ...]


@dataclass(frozen=True, slots=True)
class ClientEvidence:
    """Clients at one address that closed the connection before their response: `left` times.

    The last of these had waited for `waited` seconds. A response may take up to `longest_wait` seconds.
    """

    host: str
    listener: str
    left: int
    waited: float
    longest_wait: float
    last: Last = NOW
