"""Read points of a unit in as few requests as possible."""

from collections.abc import Sequence
from typing import Final

from gateway.cli.units.unit import Answer, Unit
from gateway.cli.units.values import Failure, Outcome
from gateway.errors import ExceptionCode
from gateway.modbus.pdu import Span
from gateway.profiles.batches import Batch, batches
from gateway.profiles.point import Point, Reading
from gateway.registers.items import MANUAL_BASES

#: After these exceptions, smaller requests may succeed: an address does not exist, or the request is too long.
_MAY_BE_ANSWERED_IN_PARTS: Final = frozenset({ExceptionCode.ILLEGAL_DATA_ADDRESS, ExceptionCode.ILLEGAL_DATA_VALUE})


def read_points(unit: Unit, points: Sequence[Point]) -> Outcome:
    """Read points; the readings keep their order.

    If the unit refuses named points together, they are read one by one.
    """
    outcome = Outcome()
    for batch in batches(points, unit.limits):
        _read(unit, batch, outcome)
    order = {id(point): index for index, point in enumerate(points)}
    outcome.readings.sort(key=lambda reading: order[id(reading.point)])
    return outcome


def _read(unit: Unit, batch: Batch, outcome: Outcome) -> None:
    answer = unit.ask(batch.request)
    outcome.answers.append(answer)
    if answer.exception is None:
        outcome.readings.extend(Reading(point, items) for point, items in batch.items_read(answer.pdu))
    elif answer.exception in _MAY_BE_ANSWERED_IN_PARTS and len(batch.points) > 1 and batch.points[0].name:
        for point in batch.points:
            _read(unit, Batch(point.span, (point,)), outcome)
    else:
        outcome.failures.append(Failure(batch.span, answer, advice_after(answer, batch.span)))


def advice_after(answer: Answer, span: Span) -> str:
    """What may be meant by addresses that do not exist: the numbers of a manual, which count from 40001 or 30001."""
    base = MANUAL_BASES.get(span.area)
    if answer.exception != ExceptionCode.ILLEGAL_DATA_ADDRESS or base is None or not 0 <= span.start - base < 10_000:
        return ""
    return f"{span.start} of a manual is {span.area} {span.start - base} here"
