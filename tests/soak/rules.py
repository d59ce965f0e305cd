"""Who may ask what, and what may be written: rules that change at random, as a config says them, and a judge of them.

The judge reads the rows address by address, as the contract has it, and knows nothing of the gateway's own code.
"""

import random
from collections.abc import Iterator
from dataclasses import dataclass
from struct import unpack_from
from typing import Final, NamedTuple

from gateway.modbus.codes import Area
from soak.dated import CELLS

#: Clients are at two listeners, and come from two networks.
LISTENERS: Final = ("scada", "office")
NETWORKS: Final = ("10.0.1.", "10.0.2.")
#: The units of a guarded device on a line, of its mirror, and of others on the line and behind a server.
GUARDED, MIRROR, OTHERS = (11, 12), 31, (13, 21, 22)
UNITS: Final = (*GUARDED, *OTHERS, MIRROR)
#: What a client is told of what it may not do, and of a value that must not be written.
DENIED, OUTSIDE = 1, 3
_FUNCTIONS: Final = {"read": frozenset({3, 4}), "write": frozenset({3, 4, 6, 16, 23}), "nothing": frozenset[int]()}
_AREAS: Final = (Area.HOLDING, Area.INPUT)
_NUMBERS: Final = 0x10000


@dataclass(frozen=True)
class Row:
    """A row of `[[access]]`; what is None or empty is for all."""

    functions: frozenset[int]
    network: str | None
    listener: str | None
    units: tuple[int, ...]
    addresses: dict[Area, range]
    has_priority: bool

    @classmethod
    def of_chance(cls, dice: random.Random) -> "Row":
        """Any row."""
        some = frozenset(dice.sample((3, 4, 6, 16, 23), dice.randint(1, 4)))
        areas = dice.sample(_AREAS, dice.choice((0, 1, 1, 2)))
        return cls(
            dice.choice((*_FUNCTIONS.values(), some)),
            dice.choice((None, None, *NETWORKS)),
            dice.choice((None, None, *LISTENERS)),
            tuple(sorted(dice.sample(UNITS, dice.choice((0, 0, 1, 3))))),
            {area: _span_of_chance(dice) for area in areas},
            dice.random() < 0.3,
        )

    @property
    def text(self) -> str:
        """Its table."""
        lines = [f"functions = {sorted(self.functions)}"] if self.functions else ["allow = []"]
        if self.functions in (_FUNCTIONS["read"], _FUNCTIONS["write"]):
            lines = ['allow = ["read", "write"]' if 6 in self.functions else 'allow = ["read"]']
        if self.network is not None:
            lines.append(f'from = ["{self.network}0/24"]')
        if self.listener is not None:
            lines.append(f'listen = ["{self.listener}"]')
        if self.units:
            lines.append(f"units = {list(self.units)}")
        lines += [f'{area.value} = "{span.start}-{span.stop - 1}"' for area, span in self.addresses.items()]
        if self.has_priority:
            lines.append('priority = "high"')
        return "[[access]]\n" + "\n".join(lines) + "\n"

    def fits(self, host: str, listener: str, unit: int, area: Area, address: int) -> bool:
        """Whether it decides, if no row before it does."""
        return (
            (self.network is None or host.startswith(self.network))
            and self.listener in (None, listener)
            and (not self.units or unit in self.units)
            and (not self.addresses or address in self.addresses.get(area, ()))
        )


class Guard(NamedTuple):
    """A point of one register or two, which may be written with these values only."""

    first: int
    items: int
    least: int
    most: int

    @classmethod
    def of_chance(cls, dice: random.Random) -> "Guard":
        """Any guard; most values pass it."""
        items = dice.randint(1, 2)
        least, most = dice.randrange(_NUMBERS // 4), dice.randrange(_NUMBERS // 2, _NUMBERS)
        scale = _NUMBERS ** (items - 1)
        return cls(dice.randrange(CELLS + 1 - items), items, least * scale, most * scale)

    @property
    def text(self) -> str:
        """Its row in `points`."""
        kind = "uint16" if self.items == 1 else "uint32"
        return (
            f'{{ name = "guard-{self.first}-{self.items}", holding = {self.first}, type = "{kind}", '
            f"min = {self.least}, max = {self.most}, write = true }}"
        )

    def allows(self, first: int, values: list[int]) -> bool:
        """Whether registers may be written."""
        own = range(self.first, self.first + self.items)
        written = range(first, first + len(values))
        if own.start >= written.stop or written.start >= own.stop:
            return True
        if own.start < written.start or own.stop > written.stop:
            return False
        value = 0
        for address in own:
            value = value * _NUMBERS + values[address - first]
        return self.least <= value <= self.most


@dataclass(frozen=True)
class Rules:
    """The rows and guards of one config."""

    rows: tuple[Row, ...]
    guards: tuple[Guard, ...]

    @classmethod
    def of_chance(cls, dice: random.Random, before: "Rules | None" = None) -> "Rules":
        """Any rules; now and then the guards are other ones than `before`, too."""
        rows = [Row.of_chance(dice) for _ in range(dice.randint(0, 5))]
        last = Row(_FUNCTIONS[dice.choice(("read", "write", "write"))], None, None, (), {}, dice.random() < 0.1)
        if before is not None and dice.random() < 0.8:
            return cls((*rows, last), before.guards)
        guards = {guard[:2]: guard for guard in (Guard.of_chance(dice) for _ in range(dice.randint(0, 3)))}
        return cls((*rows, last), tuple(guards.values()))

    @property
    def rows_text(self) -> str:
        """The tables of the rows."""
        return "".join(row.text for row in self.rows)

    @property
    def points_text(self) -> str:
        """The points of a guarded device."""
        return ", ".join(guard.text for guard in self.guards)

    def refusal(self, host: str, listener: str, unit: int, pdu: bytes) -> int:
        """The exception of the gateway itself for a request, 0 for none; `DENIED` comes before `OUTSIDE`."""
        if not all(self._allows(host, listener, unit, pdu[0], *where) for where in _addresses(pdu)):
            return DENIED
        is_guarded = unit in GUARDED or unit == MIRROR
        written = written_by(pdu)
        if is_guarded and written is not None and not all(guard.allows(*written) for guard in self.guards):
            return OUTSIDE
        return 0

    def _allows(self, host: str, listener: str, unit: int, function: int, area: Area, address: int) -> bool:
        for row in self.rows:
            if row.fits(host, listener, unit, area, address):
                return function in row.functions
        return False


def written_by(pdu: bytes) -> tuple[int, list[int]] | None:
    """The first address and the values that a request writes; None if it only reads."""
    if pdu[0] == 6:
        first, value = unpack_from(">HH", pdu, 1)
        return first, [value]
    if pdu[0] not in (16, 23):
        return None
    first, count = unpack_from(">HH", pdu, 1 if pdu[0] == 16 else 5)
    return first, [*unpack_from(f">{count}H", pdu, len(pdu) - 2 * count)]


def _addresses(pdu: bytes) -> Iterator[tuple[Area, int]]:
    """Each address that a request touches."""
    area = Area.INPUT if pdu[0] == 4 else Area.HOLDING
    if pdu[0] in (3, 4, 23):
        first, count = unpack_from(">HH", pdu, 1)
        yield from ((area, address) for address in range(first, first + count))
    written = written_by(pdu)
    if written is not None:
        yield from ((area, address) for address in range(written[0], written[0] + len(written[1])))


def _span_of_chance(dice: random.Random) -> range:
    first = dice.randrange(CELLS)
    return range(first, dice.randint(first, CELLS - 1) + 1)
