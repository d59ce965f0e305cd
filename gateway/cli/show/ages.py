"""How old the values of a mirror or virtual unit are, as the running gateway tells it of each address."""

from collections.abc import Iterator
from math import inf
from typing import Final

from gateway.cli.kit.daemon import Conversation
from gateway.cli.show.mapped import MappedLine
from gateway.cli.show.register_map import RegisterMap
from gateway.config.values.duration import show_age
from gateway.modbus.codes import Area
from gateway.operator.operations.answers.values import Cell
from gateway.operator.operations.asked import Addresses
from gateway.operator.operations.table import IMAGE
from gateway.profiles.point import NO_VALUE

#: This many addresses are asked for at a time: the lines do not wait for a longer answer.
_MOST: Final = 100
#: From this age on tenths of a second do not matter, in milliseconds.
_LONG: Final = 10_000


class Ages:
    """Asks a gateway for all that is polled of a map, and finds the age of each line.

    Raises:
        DaemonError: it has no such unit, or does not answer.
    """

    def __init__(self, daemon: Conversation, found: RegisterMap) -> None:
        self._cells: dict[tuple[Area, int], Cell] = {}
        for area in Area:
            for first, last in _windows(found, area):
                told = daemon.ask(IMAGE, Addresses(found.name, area, first, last))
                self._cells |= {(area, cell.address): cell for cell in told.values}

    def as_text(self, line: MappedLine) -> str:
        """Show the age of a line: `0.4 s`, `stale 12 s`, a dash if it is not known; nothing if it is not polled."""
        if line.every is None:
            return ""
        oldest = self._oldest(line)
        if oldest is None or oldest.age_ms is None:
            return NO_VALUE
        age = f"{oldest.age_ms / 1000:.1f} s" if oldest.age_ms < _LONG else show_age(oldest.age_ms)
        return age if oldest.state == "fresh" else f"{oldest.state} {age}"

    def as_json(self, line: MappedLine) -> dict[str, float]:
        """Make the age of a line for programs: nothing if it is not known."""
        oldest = None if line.every is None else self._oldest(line)
        return {} if oldest is None or oldest.age_ms is None else {"age_ms": oldest.age_ms}

    def _oldest(self, line: MappedLine) -> Cell | None:
        """Find the oldest part of a line, or one that is not known; None if the gateway has another device there."""
        cells = (self._cells.get((line.place.area, at)) for at in range(line.place.start, line.place.end))
        ours = (cell for cell in cells if cell and (not cell.source or cell.source.startswith(f"{line.device} ")))
        return max(ours, key=lambda cell: inf if cell.age_ms is None else cell.age_ms, default=None)


def _windows(found: RegisterMap, area: Area) -> Iterator[tuple[int, int]]:
    """Yield the first and last addresses of what to ask at a time, so that all that is polled is told."""
    lines = (row.line for row in found.rows if row.line.every is not None and row.line.place.area is area)
    polled = sorted({address for line in lines for address in range(line.place.start, line.place.end)})
    while polled:
        here = [address for address in polled[:_MOST] if address < polled[0] + _MOST]
        yield here[0], here[-1]
        polled = polled[len(here) :]
