"""Rights by address as an operator reads them: a second evaluation, address by address, that shares no code.

`Row.of` writes rows of `[[access]]` at random; `read_back` makes the same kind of rows of what `check` prints.
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from ipaddress import ip_address, ip_network
from random import Random

ONLY_READ = frozenset({1, 2, 3, 4, 7, 11, 12, 17, 20, 24})
AREA = {
    1: "coils", 2: "discrete", 3: "holding", 4: "input", 5: "coils", 6: "holding", 15: "coils", 16: "holding",
    22: "holding", 23: "holding",
}  # fmt: skip
AREAS = ("coils", "discrete", "holding", "input")
HOSTS = ("10.2.0.7", "10.2.1.9", "10.3.0.1", "192.168.1.1", "::ffff:10.2.0.7", "fd00::9")
NETWORKS = ("10.2.0.0/24", "10.2.0.7", "10.0.0.0/8", "0.0.0.0/0", "fd00::/8")
LISTENERS = ("scada", "field", "far")
ROLES = ("operator", "viewer", "")
UNITS = (1, 2, 3, 7, 42)
#: Where ranges begin and end, and requests: few places, so that they meet.
EDGES = (0, 1, 9, 10, 11, 50, 99, 100, 101, 300, 65534, 65535)
#: The units that a broadcast reaches.
EVERY_UNIT = range(1, 248)


@dataclass(frozen=True)
class Row:
    """A row as it is written; None where a key is missing."""

    networks: tuple[str, ...] | None
    role: str | None
    listeners: tuple[str, ...] | None
    units: frozenset[int] | None
    addresses: dict[str, tuple[tuple[int, int], ...]] | None
    allow: frozenset[str] | None
    functions: frozenset[int] | None

    @classmethod
    def at_random(cls, chance: Random) -> "Row":
        networks = tuple(chance.sample(NETWORKS, chance.randint(1, 2))) if chance.random() < 0.15 else None
        listeners = tuple(chance.sample(LISTENERS, chance.randint(1, 2))) if chance.random() < 0.25 else None
        units = frozenset(chance.sample(UNITS, chance.randint(1, 3))) if chance.random() < 0.15 else None
        addresses = None
        if chance.random() < 0.85:
            named = chance.sample(AREAS, chance.choice((1, 1, 1, 2, 4)))
            addresses = {area: _ranges(chance) for area in named}
        allow = frozenset(each for each in ("read", "write") if chance.random() < 0.7)
        functions = None
        if chance.random() < 0.3:
            functions = frozenset(chance.sample((1, 2, 3, 4, 5, 6, 8, 15, 16, 17, 22, 23, 43, 66, 100), 8))
        role = chance.choice(ROLES) if listeners in (None, ("far",)) and chance.random() < 0.3 else None
        return cls(networks, role, listeners, units, addresses, None if functions else allow, functions)

    def as_toml(self) -> str:
        keys = {
            "from": self.networks and list(self.networks),
            "role": self.role,
            "listen": self.listeners and list(self.listeners),
            "units": self.units and sorted(self.units),
            "allow": None if self.allow is None else sorted(self.allow),
            "functions": self.functions and sorted(self.functions),
        }
        for area, ranges in (self.addresses or {}).items():
            keys[area] = [f"{first}-{hex(last)}" for first, last in ranges]
        lines = [f"{key} = {value!r}" for key, value in keys.items() if value is not None]
        return "\n".join(["[[access]]", *lines, ""])

    def has(self, area: str, address: int) -> bool:
        if self.addresses is None:
            return True
        return any(first <= address <= last for first, last in self.addresses.get(area, ()))

    def fits_client(self, host: str, listener: str, role: str | None) -> bool:
        """`role` is None at a listener without certificates."""
        if self.listeners is not None and listener not in self.listeners:
            return False
        if role is None and self.role is not None:
            return False
        if role is not None and (self.role not in (None, role) or (self.role is None and self.listeners is None)):
            return False
        address = ip_address(host)
        address = getattr(address, "ipv4_mapped", None) or address
        return self.networks is None or any(address in ip_network(each) for each in self.networks)

    def fits_unit(self, unit: int, elsewhere: int | None) -> bool:
        """`elsewhere` is the number of the unit at other listeners, None if it has none."""
        if self.units is None:
            return True
        return (unit if self.listeners is not None else elsewhere) in self.units

    def allows(self, pdu: bytes, *, only_reading: bool) -> bool:
        """`only_reading`: datagrams write by rows only that name their listener."""
        reads = only_reads(pdu)
        if only_reading and self.listeners is None and not reads:
            return False
        if self.functions is not None:
            return pdu[0] in self.functions
        kinds = {"read", "write"} if pdu[:2] == b"\x2b\x0e" else {"read" if reads else "write"}
        return not kinds.isdisjoint(self.allow or ())


def _ranges(chance: Random) -> tuple[tuple[int, int], ...]:
    pairs = (sorted(chance.sample(EDGES, 2)) for _ in range(chance.randint(1, 2)))
    return tuple((first, last) if chance.random() < 0.8 else (first, first) for first, last in pairs)


def only_reads(pdu: bytes) -> bool:
    return pdu[0] in ONLY_READ or pdu[:2] == b"\x2b\x0e"


def addresses_of(pdu: bytes) -> list[tuple[str, int]]:
    """Every address of a request; none if it does not tell all of them."""
    function = pdu[0]
    if function not in AREA:
        return []
    if function in (5, 6, 22):
        spans = [(pdu[1:3], b"\0\1")]
    elif function == 23:
        spans = [(pdu[1:3], pdu[3:5]), (pdu[5:7], pdu[7:9])]
    else:
        spans = [(pdu[1:3], pdu[3:5])]
    if any(len(part) < 2 or count == b"\0\0" for start, count in spans for part in (start, count)):
        return []
    numbers = [(int.from_bytes(start, "big"), int.from_bytes(count, "big")) for start, count in spans]
    return [(AREA[function], (start + each) % 65536) for start, count in numbers for each in range(count)]


def is_allowed(rows: Iterable[Row], pdu: bytes, *, only_reading: bool = False) -> bool:
    """Decide by the rows that fit the client and the unit, in their order."""
    rows, addresses = list(rows), addresses_of(pdu)
    if addresses:
        return all(
            next((row.allows(pdu, only_reading=only_reading) for row in rows if row.has(*address)), False)
            for address in dict.fromkeys(addresses)
        )
    for row in rows:
        if row.addresses is None:
            return row.allows(pdu, only_reading=only_reading)
        if not only_reads(pdu) and not row.allows(pdu, only_reading=only_reading):
            return False
    return False


def any_request(chance: Random, function: int) -> bytes:
    """A request of this function, well-formed or not, at addresses that rows name."""
    start, count = chance.choice(EDGES), chance.choice((1, 1, 1, 2, 2, 3, 10, 120, 0, 2000))
    start = max(0, start - chance.randint(0, 2))
    span = start.to_bytes(2, "big") + count.to_bytes(2, "big")
    if function == 23:
        pdu = span + chance.choice(EDGES).to_bytes(2, "big") + chance.choice((b"\0\0", b"\0\1", b"\0\3")) + b"\2\0\0"
    elif function in (15, 16):
        pdu = span + b"\2\0\1"
    elif function == 43:
        pdu = chance.choice((b"\x0e\x01\x00", b"\x0d\x01\x00", b"\x0e"))
    else:
        pdu = span
    if chance.random() < 0.2:
        pdu = pdu[: chance.randrange(len(pdu) + 1)]
    return bytes((function,)) + pdu


#: What a table of `check` says in each column.
_HEAD = re.compile(r"FROM +|THROUGH +|UNITS +|ADDRESSES +|RIGHTS *|PRIORITY *")


def read_back(said: str) -> list[Row]:
    """Read the rows out of the words of `check`, without those that are none of `[[access]]`."""
    _, head, *lines = said.splitlines()
    places = {match[0].strip(): match.span() for match in _HEAD.finditer(head + " " * max(map(len, lines)))}
    found = []
    for line in lines:
        if line.startswith(("  Through", "  At each", "  What may")):
            break
        cells = {
            name: line[start : None if name == [*places][-1] else end].strip() for name, (start, end) in places.items()
        }
        if cells["FROM"] not in ("all else", "the line"):
            found.append(_row_of(cells))
    return found


def _row_of(cells: dict[str, str]) -> Row:
    place, _, role = cells["FROM"].partition(', role "')
    role = role.rstrip('"') or None
    if place.endswith(", without a role"):
        place, role = place.removesuffix(", without a role"), ""
    may = cells["RIGHTS"]
    functions = frozenset(_numbers(may.removeprefix("functions"))) if may.startswith("functions") else None
    allow = frozenset() if may == "nothing" else frozenset(may.split(", "))
    named = cells.get("ADDRESSES", "all")
    addresses = None
    if named != "all":
        parts = (part.partition(" ") for part in named.split("; "))
        addresses = {area: tuple(map(_range, ranges.split(", "))) for area, _, ranges in parts}
    return Row(
        None if place == "anywhere" else tuple(place.split(", ")),
        role,
        None if cells["THROUGH"] == "any listener" else tuple(cells["THROUGH"].split(", ")),
        None if cells["UNITS"] == "all" else frozenset(_numbers(cells["UNITS"])),
        addresses,
        None if functions else allow,
        functions,
    )


def _range(text: str) -> tuple[int, int]:
    first, _, last = text.strip().partition("-")
    return int(first), int(last or first)


def _numbers(text: str) -> Sequence[int]:
    return [each for part in text.split(",") for first, last in [_range(part)] for each in range(first, last + 1)]
