"""The rights of clients: a table whose first row that applies to a client and a unit counts.

`Rights` turns the table into look-ups: for each client a tuple with the allowed functions at each unit.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import lru_cache
from ipaddress import IPv4Address, IPv4Network, IPv6Address, IPv6Network, ip_address, ip_network
from typing import Final, Literal

from gateway.modbus.codes import BROADCAST_UNIT, FIRST_UNIT, HIGHEST_UNIT, LAST_UNIT
from gateway.modbus.functions import READING_FUNCTIONS, READING_IDENTIFICATION

Network = IPv4Network | IPv6Network

#: The allowed requests to a unit: functions that only read by number, others by the first bytes of their requests,
#: because a right may depend on more than the function. So one look-up shows that a request is a read, and allowed.
Right = frozenset[int | bytes]

NOTHING: Final[Right] = frozenset()
READING: Final[Right] = READING_FUNCTIONS | {READING_IDENTIFICATION}
#: Everything that is not known to only read.
WRITING: Final[Right] = frozenset(bytes((function,)) for function in range(256) if function not in READING_FUNCTIONS)
EVERYTHING: Final[Right] = READING | WRITING

#: The most clients whose rights are cached, and the most roles.
MOST_CLIENTS: Final = 1000
MOST_ROLES: Final = 100


def right_to(functions: Iterable[int]) -> Right:
    """Make the right to exactly these functions."""
    return frozenset(each if each in READING_FUNCTIONS else bytes((each,)) for each in functions)


@dataclass(frozen=True, slots=True)
class AccessRow:
    """The right of clients from `networks` at `listeners` to `units`; None means all of them. `sites` are clients too.

    `role` is the role in the certificate of a TLS client, NULL_ROLE if it has none. A row without `role` is for
    certificates of any role, but only at listeners that it names, unless it is `for_all`. `source` is its place in the
    config.
    """

    right: Right
    networks: tuple[Network, ...] | None = None
    listeners: frozenset[str] | None = None
    units: frozenset[int] | None = None
    source: str = field(default="", compare=False)
    role: str | None = None
    for_all: bool = False
    sites: frozenset[str] = frozenset()

    def applies_to(self, client: "Client") -> bool:
        """Tell whether it applies to a client by its address, to one without (None), or to a site by its name."""
        if self.networks is None or client is None:
            return self.networks is None
        return client in self.sites if isinstance(client, str) else any(client in each for each in self.networks)


#: A client by its address, a site by its name, or None.
Client = IPv4Address | IPv6Address | str | None


LOOPBACK: Final = (ip_network("127.0.0.0/8"), ip_network("::1"))

#: The default table: clients on this machine can read and write, all others only read, TLS clients from everywhere.
DEFAULT_ROWS: Final = (AccessRow(EVERYTHING, networks=LOOPBACK), AccessRow(READING, for_all=True))


@dataclass(frozen=True, slots=True)
class EntryPoint:
    """A place where clients connect. `name` is the name of the listener or the server line.

    The source address of a `datagram` can be forged. `local` clients, on a serial line or the control socket, have no
    address. `certified` clients have shown a certificate. A `site` is known by its name. `unit0` is the unit that unit
    0 stands for; None for all units.
    """

    name: str
    kind: Literal["connection", "datagram", "local", "certified", "site"] = "connection"
    unit0: int | None = None


#: Stands for the devices without a unit that clients use: only rows for all units apply to them.
NO_UNIT: Final = HIGHEST_UNIT + 1

#: For each unit identifier at an entry point, and NO_UNIT, the unit identifiers of the same devices at other entry
#: points. Rows without a listener apply to these. Unit 0 has some if it stands for a unit, NO_UNIT for a device.
KnownAs = tuple[tuple[int, ...], ...]

_ALL_UNITS: Final = frozenset(range(FIRST_UNIT, LAST_UNIT + 1))

#: The usual case: every unit has the same number everywhere. Entry points for a single line may differ.
AS_NUMBERED: Final[KnownAs] = tuple((unit,) if unit in _ALL_UNITS else () for unit in range(NO_UNIT + 1))


class Rights(dict[str, tuple[Right, ...]]):
    """The rights at one entry point, by address and then by unit. They are computed at a client's first request.

    The address is "" for a client without one, and the name for a site. An IPv4 address may be written as an IPv6 one.

    Datagrams and sites can only read, except by a row that names their listener. Local clients can do everything until
    a row names their entry point. A broadcast needs the right to each unit. A row with listeners applies to the unit
    identifiers there, any other row to their `known_as`.

    For certified clients ask `of_role`; these rights themselves belong to no role, and only tell whom the listener
    `admits`.
    """

    def __init__(self, rows: Iterable[AccessRow], entry: EntryPoint, known_as: KnownAs = AS_NUMBERED) -> None:
        super().__init__()
        self._entry = entry
        self._known_as = known_as
        self._rows = tuple(_rows_at(entry, tuple(rows)))
        self._named: set[str] = set()
        self._roles: dict[str, Rights] = {}

    def of_role(self, role: str) -> "Rights":
        """Return the rights of certified clients with this role."""
        rights = self._roles.get(role)
        if rights is None:
            if len(self._roles) >= MOST_ROLES:
                self._roles.clear()
            rows = (row for row in self._rows if row.role in (None, role))
            rights = self._roles[role] = Rights(rows, self._entry, self._known_as)
        return rights

    def admits(self, host: str) -> bool:
        """Tell whether a client from this address has any right; one with a certificate, if it had the right role."""
        if any(self[host]):
            return True
        client = self._client(host)
        return self._entry.kind == "certified" and any(row.right and row.applies_to(client) for row in self._rows)

    def names(self, host: str, role: str | None = None) -> bool:
        """Tell whether a row gives rights to a network with this address; to this role, for a certified client."""
        if role is not None:
            return self.of_role(role).names(host)
        return self.admits(host) and host in self._named

    def allows(self, host: str, unit: int, function: int) -> bool:
        """Tell whether a client from this address may use a function of a unit; 43 for reading the identification."""
        right, begin = self.at(host, unit), bytes((function,))
        is_identification = begin == READING_IDENTIFICATION[:1] and READING_IDENTIFICATION in right
        return function in right or begin in right or is_identification

    def at(self, host: str, unit: int) -> Right:
        """Return the right of a client from this address to a unit, or to a device by its `key_of` above all units."""
        return self[host][min(unit, NO_UNIT)]

    def rows_for(self, host: str, unit: int) -> tuple[AccessRow, ...]:
        """Find the rows that give a client from this address its rights to a unit other than 0.

        Usually one; several if the unit has several numbers elsewhere; none if no row applies.
        """
        client, unit = self._client(host), min(unit, NO_UNIT)
        rows = [row for row in self._rows if row.applies_to(client)]
        found = [
            next((row for row in rows if _fits(row, unit, other)), None) for other in self._known_as[unit] or (None,)
        ]
        return tuple(dict.fromkeys(row for row in found if row is not None))

    def __missing__(self, host: str) -> tuple[Right, ...]:
        if len(self) >= MOST_CLIENTS:
            self.clear()
            self._named.clear()
        client = self._client(host)
        rows = tuple(row for row in self._rows if row.applies_to(client))
        if any(row.networks is not None and row.right for row in rows):
            self._named.add(host)
        rights = self[host] = _by_unit(rows, self._known_as, self._entry.unit0)
        return rights

    def _client(self, host: str) -> Client:
        return host if self._entry.kind == "site" else _address(host)


def _rows_at(entry: EntryPoint, rows: tuple[AccessRow, ...]) -> Iterable[AccessRow]:
    if entry.kind == "local" and not any(row.role is None and entry.name in (row.listeners or ()) for row in rows):
        return [AccessRow(EVERYTHING)]
    here = [row for row in rows if row.listeners is None or entry.name in row.listeners]
    if entry.kind == "certified":
        return [row for row in here if row.role is not None or row.listeners is not None or row.for_all]
    here = [row for row in here if row.role is None]
    if entry.kind == "site" and not any(row.listeners for row in here):
        return [AccessRow(READING)]
    if entry.kind in ("datagram", "site"):
        return [replace(row, right=_reading_of(row.right)) if row.listeners is None else row for row in here]
    return here


def _reading_of(right: Right) -> Right:
    """Return the part of a right that only reads. The right to function 43 includes identification."""
    return (right | {READING_IDENTIFICATION} if READING_IDENTIFICATION[:1] in right else right) & READING


@lru_cache(maxsize=256)
def _by_unit(rows: tuple[AccessRow, ...], known_as: KnownAs, unit0: int | None) -> tuple[Right, ...]:
    """Compute the right at each unit identifier, and at NO_UNIT. Clients with the same rows share the result."""
    rights = [_right_at(identifier, units, rows) for identifier, units in enumerate(known_as)]
    all_units = [right for at, right in enumerate(rights) if at in _ALL_UNITS or known_as[at]]
    rights[BROADCAST_UNIT] = frozenset.intersection(*all_units) if unit0 is None else rights[unit0]
    return tuple(rights)


def _right_at(identifier: int, known_as: tuple[int, ...], rows: tuple[AccessRow, ...]) -> Right:
    """Return the right by the first row that applies. With several unit numbers, only what each of them allows."""
    right, *others = [
        next((row.right for row in rows if _fits(row, identifier, unit)), NOTHING) for unit in known_as or (None,)
    ]
    return right.intersection(*others) if others else right


def _fits(row: AccessRow, identifier: int, unit: int | None) -> bool:
    """Tell whether a row applies to unit `identifier` here, which is `unit` elsewhere, or has none there."""
    if row.units is None:
        return True
    if identifier == NO_UNIT or (row.listeners is None and unit in (None, NO_UNIT)):
        return row.units >= _ALL_UNITS
    return (unit if row.listeners is None else identifier) in row.units


def _address(host: str) -> IPv4Address | IPv6Address | None:
    if not host:
        return None
    address = ip_address(host)
    if isinstance(address, IPv6Address) and address.ipv4_mapped is not None:
        return address.ipv4_mapped
    return address
