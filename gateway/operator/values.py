"""Values of a unit: the requests that read and write them, and what the responses mean.

Nothing here sends anything. A `Steps` generator yields request PDUs and is sent the answers; the gateway drives it in
its event loop, and the command line with blocking calls.
"""

from collections.abc import Collection, Generator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from gateway.errors import DoesNotFit, ExceptionCode, UnitFailed
from gateway.modbus.codes import EXCEPTION_BIT, Area
from gateway.modbus.pdu import Span
from gateway.operator.answers import values as answers
from gateway.operator.complaint import Complaint
from gateway.profiles.batches import Batch, batches
from gateway.profiles.point import Point
from gateway.profiles.reading import Reading
from gateway.registers.items import WRITERS, has_bits, most_written, write_request

#: After these exceptions, smaller requests may succeed: an address does not exist, or the request is too long.
_MAY_BE_ANSWERED_IN_PARTS: Final = frozenset({ExceptionCode.ILLEGAL_DATA_ADDRESS, ExceptionCode.ILLEGAL_DATA_VALUE})


@dataclass(frozen=True, slots=True)
class Answer:
    """A response PDU, and how long it took.

    `result` and `reason` say why the gateway itself answered with an exception. `sent` and `received` are the frames on
    the line, where they are known.
    """

    pdu: bytes
    elapsed_ms: float
    result: str = ""
    reason: str = ""
    sent: bytes = b""
    received: bytes = b""

    @property
    def exception(self) -> int | None:
        """The exception code; None for a normal response."""
        return self.pdu[1] if self.pdu[0] & EXCEPTION_BIT else None

    @property
    def complaint(self) -> Complaint:
        """The exception in words."""
        return Complaint(self.exception or 0, self.result, self.reason)


@dataclass(frozen=True, slots=True)
class Failure:
    """A request that got an exception: its addresses, the answer, and what else to try."""

    span: Span
    answer: Answer
    advice: str = ""


@dataclass(frozen=True, slots=True)
class Outcome:
    """Values that were read or written, requests that failed, and all answers."""

    readings: list[Reading] = field(default_factory=list)
    failures: list[Failure] = field(default_factory=list)
    answers: list[Answer] = field(default_factory=list)

    @property
    def elapsed_ms(self) -> float:
        """The sum of the times that the requests took."""
        return round(sum((answer.elapsed_ms for answer in self.answers), 0.0), 1)

    def trouble_of(self, point: Point) -> Complaint | None:
        """Say why a point could not be read; None if no request for it failed."""
        at = (each for each in self.failures if each.span.area == point.area)
        return next((each.answer.complaint for each in at if each.span.start <= point.address < each.span.end), None)


#: Yields request PDUs, is sent the answer to each, and returns the outcome.
Steps = Generator[bytes, Answer, Outcome]


def reading(points: Sequence[Point], limits: Mapping[int, int]) -> Steps:
    """Read points in as few requests as the unit allows; the readings keep their order.

    Named points that the unit refuses together are read one by one.

    Raises:
        UnitFailed: a response is too short.
    """
    outcome = Outcome()
    for batch in batches(points, limits):
        yield from _read(batch, outcome)
    order = {id(point): index for index, point in enumerate(points)}
    outcome.readings.sort(key=lambda each: order[id(each.point)])
    return outcome


def _read(batch: Batch, outcome: Outcome) -> Generator[bytes, Answer, None]:
    answer = yield batch.request
    outcome.answers.append(answer)
    if answer.exception is None:
        try:
            outcome.readings.extend([Reading(point, items) for point, items in batch.items_read(answer.pdu)])
        except ValueError as wrong:
            raise UnitFailed(str(wrong)) from wrong
    elif answer.exception in _MAY_BE_ANSWERED_IN_PARTS and len(batch.points) > 1 and batch.points[0].name:
        for point in batch.points:
            yield from _read(Batch(point.span, (point,)), outcome)
    else:
        outcome.failures.append(Failure(batch.span, answer))


def request_to_write(
    readings: Sequence[Reading],
    limits: Mapping[int, int],
    functions: Collection[int] | None = None,
    *,
    multiple: bool = False,
) -> tuple[bytes, Span]:
    """Make the one request that writes these values, which lie side by side, and return also where it writes.

    Raises:
        DoesNotFit: they cannot be written, do not lie side by side, or are too many.
    """
    first, count = readings[0].point, 0
    if first.area not in WRITERS:
        raise DoesNotFit(f"{first.area} cannot be written", "coils and holding can")
    for each in readings:
        if (each.point.area, each.point.address) != (first.area, first.address + count):
            raise DoesNotFit("what one request writes must lie side by side", "write them one by one")
        count += each.point.count
    most = most_written(first.area, limits)
    if count > most:
        called = "coils" if has_bits(first.area) else "registers"
        raise DoesNotFit(f"{count} {called} are too many for one request", f"write at most {most} at a time")
    items = b"".join(each.items for each in readings)
    request = write_request(first.area, first.address, items, functions, multiple=multiple)
    return request, Span(first.area, first.address, count)


def values_told(unit: int | None, name: str, area: Area | None, outcome: Outcome) -> answers.Values:
    """Convert an outcome to values of one area, or of points, which each name theirs."""
    return answers.Values(
        unit=unit,
        name=name,
        area=area,
        values=[answers.Value(**each.as_json(with_area=area is None)) for each in outcome.readings],
        elapsed_ms=outcome.elapsed_ms,
        errors=[_failure(each) for each in outcome.failures] or None,
    )


def _failure(failure: Failure) -> answers.Failure:
    return answers.Failure(
        area=failure.span.area,
        address=failure.span.start,
        count=failure.span.count,
        exception=failure.answer.pdu[1],
        reason=str(failure.answer.complaint),
    )
