"""Values of a unit: the requests that read and write them, and what the responses mean.

Nothing here sends anything. A `Steps` generator yields request PDUs and is sent the answers; the gateway drives it in
its event loop, and the command line with blocking calls.
"""

from collections.abc import Collection, Generator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, NamedTuple

from gateway.errors import DoesNotFit, ExceptionCode, UnitFailed
from gateway.images.polls import Poll, joined
from gateway.modbus.codes import EXCEPTION_BIT, Area
from gateway.modbus.pdu import Span
from gateway.operator.operations.answers import values as answers
from gateway.operator.values.complaint import Complaint
from gateway.profiles.holes import Holes, Split
from gateway.profiles.point import Point
from gateway.profiles.read_rules import ReadRules
from gateway.profiles.reading import Reading
from gateway.profiles.writing import Write, request_to_write, written
from gateway.registers.items import items_read
from gateway.registers.masks import read_before, write_after

#: After these exceptions, smaller requests may succeed: an address does not exist, or the request is too long.
_MAY_BE_ANSWERED_IN_PARTS: Final = frozenset({ExceptionCode.ILLEGAL_DATA_ADDRESS, ExceptionCode.ILLEGAL_DATA_VALUE})
#: The result if values that were polled are too old: only some of them may be.
_SOME_ARE_STALE: Final = "stale"
#: Over a hole also after this one: some devices send it for an address that they do not have.
_MAY_REFUSE_HOLE: Final = _MAY_BE_ANSWERED_IN_PARTS | {ExceptionCode.SERVER_DEVICE_FAILURE}


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
    """A request that got an exception: its addresses and the answer, and the `function` if it was to write."""

    span: Span
    answer: Answer
    function: int = 0


@dataclass(frozen=True, slots=True)
class Outcome:
    """Values that were read or written, requests that failed, and all answers; the `write`, if there was one."""

    readings: list[Reading] = field(default_factory=list)
    failures: list[Failure] = field(default_factory=list)
    answers: list[Answer] = field(default_factory=list)
    write: Write | None = None

    @property
    def elapsed_ms(self) -> float:
        """The sum of the times that the requests took."""
        return round(sum((answer.elapsed_ms for answer in self.answers), 0.0), 1)

    def add(self, other: "Outcome") -> None:
        """Add the outcome of further reads."""
        self.readings.extend(other.readings)
        self.failures.extend(other.failures)
        self.answers.extend(other.answers)

    def trouble_of(self, point: Point) -> Complaint | None:
        """Say why a point could not be read; None if no request for it failed."""
        at = (each for each in self.failures if each.span.area == point.area)
        return next((each.answer.complaint for each in at if each.span.start <= point.address < each.span.end), None)


class Step(NamedTuple):
    """A request PDU to send; `in_one_turn` as in `Request`."""

    pdu: bytes
    in_one_turn: int = 0


#: Yields requests, is sent the answer to each, and returns the outcome.
Steps = Generator[Step, Answer, Outcome]


def reading(points: Sequence[Point], rules: ReadRules, holes: Holes) -> Steps:
    """Read points in as few requests as the unit allows; the readings keep their order.

    Named points that the unit refuses together are read in smaller requests. `holes` are those that it has refused.

    Raises:
        UnitFailed: a response is too short.
    """
    outcome = Outcome()
    by_poll: dict[Poll, list[Point]] = {}
    for point in points:
        by_poll.setdefault(Poll.of(point), []).append(point)
    for poll in joined(by_poll, rules, holes):
        yield from _read(poll, by_poll, holes, outcome)
    order = {id(point): index for index, point in enumerate(points)}
    outcome.readings.sort(key=lambda each: order[id(each.point)])
    return outcome


def _read(
    poll: Poll, by_poll: Mapping[Poll, Sequence[Point]], holes: Holes, outcome: Outcome, split: Split | None = None
) -> Generator[Step, Answer, None]:
    """Read points with one request, a part of a `split` if there is one."""
    answer = yield Step(poll.request)
    outcome.answers.append(answer)
    if answer.exception is None:
        try:
            items = items_read(poll.span, answer.pdu, poll.width)
        except ValueError as wrong:
            raise UnitFailed(str(wrong)) from wrong
        outcome.readings.extend(
            Reading(point, items[poll.place(each)]) for each in poll.wanted for point in by_poll[each]
        )
        if split is not None:
            split.part_was_read()
        return
    hole, parts = poll.hole, poll.parts if by_poll[poll.wanted[0]][0].name else ()
    refusals = _MAY_BE_ANSWERED_IN_PARTS if hole is None else _MAY_REFUSE_HOLE
    if not parts or (answer.exception not in refusals and answer.result != _SOME_ARE_STALE):
        outcome.failures.append(Failure(poll.span, answer))
        return
    within = None if hole is None else Split(hole, holes, split)
    for part in parts:
        yield from _read(part, by_poll, holes, outcome, within)


@dataclass(frozen=True, slots=True)
class NewValues:
    """The text that each point is to be, at a unit that knows `functions` (None: all) and has these `limits`.

    `multiple`: one item is written with function 15 or 16 too.
    """

    points: Sequence[Point]
    texts: Sequence[str]
    limits: Mapping[int, int]
    functions: Collection[int] | None = None
    multiple: bool = False

    @property
    def needs_scales(self) -> bool:
        """Whether the points must be read before it is known what to write."""
        return any(point.scale_at is not None for point in self.points)

    def prepared(self, before: Sequence[bytes | None] = ()) -> tuple[list[Reading], Write]:
        """Prepare the readings after the write, and its request; `before` are the items of each point, as far as known.

        Raises:
            DoesNotFit: a point cannot hold its value or be written, or they do not fit into one request.
        """
        triples = zip(self.points, self.texts, before or [None] * len(self.points), strict=True)
        try:
            readings = [written(point, text, items) for point, text, items in triples]
        except (ValueError, ArithmeticError) as wrong:
            raise DoesNotFit(str(wrong)) from wrong
        return readings, request_to_write(readings, self.limits, self.functions, multiple=self.multiple)


def writing(new: NewValues, *, shows: bool = False, has_turns: bool = True) -> Steps:
    """Write values with one request. Scales are read before; if it `shows` them, all is read before and afterwards.

    A gateway `has_turns`. Without one, what would be a turn is a read and a write, one after the other.

    Raises:
        DoesNotFit: as `NewValues.prepared`; at once, unless scales must be read.
    """
    if not new.needs_scales:
        new.prepared()
    return _writing(new, shows=shows, has_turns=has_turns)


def _writing(new: NewValues, *, shows: bool, has_turns: bool) -> Steps:
    points, rules = new.points, ReadRules(new.limits)
    is_shown = shows and all(point.write != "only" for point in points)
    before = (yield from reading(points, rules, Holes())) if is_shown or new.needs_scales else Outcome()
    if before.failures and new.needs_scales:
        return replace(before, readings=[])
    known = {id(each.point): each.items for each in before.readings}
    readings, write = new.prepared([known.get(id(point)) for point in points])
    if write.in_one_turn and not has_turns:
        answers = yield from _reading_and_writing(write)
        function = write.in_one_turn if len(answers) > 1 else 0
    else:
        answers = [(yield Step(write.pdu, write.in_one_turn))]
        function = write.in_one_turn or write.pdu[0]
    answers = [*before.answers, *answers]
    if answers[-1].exception is not None:
        return Outcome([], [*before.failures, Failure(write.span, answers[-1], function)], answers, write)
    after = (yield from reading(points, rules, Holes())) if is_shown else Outcome(readings)
    return Outcome(
        [replace(each, before=known.get(id(each.point)) if is_shown else None) for each in after.readings],
        [*before.failures, *after.failures],
        [*answers, *after.answers],
        write,
    )


def _reading_and_writing(write: Write) -> Generator[Step, Answer, list[Answer]]:
    """Carry out a request of function 22 as a read and a write; return the answers. After an exception it ends.

    Raises:
        UnitFailed: the response to the read is too short.
    """
    read = yield Step(read_before(write.pdu))
    if read.exception is not None:
        return [read]
    try:
        before = items_read(write.span, read.pdu)
    except ValueError as wrong:
        raise UnitFailed(str(wrong)) from wrong
    pdu = write_after(write.pdu, int.from_bytes(before, "big"), write.in_one_turn)
    return [read, (yield Step(pdu))]


def value_told(reading: Reading, area: Area | None) -> answers.Value:
    """Convert what was read or written at a point, which names its area if that of all is not known."""
    return answers.Value(**reading.as_json(with_area=area is None))


def values_told(
    unit: int | None, name: str, area: Area | None, outcome: Outcome, values: Sequence[answers.Value] | None = None
) -> answers.Values:
    """Convert an outcome to values of one area, or of points, which each name theirs; `values` if that is done."""
    return answers.Values(
        unit=unit,
        name=name,
        area=area,
        values=[value_told(each, area) for each in outcome.readings] if values is None else values,
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
