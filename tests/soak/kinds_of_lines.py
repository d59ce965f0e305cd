"""The lines of the soak that looks for lies: RTU and ASCII, real, virtual, a device server, with and without echo."""

from dataclasses import dataclass
from math import inf
from typing import Final

from gateway.timing.characters import CharacterFormat, LineTiming

UNITS: Final = range(1, 9)
#: Units 7 and 8 may take so many times as long as the others.
SLOW: Final = 4


@dataclass(frozen=True)
class LineKind:
    """One line of the soak. `real` ports take time to send, as a UART does. `port` is that of a device server.

    Its devices sleep after `wake` seconds without a request. It `stalls` at this share of the requests.
    """

    name: str
    timing: LineTiming
    timeout: float
    real: bool = True
    echo: bool = False
    late_window: float | None = None
    more: str = ""
    port: str = ""
    stalls: float = 0.3
    wake: float = inf

    @property
    def config(self) -> str:
        """Its table in the config file; clients know unit 3 of the second line as 13."""
        first = 10 * LINES.index(self)
        window = "" if self.late_window is None else f'late_window = "{1000 * self.late_window:g} ms"'
        wake = "" if self.wake == inf else f'wake = "{1000 * self.wake:g} ms"'
        return f"""
            [[line]]
            name    = "{self.name}"
            port    = "{self.port or "/dev/" + self.name}"
            mode    = "{self.timing.mode}"
            baud    = {self.timing.baud}
            format  = "{self.timing.format}"
            latency = "5 ms"
            echo    = {str(self.echo).lower()}
            devices = [
              {{ unit = 1, as = {first + 1}, timeout = "{1000 * self.timeout:g} ms", priority = "high" }},
              {{ unit = "2-6", as = "{first + 2}-{first + 6}", timeout = "{1000 * self.timeout:g} ms" }},
              {{ unit = "7-8", as = "{first + 7}-{first + 8}", timeout = "{1000 * SLOW * self.timeout:g} ms" }},
            ]
            {window}
            {wake}
            {self.more}
            """


RTU, ASCII = CharacterFormat.parse("8E1"), CharacterFormat.parse("7E1")
LINES: Final = (
    LineKind("rtu", LineTiming("rtu", 19200, RTU), 0.05),
    LineKind("rtu-retries", LineTiming("rtu", 9600, RTU), 0.08, more="retries = 1\nqueue = 12"),
    LineKind("rtu-virtual", LineTiming("rtu", 115200, RTU), 0.03, real=False, late_window=0.3, wake=0.1),
    LineKind("rtu-echo", LineTiming("rtu", 38400, RTU), 0.04, echo=True),
    LineKind("ascii", LineTiming("ascii", 19200, ASCII), 0.05),
    LineKind("ascii-echo", LineTiming("ascii", 38400, ASCII), 0.1, echo=True, more="coalesce = false\nretries = 1"),
    LineKind("rtu-server", LineTiming("rtu", 19200, RTU), 0.05, real=False, port="rtu+tcp://10.0.0.9:4001"),
    LineKind(
        "rtu-idle",
        LineTiming("rtu", 19200, RTU),
        0.05,
        real=False,
        more='idle = "1 ms"',
        port="rtu+tcp://10.0.0.8:4001",
        stalls=0.0,
        wake=0.1,
    ),
)
#: With a point its last reads are kept of each device, for whoever wants to see values.
_HEAD: Final = """
[[listen]]
bind = "tcp://127.0.0.1:0"
unit0 = "broadcast"
[profile.generic]
points = [{ name = "first", holding = 0 }]
"""
CONFIG: Final = _HEAD + "".join(line.config for line in LINES)
#: Of each unit that clients use: its device's number.
NUMBERS: Final = {10 * at + unit: len(UNITS) * at + unit - 1 for at in range(len(LINES)) for unit in UNITS}
