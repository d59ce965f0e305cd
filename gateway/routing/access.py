"""Who may do what: a table of rows, of which the first that means a client and a unit counts.

The table is turned into look-ups: `Rights` has for each client a tuple, and in that for each unit the functions that
the client may use there.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import lru_cache
from ipaddress import IPv4Address, IPv4Network, IPv6Address, IPv6Network, ip_address, ip_network
from typing import Final, Literal

from gateway.modbus.codes import BROADCAST_UNIT, FIRST_UNIT, LAST_UNIT
from gateway.modbus.functions import READING_FUNCTIONS, READING_IDENTIFICATION

Network = IPv4Network | IPv6Network

#: What may be asked of a unit: functions that are known to only read, by their number; others by how their requests
#: begin, because it can depend on more than the function. One look-up then tells that a request is a read, and allowed.
Right = frozenset[int | bytes]

NOTHING: Final[Right] = frozenset()
READING: Final[Right] = READING_FUNCTIONS | {READING_IDENTIFICATION}
#: Whatever is not known to only read.
WRITING: Final[Right] = frozenset(bytes((function,)) for function in range(256) if function not in READING_FUNCTIONS)
EVERYTHING: Final[Right] = READING | WRITING

#: Clients whose rights are remembered at a time. They come from anywhere, so there must be a bound.
MOST_CLIENTS: Final = 1000


def right_to(functions: Iterable[int]) -> Right:
    """The right to exactly these functions."""
    return frozenset(each if each in READING_FUNCTIONS else bytes((each,)) for each in functions)


@dataclass(frozen=True, slots=True)
class Row:
    """What clients from `networks` that come through `listeners` may do at `units`; None stands for all of them.

    `source` is its place in the config.
    """

    right: Right
    networks: tuple[Network, ...] | None = None
    listeners: frozenset[str] | None = None
    units: frozenset[int] | None = None
    source: str = field(default="", compare=False)

    def applies_to(self, address: IPv4Address | IPv6Address | None) -> bool:
        """Whether it is for a client from `address`; None is a client without one."""
        return self.networks is None or (address is not None and any(address in network for network in self.networks))


LOOPBACK: Final = (ip_network("127.0.0.0/8"), ip_network("::1"))

#: The table as long as nobody has written one: clients on this machine do everything, all others read.
DEFAULT_ROWS: Final = (Row(EVERYTHING, networks=LOOPBACK), Row(READING))


@dataclass(frozen=True, slots=True)
class EntryPoint:
    """Where clients come in. Their `name` for it is that of the listener, or of the line where we are a server.

    The address of a `datagram` can be forged. A `cable` is in the cabinet: whoever is on it has no address.
    `unit0` is the unit that stands in for unit 0; None when all of them are meant.
    """

    name: str
    kind: Literal["connection", "datagram", "local"] = "connection"
    unit0: int | None = None


#: For each unit identifier at a entry, the units by which clients at other doors know who answers there; none if they
#: do not. By these a row counts that names no listener. Unit 0 is there if it stands for somebody.
KnownAs = tuple[tuple[int, ...], ...]

_ALL_UNITS: Final = frozenset(range(FIRST_UNIT, LAST_UNIT + 1))

#: Every unit is known by its own number, as at all doors but those of one line. Nobody is unit 255.
AS_NUMBERED: Final[KnownAs] = tuple((unit,) if unit in _ALL_UNITS else () for unit in range(256))


class Rights(dict[str, tuple[Right, ...]]):
    """The rights at one entry: by the client's address, then by unit. They are found when a client first asks.

    "" is the address of a client that has none. An IPv4 address may look like an IPv6 one.

    Datagrams only read, except by a row that names their listener. Those on a cable do everything until a row names it.
    A request to all units needs the right at each of them. A row that names listeners counts by the unit identifiers
    there, any other row by what these units are `known_as`.
    """

    def __init__(self, rows: Iterable[Row], entry: EntryPoint, known_as: KnownAs = AS_NUMBERED) -> None:
        super().__init__()
        self._door = entry
        self._known_as = known_as
        self._rows = tuple(_rows_at(entry, tuple(rows)))
        self._named: set[str] = set()

    def admits(self, host: str) -> bool:
        """Whether a client from this address may do anything at all."""
        return any(self[host])

    def names(self, host: str) -> bool:
        """Whether a row gives rights to networks that this address is in: it is not one that anybody could have."""
        return self.admits(host) and host in self._named

    def __missing__(self, host: str) -> tuple[Right, ...]:
        if len(self) >= MOST_CLIENTS:
            self.clear()
            self._named.clear()
        address = _address(host)
        rows = tuple(row for row in self._rows if row.applies_to(address))
        if any(row.networks is not None and row.right for row in rows):
            self._named.add(host)
        rights = self[host] = _by_unit(rows, self._known_as, self._door.unit0)
        return rights


def _rows_at(entry: EntryPoint, rows: tuple[Row, ...]) -> Iterable[Row]:
    if entry.kind == "local" and not any(entry.name in (row.listeners or ()) for row in rows):
        return [Row(EVERYTHING)]
    here = [row for row in rows if row.listeners is None or entry.name in row.listeners]
    if entry.kind == "datagram":
        return [replace(row, right=_reading_of(row.right)) if row.listeners is None else row for row in here]
    return here


def _reading_of(right: Right) -> Right:
    """What of a right is known to change nothing. The right to all of function 43 is also one to identification."""
    return (right | {READING_IDENTIFICATION} if READING_IDENTIFICATION[:1] in right else right) & READING


@lru_cache(maxsize=256)
def _by_unit(rows: tuple[Row, ...], known_as: KnownAs, unit0: int | None) -> tuple[Right, ...]:
    """The right at each unit identifier, 0 to 255. Clients for whom the same rows are meant share it."""
    rights = [_right_at(identifier, units, rows) for identifier, units in enumerate(known_as)]
    everybody = [right for at, right in enumerate(rights) if at in _ALL_UNITS or known_as[at]]
    rights[BROADCAST_UNIT] = frozenset.intersection(*everybody) if unit0 is None else rights[unit0]
    return tuple(rights)


def _right_at(identifier: int, known_as: tuple[int, ...], rows: tuple[Row, ...]) -> Right:
    """The right by the first row that fits. Whoever is known by several units may be asked what is allowed at each."""
    right, *others = [
        next((row.right for row in rows if _fits(row, identifier, unit)), NOTHING) for unit in known_as or (None,)
    ]
    return right.intersection(*others) if others else right


def _fits(row: Row, identifier: int, unit: int | None) -> bool:
    """Whether a row means whom clients here call `identifier` and others `unit`, or do not know at all."""
    if row.units is None:
        return True
    if row.listeners is not None:
        return identifier in row.units
    return row.units >= _ALL_UNITS if unit is None else unit in row.units


def _address(host: str) -> IPv4Address | IPv6Address | None:
    if not host:
        return None
    address = ip_address(host)
    if isinstance(address, IPv6Address) and address.ipv4_mapped is not None:
        return address.ipv4_mapped
    return address
