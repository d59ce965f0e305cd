"""Requests of several sizes to one device, for the times that it takes. The gateway measures them.

Reading changes nothing. What is written are the values that were read right before, at registers that the user names;
what somebody else writes there between the two is lost.
"""

import time
from collections.abc import Iterator
from typing import Final

from gateway.cli.units.unit import DaemonUnit
from gateway.config.values.ranges import parse_ranges
from gateway.lines.breaker import FAILURES
from gateway.modbus.codes import EXCEPTION_BIT, Area, FunctionCode
from gateway.modbus.functions import FUNCTIONS, READERS
from gateway.modbus.pdu import Span
from gateway.operator.values.steps import Step
from gateway.registers.items import items_read, read_request, write_request

#: How many sizes of each table are asked, and how often without a time to go on for.
SIZES: Final = 5
ROUNDS: Final = 10
#: This many failures in a row end it: after one more the unit would rest, for clients too.
MOST_FAILURES: Final = FAILURES - 1
#: After a failure a late response may come: then nothing is sent, at most this often and for this many seconds.
MOST_PAUSES: Final = 15
PAUSE: Final = 2.0


class _GivesUpError(Exception):
    """The device does not respond any more."""


class _Questions:
    """Asks a device, and gives up when it fails again and again."""

    def __init__(self, unit: DaemonUnit) -> None:
        self._unit = unit
        #: In a row.
        self.failures = 0

    def ask(self, pdu: bytes) -> bytes | None:
        """Send a request, and return its response; None if it is an exception, of the device or the gateway."""
        answer = self._unit.ask(Step(pdu))
        for _ in range(MOST_PAUSES):
            if answer.result != "overdue":
                break
            time.sleep(PAUSE)
            answer = self._unit.ask(Step(pdu))
        self.failures = self.failures + 1 if answer.reason else 0
        if self.failures >= MOST_FAILURES:
            raise _GivesUpError(f"{self._unit.name or self._unit.number}: {answer.complaint}")
        return None if answer.pdu[0] & EXCEPTION_BIT else answer.pdu


def parse_registers(value: object) -> Span:
    """Parse which holding registers may be written: `10` or `10-40`.

    Raises:
        WrongValue: they are none.
    """
    text = str(value)
    ((first, last),) = parse_ranges(text if "-" in text else f"{text}-{text}")
    return Span(Area.HOLDING, first, last - first + 1)


def ask_actively(unit: DaemonUnit, registers: Span | None, seconds: float | None) -> Iterator[str]:
    """Ask each size once in a round, for ROUNDS or this many seconds; yields what is wrong after each round.

    Raises:
        DaemonError: the gateway is gone.
    """
    questions = _Questions(unit)
    end = None if seconds is None else time.monotonic() + seconds
    try:
        spans = [span for area in Area for span in _sizes_of(questions, unit, area)]
        rounds = 0
        while (rounds < ROUNDS) if end is None else (time.monotonic() < end):
            for span in spans:
                questions.ask(read_request(span))
            for span in _spread(registers) if registers else ():
                _write_back(questions, unit, span)
            rounds += 1
            yield ""
    except _GivesUpError as trouble:
        yield f"given up: {trouble}"


def _sizes_of(questions: _Questions, unit: DaemonUnit, area: Area) -> list[Span]:
    """Find what can be read of a table in one request, in several sizes; nothing if the device does not have it."""
    function, most = READERS[area]
    if unit.functions is not None and function not in unit.functions:
        return []
    first, last = max(unit.areas.get(area, [(0, 0xFFFF)]), key=lambda each: each[1] - each[0])
    for start in (first, first + 1):  # some devices count from 1
        count = min(most, unit.limits.get(function, most), last - start + 1)
        readable = _readable(questions, Span(area, start, count))
        if readable:
            return _spread(Span(area, start, readable))
    return []


def _readable(questions: _Questions, span: Span) -> int:
    """Find how many items of a span can be read in one request, 0 if none can."""

    def can_be(count: int) -> bool:
        return questions.ask(read_request(Span(span.area, span.start, count))) is not None

    if can_be(span.count):
        return span.count
    if not can_be(1):
        return 0
    most, too_many = 1, span.count
    while too_many - most > 1:
        middle = (most + too_many) // 2
        if can_be(middle):
            most = middle
        else:
            too_many = middle
        if questions.failures:
            can_be(1)  # silence about too many items is no failure of the device, and must not become its rest
    return most


def _spread(span: Span) -> list[Span]:
    """Make spans of several sizes, from one item to all, that begin where `span` does."""
    sizes = {1 + (span.count - 1) * step // (SIZES - 1) for step in range(SIZES)}
    return [Span(span.area, span.start, size) for size in sorted(sizes)]


def _write_back(questions: _Questions, unit: DaemonUnit, span: Span) -> None:
    """Write the values that are there, with each function that can."""
    for function in (FunctionCode.WRITE_SINGLE_REGISTER, FunctionCode.WRITE_MULTIPLE_REGISTERS, _BOTH):
        if (function not in unit.functions) if unit.functions is not None else function == _BOTH:
            continue
        if span.count > (1 if function == FunctionCode.WRITE_SINGLE_REGISTER else _most_written(function)):
            continue
        response = questions.ask(read_request(span))
        if response is not None:
            questions.ask(_written(function, span, items_read(span, response)))


_BOTH: Final = FunctionCode.READ_WRITE_MULTIPLE_REGISTERS


def _most_written(function: int) -> int:
    items = FUNCTIONS[function].writes
    return items.most if items else 0


def _written(function: int, span: Span, values: bytes) -> bytes:
    is_single = function == FunctionCode.WRITE_SINGLE_REGISTER
    request = write_request(span.area, span.start, values, how="single" if is_single else "multiple")
    if function != _BOTH:
        return request
    place = request[1:5]
    return bytes((_BOTH,)) + place + place + request[5:]
