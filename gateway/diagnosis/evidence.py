"""What the rules look at. Counts are those since the start of the gateway; times are in seconds."""

from dataclasses import dataclass

from gateway.ports.port import CharacterErrors


@dataclass(frozen=True, slots=True)
class Holder:
    """A program that has a serial port open."""

    name: str
    pid: int


@dataclass(frozen=True, slots=True)
class PortEvidence:
    """A serial port, as it can be seen without opening it. `line` is whose it is, `source` where the config names it.

    `stable_path` is a link to it that survives a replug, empty if there is none. `user` is who must be able to open it:
    it `may_open` or not, and `group` has the right. `latency_timer` is that of an FTDI adapter, None for others.
    `is_ours`: the gateway has it open. `holders` are other programs that have, `probers` those that run and are known
    to open serial ports that appear.
    """

    line: str
    source: str
    port: str
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


@dataclass(frozen=True, slots=True)
class UnitEvidence:
    """A unit on a line: `unit` to clients, `on_the_wire` there.

    `answered` includes `exceptions`; `late` answers came after the limit, the slowest one after `latest`. `limit` is
    the last one, 0 before the first request, and `limit_share` what 99 of 100 answers took of theirs. `twice` are
    answers that came a second time. `instead` is what was received lately in place of answers.
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
    limit: float = 0.0
    limit_share: float | None = None
    twice: int = 0
    instead: tuple[bytes, ...] = ()

    @property
    def asked(self) -> int:
        """Requests that were sent and have come to an end."""
        return self.answered + self.failed

    @property
    def failed(self) -> int:
        """Requests that were sent and not answered well in time."""
        return self.timeouts + self.bad_frames + self.ambiguous

    @property
    def is_silent(self) -> bool:
        """Whether it was asked and nothing at all has come of it."""
        return bool(self.timeouts) and not (self.answered or self.late or self.bad_frames or self.ambiguous)


@dataclass(frozen=True, slots=True)
class Search:
    """What was asked beyond the configured units, on a line where some are silent, and who has answered.

    `addresses` that are not configured were asked, and then one unit at so many other rates and formats (`speeds`).
    Without `has_parity` the port is a virtual one, where only rates can be tried.
    """

    addresses: tuple[int, ...] = ()
    found: tuple[int, ...] = ()
    speeds: int = 0
    has_parity: bool = True
    #: Rate and format at which a unit has answered, such as (9600, "8N1").
    speed: tuple[int, str] | None = None


@dataclass(frozen=True, slots=True)
class LineEvidence:
    """A line where the gateway asks. `reason` says why it is down, and is empty while it is up.

    `sent` requests have left; `copies` of them came back, `others` are requests of other clients that were heard.
    `errors` are what the driver says of received characters, None where it does not count them.
    """

    name: str
    source: str
    baud: int
    format: str
    reason: str = ""
    is_serial: bool = True
    echo: bool = False
    busy_share: float | None = None
    sent: int = 0
    copies: int = 0
    others: int = 0
    errors: CharacterErrors | None = None
    units: tuple[UnitEvidence, ...] = ()
    search: Search | None = None


@dataclass(frozen=True, slots=True)
class ClientEvidence:
    """Clients at one address that have left so often before their response came; the last one after `waited`.

    Its responses may take up to `longest_wait`.
    """

    host: str
    listener: str
    left: int
    waited: float
    longest_wait: float
