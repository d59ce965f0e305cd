"""The register map of the gateway's own unit, and the source of docs/own-registers.md.

`python -m gateway.images.self_map` prints that page. Each part has its own place, which does not move when the config
gets more lines: parts are counted in the order of the file, and a new one at its end takes the next place.
"""

import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from gateway.images.services import BUS_BUSY, BUS_MESSAGES, COMMUNICATION_ERRORS, NO_RESPONSES
from gateway.modbus.codes import Area
from gateway.profiles.point import Point
from gateway.profiles.profile import Profile, Range
from gateway.registers.datatypes import encode, registers_of

#: The version of the map, at register 0; it changes only when the meaning of a register does.
LAYOUT: Final = 1
#: The most lines, server lines and upstreams that have a place.
PLACES: Final = 100
#: Registers of each place.
PLACE_SIZE: Final = 50
#: The most characters of a name.
_NAME_LENGTH: Final = 32

PROFILE: Final = Profile("self", "The gateway itself", functions=frozenset({3, 4, 8, 11, 12, 17, 43}))

STATES: Final = {0: "none", 1: "up", 2: "down", 3: "not tried"}


@dataclass(frozen=True, slots=True)
class Register:
    """A value: its place in its table, its name, its data type, and its meaning."""

    at: int
    name: str
    type: str
    what: str
    unit: str = ""
    labels: Mapping[int, str] = field(default_factory=dict)

    @property
    def count(self) -> int:
        """Number of its registers."""
        return _NAME_LENGTH // 2 if self.type == "string" else registers_of(self.type)

    def point(self, start: int, prefix: str) -> Point:
        """Make the point for `read`, in the table that begins at `start`."""
        return Point(
            prefix + self.name, Area.HOLDING, start + self.at, self.type, count=self.count, unit=self.unit,
            labels=self.labels,
        )  # fmt: skip


GATEWAY: Final = (
    Register(0, "layout", "uint16", f"{LAYOUT}: this map"),
    Register(1, "trouble", "uint16", "1 while a line of any role or an upstream is down or a unit does not answer"),
    Register(2, "uptime", "uint32", "Time since the gateway was started", "s"),
    Register(4, "lines", "uint16", "Lines on which the gateway is the client"),
    Register(5, "lines-down", "uint16", "Those of them that are down"),
    Register(6, "server-lines", "uint16", "Lines on which the gateway is the server"),
    Register(7, "server-lines-down", "uint16", "Those of them that are down"),
    Register(8, "upstreams", "uint16", "Other servers"),
    Register(9, "upstreams-down", "uint16", "Those of them without a connection"),
    Register(10, "units", "uint16", "Units on lines and behind upstreams"),
    Register(11, "units-failing", "uint16", "Those whose last request failed, that back off, or whose line is down"),
    Register(12, "clients", "uint16", "Clients that are connected"),
    Register(13, "reload-failed", "uint16", "1 if the config file was rejected the last time it was read"),
    Register(14, "loop-lag", "uint16", "Largest delay of the gateway in the last minute", "ms"),
    Register(16, "answered", "uint32", "Requests that units have answered, exceptions included"),
    Register(18, "failed", "uint32", "Requests without a valid response, or not sent"),
)
LINE: Final = (
    Register(0, "state", "uint16", "State of the line", labels=STATES),
    Register(1, "busy", "uint16", "Share of the last minute in which it was busy; 65535: not known yet", "0.1 %"),
    Register(2, "rate", "uint16", "Frames sent per second in the last minute; 65535: not known yet", "0.1/s"),
    Register(3, "waiting", "uint16", "Requests that wait"),
    Register(4, "units", "uint16", "Its units"),
    Register(5, "units-failing", "uint16", "Those whose last request failed, that back off, or whose line is down"),
    Register(6, "answered", "uint32", "Requests that its units have answered"),
    Register(8, "exceptions", "uint32", "Those of them that were answered with an exception"),
    Register(10, "timeouts", "uint32", "Requests without any response"),
    Register(12, "bad-frames", "uint32", "Requests with nothing but damaged or foreign responses"),
    Register(14, "late", "uint32", "Responses after their request had failed"),
    Register(16, "line-down", "uint32", "Requests that failed because the line was down or went down"),
    Register(18, "refused-busy", "uint32", "Requests that found the queue full, or waited too long"),
    Register(20, "resting", "uint32", "Requests to units that back off after failures"),
    Register(22, "reopened", "uint32", "How often its port was opened again"),
    Register(24, "silent-for", "uint32", "Time since the last answer of any unit; 4294967295: none yet", "s"),
    Register(30, "name", "string", "Its name"),
)
SERVER: Final = (
    Register(0, "state", "uint16", "State of the line", labels=STATES),
    Register(2, "requests", "uint32", "Requests for units that it serves"),
    Register(4, "responses", "uint32", "Responses that were sent"),
    Register(30, "name", "string", "Its name"),
)
UPSTREAM: Final = (
    Register(0, "state", "uint16", "State of the connection", labels=STATES),
    Register(3, "waiting", "uint16", "Requests that wait"),
    Register(4, "units", "uint16", "Units behind it"),
    Register(5, "units-failing", "uint16", "Those whose last request failed, that back off, or whose line is down"),
    Register(6, "answered", "uint32", "Requests that its units have answered"),
    Register(8, "exceptions", "uint32", "Those of them that were answered with an exception"),
    Register(10, "timeouts", "uint32", "Requests without any response"),
    Register(22, "reopened", "uint32", "How often it was connected again"),
    Register(30, "name", "string", "Its name"),
)


class Section(NamedTuple):
    """Parts of one kind: `states` is the address of their states, one register each, `start` that of the first part."""

    title: str
    states: int
    start: int
    registers: tuple[Register, ...]

    def place(self, number: int) -> int:
        """Return the address of a part's registers."""
        return self.start + PLACE_SIZE * number


LINES: Final = Section("Lines", 100, 1000, LINE)
SERVERS: Final = Section("Server lines", 200, 10000, SERVER)
UPSTREAMS: Final = Section("Upstreams", 300, 20000, UPSTREAM)
SECTIONS: Final = (LINES, SERVERS, UPSTREAMS)

#: The bits of units that do not answer; unit 0 would be the lowest bit of the first register.
FAILING_UNITS: Final = 80
_UNIT_REGISTERS: Final = 16

#: The addresses that exist, as holding and as input registers: all places, also unused ones.
RANGES: Final[tuple[Range, ...]] = (
    (0, 399),
    *((section.start, section.start + PLACES * PLACE_SIZE - 1) for section in SECTIONS),
)

#: Values by the names of their registers.
Values = Mapping[str, int | str]


class Shown(NamedTuple):
    """The values of the registers: of the gateway, and of each part in its section; units that do not answer.

    `counters` are the counters of function 08 about the lines.
    """

    gateway: Values
    parts: Mapping[str, tuple[Values, ...]]
    failing_units: Iterable[int]
    counters: Mapping[int, int]


def registers(shown: Shown) -> Iterator[tuple[int, bytes]]:
    """Yield runs of registers with their addresses, encoded as in a response. All other registers are 0."""
    yield 0, _table(GATEWAY, shown.gateway)
    bits = sum(1 << unit for unit in set(shown.failing_units))
    yield FAILING_UNITS, b"".join((bits >> 16 * at & 0xFFFF).to_bytes(2, "big") for at in range(_UNIT_REGISTERS))
    for section in SECTIONS:
        parts = shown.parts.get(section.title, ())[:PLACES]
        yield section.states, b"".join(int(part["state"]).to_bytes(2, "big") for part in parts)
        for number, part in enumerate(parts):
            yield section.place(number), _table(section.registers, part)


def points(names: Mapping[str, Iterable[str]]) -> tuple[Point, ...]:
    """Make the points of the existing parts, given by their names under the titles of their sections."""
    found = [register.point(0, "") for register in GATEWAY]
    for section in SECTIONS:
        for number, name in zip(range(PLACES), names.get(section.title, ()), strict=False):
            place = section.place(number)
            found += (register.point(place, f"{name}.") for register in section.registers)
    return tuple(found)


def _table(table: Iterable[Register], values: Values) -> bytes:
    data = bytearray()
    for register in table:
        data += bytes(2 * register.at - len(data))
        data += _encoded(register, values[register.name])
    return bytes(data)


def _encoded(register: Register, value: int | str) -> bytes:
    """Encode a value. A number that is too large becomes the largest one; a counter wraps around."""
    if isinstance(value, str):
        return encode(value.encode("ascii", "replace").decode()[:_NAME_LENGTH], "string", "none", register.count)
    if register.type == "uint32":
        return (value & 0xFFFFFFFF).to_bytes(4, "big")
    return min(value, 0xFFFF).to_bytes(2, "big")


_OPENING: Final = """\
# The gateway as a device

<!-- Made by `python -m gateway.images.self_map` from gateway/images/self_map.py: change the text there. -->

```toml
[self]
unit = 246
```

The gateway then answers as unit 246 itself, so that a PLC or an HMI can show that a line is down. It is read-only:
functions 03 and 04 read the same registers, 08 has counters, 43/14 says who it is, and 11, 12 and 17 work as for any
image. Others are answered 01. Access rights apply as for any unit; 08 needs the right to write, because it can clear
counters.

`modbus-gateway read gateway` shows all of it with names.

- Addresses count from 0, as everywhere here: address 100 is 40101 or 30101. In values of 32 bits the first register has
  the high word.
- Values are at most {freshness} old, and all values of one request are of the same moment.
- Counters count from the start of the gateway and wrap around.
- Lines, server lines and upstreams have places in the order of the config file. Add new ones at the end of the file, so
  that no place moves. Unused places are 0. The first {places} of each kind have a place.
"""


def document() -> str:
    """Return the text of docs/own-registers.md."""
    opening = _OPENING.format(freshness=f"{1000 * FRESHNESS:.0f} ms", places=PLACES)
    gateway = f"## The gateway: registers 0-79\n\n{_rows(GATEWAY)}"
    return "\n".join([opening, gateway, _document_units(), _document_states(), *map(_document, SECTIONS), _COUNTERS])


def _document_units() -> str:
    last = FAILING_UNITS + _UNIT_REGISTERS - 1
    return f"""\
## Units that do not answer: registers {FAILING_UNITS}-{last}

One bit for each unit ID: that of unit *n* is bit *n* modulo 16 (0 is the lowest) of register
{FAILING_UNITS} + *n* / 16. It is 1 while the unit does not answer.
"""


def _document_states() -> str:
    rows = "\n".join(f"| {one.states}-{one.states + PLACES - 1} | {one.title} |" for one in SECTIONS)
    return f"""\
## All states at once

One register for each line, server line and upstream:
{", ".join(f"{number} {name}" for number, name in STATES.items())}.

| registers | |
|---|---|
{rows}
"""


def _document(section: Section) -> str:
    return f"""\
## {section.title}: {PLACE_SIZE} registers each, from {section.start} on

The first one begins at {section.start}, the second at {section.place(1)}, and so on. Add these numbers to that address:

{_rows(section.registers)}"""


_COUNTERS: Final = f"""\
## Counters of function 08

They have 16 bits; sub-function 0A clears them, for this function only.

| sub-function | |
|---|---|
| {BUS_MESSAGES:02X} | frames that were sent on all lines, and valid responses |
| {COMMUNICATION_ERRORS:02X} | requests with nothing but damaged or foreign responses |
| 0D | exceptions that this unit has answered |
| 0E | requests to this unit |
| {NO_RESPONSES:02X} | requests without any response |
| 10 | always 0 |
| {BUS_BUSY:02X} | requests that found a queue full, or waited too long |
| 12 | always 0 |
"""

#: Values are updated after this many seconds.
FRESHNESS: Final = 0.2


def _rows(table: Iterable[Register]) -> str:
    rows = [f"| {_span(one)} | `{one.name}` | {one.type} | {one.unit} | {one.what} |\n" for one in table]
    return "".join(["| register | name | type | unit | |\n|---|---|---|---|---|\n", *rows])


def _span(one: Register) -> str:
    return str(one.at) if one.count == 1 else f"{one.at}-{one.at + one.count - 1}"


if __name__ == "__main__":
    sys.stdout.write(document())
