"""The rows of access rights, and the places where clients connect, with the rows that count there."""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from ipaddress import IPv4Address, IPv4Network, IPv6Address, IPv6Network, ip_network
from typing import Final, Literal

from gateway.modbus.codes import FIRST_UNIT, HIGHEST_UNIT, LAST_UNIT
from gateway.modbus.functions import READING_FUNCTIONS, READING_IDENTIFICATION
from gateway.modbus.pdu import Span

Network = IPv4Network | IPv6Network

#: The allowed requests to a unit: functions that only read by number, others by the first bytes of their requests,
#: because a right may depend on more than the function. So one look-up shows that a request is a read, and allowed.
Right = frozenset[int | bytes]

NOTHING: Final[Right] = frozenset()
READING: Final[Right] = READING_FUNCTIONS | {READING_IDENTIFICATION}
#: Everything that is not known to only read.
WRITING: Final[Right] = frozenset(bytes((function,)) for function in range(256) if function not in READING_FUNCTIONS)
EVERYTHING: Final[Right] = READING | WRITING


def right_to(functions: Iterable[int]) -> Right:
    """Make the right to exactly these functions."""
    return frozenset(each if each in READING_FUNCTIONS else bytes((each,)) for each in functions)


def includes(right: Right, pdu: bytes) -> bool:
    """Tell whether a right allows a request, by its function."""
    return pdu[0] in right or pdu[:1] in right or pdu[:2] in right


@dataclass(frozen=True, slots=True)
class AccessRow:
    """The right of clients from `networks` at `listeners` to `units`; None means all of them. `sites` are clients too.

    With `addresses` it is for these only; see `Deciding`. With high `priority` requests take the first turns.

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
    addresses: tuple[Span, ...] | None = None
    priority: Literal["normal", "high"] = "normal"

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

#: The units that a broadcast reaches, and that a row for all units means.
ALL_UNITS: Final = frozenset(range(FIRST_UNIT, LAST_UNIT + 1))

#: The usual case: every unit has the same number everywhere. Entry points for a single line may differ.
AS_NUMBERED: Final[KnownAs] = tuple((unit,) if unit in ALL_UNITS else () for unit in range(NO_UNIT + 1))


def rows_at(entry: EntryPoint, rows: tuple[AccessRow, ...]) -> Iterable[AccessRow]:
    """Choose the rows that count for the clients at an entry point, and weaken those that give them less there."""
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
