"""The rights of clients at one entry point, turned into look-ups: for each client what it may do at each unit."""

from collections.abc import Iterable
from functools import lru_cache
from ipaddress import IPv4Address, IPv6Address, ip_address
from itertools import chain
from typing import Final, NamedTuple

from gateway.modbus.codes import BROADCAST_UNIT
from gateway.routing.access import (
    ALL_UNITS,
    AS_NUMBERED,
    NO_UNIT,
    READING,
    AccessRow,
    Client,
    EntryPoint,
    KnownAs,
    Right,
    includes,
    rows_at,
)
from gateway.routing.deciding import Deciding, Ruling

#: The most clients whose rights are cached, and the most roles.
MOST_CLIENTS: Final = 10_000
MOST_ROLES: Final = 100


class Rights(dict[str, tuple[Right, ...]]):
    """The rights at one entry point, by address and then by unit. They are computed at a client's first request.

    What is looked up like this is for the router: all that is allowed without a look at addresses or priorities.
    Whoever shows values to somebody asks `permits`.

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
        self._rows = tuple(rows_at(entry, tuple(rows)))
        self._units: dict[str, _Units] = {}
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
        if self._units_of(host).gives_something:
            return True
        client = self._client(host)
        return self._entry.kind == "certified" and any(row.right and row.applies_to(client) for row in self._rows)

    def names(self, host: str, role: str | None = None) -> bool:
        """Tell whether a row gives rights to a network with this address; to this role, for a certified client."""
        if role is not None:
            return self.of_role(role).names(host)
        return self.admits(host) and host in self._named

    def permits(self, host: str, unit: int, pdu: bytes) -> bool:
        """Tell whether a request from this address to a unit, or to a device by its `key_of`, is allowed."""
        return includes(self.at(host, unit), pdu) or self.ruling(host, unit, pdu).is_allowed

    def ruling(self, host: str, unit: int, pdu: bytes) -> Ruling:
        """Decide about a request as `permits` does, and tell more."""
        rulings = [each.ruling(pdu) for each in self._deciding(host, unit)]
        refusal = next((ruling for ruling in rulings if not ruling.is_allowed), None)
        return refusal or next((ruling for ruling in rulings if ruling.has_priority), rulings[0])

    def everywhere(self, host: str, unit: int) -> Right:
        """Return what is allowed to a client at all addresses of a unit; `permits` knows what else is."""
        return self._units_of(host).everywhere[min(unit, NO_UNIT)]

    def somewhere(self, host: str, unit: int) -> Right:
        """Return what may be allowed to a client at some address of a unit, or without one."""
        return _common(each.somewhere for each in self._deciding(host, unit))

    def reads_all(self, host: str) -> bool:
        """Tell whether a client may read all addresses of all units."""
        return all(right >= READING for right in set(self._units_of(host).everywhere))  # most units have the same

    def at(self, host: str, unit: int) -> Right:
        """Return what is allowed to a client at a unit without a further look; `permits` knows what else is."""
        return self[host][min(unit, NO_UNIT)]

    def rows_for(self, host: str, unit: int) -> tuple[AccessRow, ...]:
        """Find the rows that give a client from this address its rights to a unit other than 0.

        Usually one; several if some have addresses, or the unit has several numbers elsewhere; none if no row applies.
        """
        return tuple(dict.fromkeys(row for each in self._deciding(host, unit) for row in each.rows))

    def __missing__(self, host: str) -> tuple[Right, ...]:
        if len(self) >= MOST_CLIENTS:
            self.clear()
            self._units.clear()
            self._named.clear()
        client = self._client(host)
        rows = tuple(row for row in self._rows if row.applies_to(client))
        if any(row.networks is not None and row.right for row in rows):
            self._named.add(host)
        units = self._units[host] = _by_unit(rows, self._known_as, self._entry.unit0)
        rights = self[host] = units.plain
        return rights

    def _deciding(self, host: str, unit: int) -> tuple[Deciding, ...]:
        return self._units_of(host).deciding[min(unit, NO_UNIT)]

    def _units_of(self, host: str) -> "_Units":
        if host not in self._units:
            self.__missing__(host)
        return self._units[host]

    def _client(self, host: str) -> Client:
        return host if self._entry.kind == "site" else _address(host)


class _Units(NamedTuple):
    """The rights of a client at each unit identifier, and at NO_UNIT. Every one of `deciding` must allow a request.

    `plain` and `everywhere` are what all of them have so. `gives_something`: one of them may allow a request.
    """

    plain: tuple[Right, ...]
    everywhere: tuple[Right, ...]
    deciding: tuple[tuple[Deciding, ...], ...]
    gives_something: bool


@lru_cache(maxsize=256)
def _by_unit(rows: tuple[AccessRow, ...], known_as: KnownAs, unit0: int | None) -> _Units:
    """Find what decides at each unit identifier. Clients with the same rows share the result."""
    made: dict[tuple[int, ...], Deciding] = {}
    deciding = [
        tuple([_deciding_at(identifier, unit, rows, made) for unit in units or (None,)])
        for identifier, units in enumerate(known_as)
    ]
    all_units = (each for at, each in enumerate(deciding) if at in ALL_UNITS or known_as[at])
    deciding[BROADCAST_UNIT] = tuple(dict.fromkeys(chain(*all_units))) if unit0 is None else deciding[unit0]
    plain = tuple([_common(each.plain for each in there) for there in deciding])
    everywhere = tuple([_common(each.everywhere for each in there) for there in deciding])
    return _Units(plain, everywhere, tuple(deciding), any(each.somewhere for each in made.values()))


def _common(rights: Iterable[Right]) -> Right:
    """Return what is in each of the rights; there is at least one."""
    return frozenset.intersection(*rights)


def _deciding_at(
    identifier: int, unit: int | None, rows: tuple[AccessRow, ...], made: dict[tuple[int, ...], Deciding]
) -> Deciding:
    """Find the rows that fit, up to the first without addresses. Units with the same ones share what is `made`."""
    fitting: list[int] = []
    for number, row in enumerate(rows):
        if _fits(row, identifier, unit):
            fitting.append(number)
            if row.addresses is None:
                break
    key = tuple(fitting)
    found = made.get(key)
    if found is None:
        found = made[key] = Deciding([rows[number] for number in key])
    return found


def _fits(row: AccessRow, identifier: int, unit: int | None) -> bool:
    """Tell whether a row applies to unit `identifier` here, which is `unit` elsewhere, or has none there."""
    if row.units is None:
        return True
    if identifier == NO_UNIT or (row.listeners is None and unit in (None, NO_UNIT)):
        return row.units >= ALL_UNITS
    return (unit if row.listeners is None else identifier) in row.units


def _address(host: str) -> IPv4Address | IPv6Address | None:
    if not host:
        return None
    address = ip_address(host)
    if isinstance(address, IPv6Address) and address.ipv4_mapped is not None:
        return address.ipv4_mapped
    return address
