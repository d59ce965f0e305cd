"""The evidence for the rules. Counters are since the start of the gateway; times are in seconds."""

from dataclasses import dataclass

from gateway.diagnosis.last import NOW, Last
from gateway.ports.port import CharacterErrors


@dataclass(frozen=True, slots=True)
class Holder:
    """A program that has a serial port open; `is_interpreter` if it may run anything, as `python` does."""

    name: str
    pid: int
    is_interpreter: bool = False


@dataclass(frozen=True, slots=True)
class PortInUse:
    """A serial port of the config. The gateway has it open, or `is_standby`: another gateway may have."""

    line: str
    source: str
    port: str
    is_open: bool
    is_standby: bool = False


@dataclass(frozen=True, slots=True)
class PortEvidence:
    """What is known of a serial port without opening it. It belongs to `line`, `source` is its place in the config.

    `device` is its name in /dev. `stable_path` is a link to it that survives a replug, empty if there is none. `user`
    runs the gateway and `may_open` it or not; its group is `group`. `latency_timer` is that of an FTDI adapter, None
    for others. `is_ours`: the gateway has it open. `holders` are other programs that have, `probers` programs that open
    serial ports when they appear. If it `is_standby`, another gateway may have it.
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
    """A unit on a line: `unit` to clients, `on_the_wire` there.

    `answered` includes `exceptions`; `late` answers came after their limit, the slowest one after `latest`, when it was
    `latest_limit`; `behind` ones came within it, behind one that another client may have asked for, and were dropped
    too. `limit` is the longest of the last ones of all functions, 0 before the first request, and `limit_share` what 99
    of 100 answers took of theirs. `twice` are answers that came a second time. `instead` is what was received lately in
    place of answers. Of the bad frames, so many are `explained`; `why` is that of the last failure, empty if nothing
    explains it. The last `in_a_row` requests failed. The last answer came so many seconds `ago`, None if none did. Of
    units that are not `is_configured` only clients say that they exist. `last_failed` is the last request without a
    valid response, `last_bad` that with a bad frame, `last_late` the last late answer and `last_twice` the last one
    that came a second time. If it `has_table`, its limits come from the timing table of its profile. `moved_from` is
    the address in the config, if it is, or may be, at another one.
    """

    unit: int
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
        """Requests that were sent and are over."""
        return self.answered + self.failed

    @property
    def failed(self) -> int:
        """Requests that were sent and got no valid response within their limit."""
        return self.timeouts + self.bad_frames + self.ambiguous

    @property
    def damaged(self) -> int:
        """Bad frames that nothing explains."""
        return self.bad_frames - self.explained

    @property
    def is_silent(self) -> bool:
        """Whether requests were sent to it, and nothing was received."""
        return bool(self.timeouts) and not (self.answered or self.late or self.bad_frames or self.ambiguous)

    @property
    def is_answering(self) -> bool:
        """Whether it has answered, and its last request too."""
        return bool(self.answered) and not self.in_a_row


@dataclass(frozen=True, slots=True)
class Search:
    """The search for silent units of a line.

    `addresses` that are not configured were read, and `found` responded; then `speeds` other rates and formats were
    tried. Without `has_parity` the port is a virtual one, where only rates can be tried.
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

    `reason` says why it is down, or why it `is_standby`; it is empty while the line is up.

    `sent` requests have left; `copies` of them came back, of the last `copies_in_a_row` each. `others` are requests of
    other clients that were heard; `last_copy` and `last_other` are the last ones.
    `errors` are what the driver says of received characters, None where it does not count them. `last_parity` and
    `last_framing` are the last ones of these.
    """

    name: str
    source: str
    baud: int
    format: str
    reason: str = ""
    is_standby: bool = False
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

    @property
    def is_silent(self) -> bool:
        """Whether requests were sent to several units, and to all of them, and nothing was received."""
        return len(self.units) > 1 and not self.others and all(unit.is_silent for unit in self.units)

    @property
    def has_stopped(self) -> bool:
        """Whether several units were asked, some have answered before, and the last requests of all of them failed."""
        asked = [unit for unit in self.units if unit.asked]
        if len(asked) < 2 or self.others or not any(unit.answered for unit in asked):
            return False
        failed = sum(unit.in_a_row or unit.timeouts for unit in asked)
        return failed >= 3 and all(unit.in_a_row or unit.is_silent for unit in asked)


@dataclass(frozen=True, slots=True)
class ClientEvidence:
    """A client address. Its clients `left` so often before their response, the `last` one after `waited` seconds.

    A response may take up to `longest_wait`.
    """

    host: str
    listener: str
    left: int
    waited: float
    longest_wait: float
    last: Last = NOW
