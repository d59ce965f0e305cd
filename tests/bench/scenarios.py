"""What is measured: lines, devices, clients, and what the figures should be."""

from dataclasses import dataclass, replace


@dataclass(frozen=True, kw_only=True)
class Goal:
    """A bound for one of the figures of `measure.py`, from above or from below."""

    figure: str
    most: float | None = None
    least: float | None = None

    def is_met(self, value: float) -> bool:
        return (self.most is None or value <= self.most) and (self.least is None or value >= self.least)

    def __str__(self) -> str:
        return f">= {self.least:g}" if self.most is None else f"<= {self.most:g}"


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """`clients` read `count` holding registers of the `units` (1 to 20) of each line, one request after the other.

    Without `baud` the lines carry bytes at once, and nothing is waited for between frames: what is left is the
    gateway's own work. With it they are paced as lines of 10 bits a character. Times in milliseconds, `seconds` and
    `warmup` in seconds.
    """

    what: str
    clients: int
    #: How many requests each client has under way.
    in_flight: int = 1
    #: How many requests may wait for a line, if not all. Who is refused asks again at once.
    queue: int = 0
    #: A request that is not answered within so many seconds is lost. Two may pass where a unit of the line is dead.
    patience: float = 5.0
    #: What clients speak: `tcp`, `udp` or `rtu+tcp`.
    speak: str = "tcp"
    lines: int = 1
    #: Whether the lines are behind another Modbus TCP server; it is the bare relay.
    behind_server: bool = False
    baud: int = 0
    is_ascii: bool = False
    units: str = "1-8"
    count: int = 10
    #: The unit that never answers, and the line on which none does.
    dead: int | None = None
    dead_line: int | None = None
    #: Pause before a client's next request, and before that after an exception.
    think: float = 0.0
    think_after_exception: float = 0.0
    #: Each client keeps to one unit; all read the same address; answers must be younger than their questions.
    sticky: bool = False
    same_read: bool = False
    #: Connections that never ask anything.
    idle: int = 0
    timeout: int = 500
    coalesce: bool = False
    warmup: float = 0.5
    seconds: float = 3.0
    #: Whether a client on the line itself is measured too.
    has_direct: bool = False
    goals: tuple[Goal, ...] = ()

    @property
    def line_step(self) -> int:
        """Clients ask for unit u of line i as `line_step` * i + u: there are 247 units for all lines."""
        return 20 if self.lines <= 12 else 240 // self.lines

    @property
    def for_relay(self) -> "Scenario":
        """The same as a relay can be asked, which speaks Modbus TCP and has no time-outs: only living units,
        and no request is refused."""
        lines, seconds = self._living_lines, min(10.0, self.seconds)
        clients = self.clients * lines // self.lines
        living = replace(self, lines=lines, clients=clients, dead=None, dead_line=None)
        return replace(living, in_flight=1, queue=0, speak="tcp", warmup=0.5, seconds=seconds)

    def lives(self, known_as: int) -> bool:
        """Whether the unit that clients ask for by this number answers."""
        line, unit = divmod(known_as - 1, self.line_step)
        return line != self.dead_line and unit + 1 != self.dead

    @property
    def _living_lines(self) -> int:
        return self.lines - (self.dead_line is not None)

    @property
    def line_limit(self) -> float:
        """Transactions a second that all lines with a living unit can carry, 0 when they are not paced.

        Request and response, and in RTU t3.5 twice: before the request, and after it, by which a device sees its end.
        """
        if not self.baud:
            return 0.0
        character = 10 / self.baud
        if self.is_ascii:
            return self._living_lines / ((17 + 11 + 4 * self.count) * character)
        silence = 0.00175 if self.baud > 19200 else 3.5 * character
        return self._living_lines / ((8 + 5 + 2 * self.count) * character + 2 * silence)


def _paced(baud: int) -> Scenario:
    goals = (
        Goal(figure="of_line", least=0.965 if baud > 19200 else 0.98),
        Goal(figure="x_relay", most=2.5),
        Goal(figure="x_each_byte", most=1.2),
    )
    return Scenario(what=f"4 clients, a line of {baud} baud", clients=4, baud=baud, seconds=4, goals=goals)


def _refused(clients: int, queue: int, in_flight: int) -> Scenario:
    return Scenario(
        what=f"{clients} clients, {in_flight} requests each; {queue} may wait, who is refused asks again at once",
        clients=clients,
        in_flight=in_flight,
        queue=queue,
        baud=19200,
        seconds=4,
        patience=5.0 if queue < 200 else 30.0,
        goals=(Goal(figure="of_line", least=0.98),),
    )


_BELOW = Goal(figure="below_relay", most=0.02)
_ONE_DEAD = Scenario(
    what="10 clients, one unit each; 1 unit of 10 is dead",
    clients=10,
    baud=19200,
    units="1-10",
    dead=10,
    sticky=True,
    think_after_exception=20,
    timeout=1000,
    warmup=12,
    seconds=30,
    goals=(Goal(figure="of_relay", least=0.9),),
)

SCENARIOS: dict[str, Scenario] = {
    "ports8": Scenario(
        what="64 clients, 8 lines, unpaced", clients=64, lines=8, goals=(Goal(figure="x_relay", most=2.6),)
    ),
    "port1": Scenario(what="16 clients, 1 line, unpaced", clients=16),
    "rtutcp1": Scenario(what="the same, clients speak RTU over TCP", clients=16, speak="rtu+tcp"),
    "udp1": Scenario(what="the same, clients speak Modbus UDP", clients=16, speak="udp"),
    "upstream1": Scenario(what="the same, the line is behind another server", clients=16, behind_server=True),
    "registers125": Scenario(what="16 clients, 1 line, unpaced, 125 registers each", clients=16, count=125),
    "ports8x512": Scenario(what="512 clients, 8 lines, unpaced", clients=512, lines=8),
    "ports32": Scenario(what="256 clients, 32 lines, unpaced", clients=256, lines=32, units="1-7"),
    "latency": Scenario(
        what="1 client, 50 requests a second, unpaced",
        clients=1,
        think=20,
        seconds=5,
        has_direct=True,
        goals=(Goal(figure="added", most=0.3), Goal(figure="tail", most=0.7)),
    ),
    "latency19200": Scenario(
        what="1 client, a line of 19200 baud, pauses",
        clients=1,
        baud=19200,
        think=20,
        seconds=5,
        has_direct=True,
        goals=(Goal(figure="added", most=0.4), Goal(figure="tail", most=1.5)),
    ),
    "line9600": _paced(9600),
    "line19200": _paced(19200),
    "line115200": _paced(115200),
    "ascii19200": replace(_paced(19200), what="4 clients, an ASCII line of 19200 baud", is_ascii=True),
    "lines8": Scenario(what="32 clients, 8 lines of 19200 baud", clients=32, lines=8, baud=19200, seconds=4),
    "lines32": Scenario(
        what="128 clients, 32 lines of 19200 baud",
        clients=128,
        lines=32,
        baud=19200,
        units="1-7",
        seconds=4,
        goals=(_BELOW,),
    ),
    "lines64": Scenario(
        what="2000 clients, 64 lines of 19200 baud",
        clients=2000,
        lines=64,
        baud=19200,
        units="1-3",
        seconds=6,
        warmup=4,
        goals=(_BELOW,),
    ),
    "ports64": Scenario(
        what="2000 clients, 64 lines, unpaced", clients=2000, lines=64, units="1-3", seconds=6, warmup=4
    ),
    "refused32": _refused(32, queue=64, in_flight=16),
    "refused128": _refused(128, queue=64, in_flight=16),
    "refused1000": _refused(1000, queue=1000, in_flight=2),
    "same16": Scenario(
        what="16 clients read the same of one unit, shared",
        clients=16,
        baud=19200,
        units="1",
        same_read=True,
        coalesce=True,
        seconds=4,
    ),
    "dead": _ONE_DEAD,
    "dead1": replace(
        _ONE_DEAD, what="1 client polls 10 units, 1 of them is dead", clients=1, sticky=False, think_after_exception=0
    ),
    "deadport": Scenario(
        what="16 clients, 8 lines of 19200 baud, 1 of them dead",
        clients=16,
        lines=8,
        baud=19200,
        units="1",
        dead_line=0,
        think_after_exception=20,
        timeout=1000,
        warmup=5,
        seconds=6,
        goals=(Goal(figure="of_relay", least=0.95),),
    ),
    "idle1000": Scenario(
        what="16 clients beside 1000 idle connections, unpaced",
        clients=16,
        idle=1000,
        goals=(Goal(figure="memory", most=128), Goal(figure="memory_each", most=20)),
    ),
}

#: Those of docs/performance.md.
TABLE = (
    *("latency", "latency19200", "line9600", "line19200", "line115200", "ascii19200"),
    *("lines8", "lines32", "lines64", "ports8", "port1", "ports64"),
    *("refused32", "refused128", "refused1000"),
)
