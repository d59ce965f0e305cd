"""A line in the last hour or day, in the place of its last seconds: how busy it was, and how each unit answered."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from gateway.operator.operator import Operator
from gateway.operator.past.minutes import last_hour
from gateway.operator.past.past import past_of
from gateway.timing.history import STEP, UNIT_SLOTS, LineUse, Past, UnitUse
from gateway.web.pages.busy import busy_outline
from gateway.web.pages.heat_map import KINDS, Axis, HeatRow, axis, row_of

#: What the address may ask for, with the hours.
SPANS: Final[Mapping[str, int]] = {"1h": 1, "24h": 24}
#: This many clients of each column are named.
_CLIENTS: Final = 3


@dataclass(frozen=True, slots=True)
class LinePast:
    """The pictures of a line and its units over `span`, and the numbers of their columns for a script."""

    span: str
    axis: Axis
    busy: str
    rows: Sequence[tuple[str, HeatRow]]
    columns: Mapping[str, Any]
    kinds: Mapping[str, int]


async def past_for(operator: Operator, line: str, span: str) -> tuple[Past, Mapping[int, Mapping[str, int]]]:
    """Find what a line did over a span, and its clients by slot where they are known."""
    if SPANS[span] == 1 and (hour := await last_hour(operator, line)) is not None:
        return hour.past, {number: dict(clients.most_common(_CLIENTS)) for number, clients in hour.clients.items()}
    slots = min(UNIT_SLOTS, SPANS[span] * 3600 // STEP)
    return past_of(operator, slots), {}


def drawn(span: str, past: Past, clients: Mapping[int, Mapping[str, int]], line: str, units: Sequence[str]) -> LinePast:
    """Draw it."""
    told = {"first": past.first, "step": past.step, "line": list(_told_line(past, line, clients))}
    told["units"] = {unit: [_told_unit(past, place, line, unit) for place in range(len(past.slots))] for unit in units}
    rows = [(unit, row_of(past, line, unit)) for unit in units]
    return LinePast(span, axis(past), busy_outline(past, line), rows, told, KINDS)


def _told_line(past: Past, line: str, clients: Mapping[int, Mapping[str, int]]) -> Iterator[list[Any] | None]:
    """Tell for each column the busy share, requests sent and failed, and who has sent most of them."""
    for number, slot in enumerate(past.slots, past.first):
        use: LineUse | None = None if slot is None else slot.lines.get(line)
        told = None if use is None else [round(use.busy_share, 3), use.sent, use.failed, clients.get(number, {})]
        yield told


def _told_unit(past: Past, place: int, line: str, unit: str) -> list[float] | None:
    """Tell requests, time-outs, failed and unsent ones, exceptions, and the mean answer time in milliseconds."""
    slot = past.slots[place]
    if slot is None or line not in slot.lines:
        return None
    use = slot.units.get(unit, UnitUse())
    answer = 1000 * use.answer / use.responses if use.responses else 0.0
    return [use.requests, use.timeouts, use.failed, use.unsent, use.exceptions, round(answer, 1)]
