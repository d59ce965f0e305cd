"""What a line carried, as `bench` prints it."""

from collections.abc import Iterator
from typing import Final

from gateway.cli.kit.columns import align
from gateway.config.values.duration import show_duration
from gateway.config.values.unitset import show_unit
from gateway.operator.operations.answers.bench import BenchResult

#: A difference between both rates that deserves a word.
_CLOSE: Final = 0.03


def show_bench(result: BenchResult) -> str:
    """Show a measurement as tables and notes."""
    reads = [
        (show_unit(one.unit), one.name, f"{one.area} {one.address}", str(one.items), _ms(one.line_time_ms))
        for one in result.reads
    ]
    expected, measured = result.expected_per_second, result.measured_per_second
    rates = [("by arithmetic", *_rate(expected)), ("measured", *_rate(measured))]
    parts = [
        f"Line {result.line}",
        align([("UNIT", "DEVICE", "READS FROM", "ITEMS", "LINE TIME"), *reads], "  "),
        align([("", "READS/S", "TIME OF A READ"), *rates], "  "),
        *(f"  {note}" for note in _notes(result)),
    ]
    return "\n".join(parts)


def _notes(result: BenchResult) -> Iterator[str]:
    total = result.answered + result.exceptions + result.failed
    expected = result.expected_per_second
    share = result.measured_per_second / expected if expected else None
    yield (
        f"{total} reads in {show_duration(result.seconds)}: {result.answered} answered, "
        f"{result.exceptions} exceptions, {result.failed} failed; line busy {result.busy_share:.0%}"
    )
    if result.left_out:
        yield f"left out, because they rest after several failures: {', '.join(result.left_out)}"
    if share is not None:
        yield f"measured is {share:.1%} of the arithmetic"
    if result.failed:
        yield f"the last failure: {result.last_failure}; modbus-gateway doctor {result.line} looks for the cause"
    if result.exceptions:
        yield "exceptions are shorter than answers: choose registers that exist, with --at and --items"
    if result.others:
        yield f"other clients had {result.others} requests on the line meanwhile"
    if (share is None or abs(share - 1) > _CLOSE) and not all(one.answer_time_known for one in result.reads):
        yield "the profile has no answer times, so the arithmetic has none: see modbus-gateway calibrate"


def _rate(per_second: float | None) -> tuple[str, str]:
    """Show reads in a second, and the time of one."""
    each = _ms(1000 / per_second) if per_second else "-"
    return "-" if per_second is None else f"{per_second:.2f}", each


def _ms(milliseconds: float) -> str:
    return f"{milliseconds:.1f} ms"
