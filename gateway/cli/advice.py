"""What the rows of `status` say about what to do: a note for each line and unit that needs a look."""

from collections.abc import Callable, Iterator, Mapping
from math import ceil
from typing import Any, Final

from gateway.config.duration import show_duration
from gateway.lines.counts import RESULTS

#: From which share of the limit on, or of a line's time, a row deserves a note, and below which share of answers.
CLOSE: Final = 0.8
BUSY: Final = 0.9
ANSWERED: Final = 0.95
#: Fewer requests than this say nothing yet.
_ENOUGH: Final = 20

_Row = Mapping[str, Any]

#: What mostly stands behind an error that a unit had last.
_CAUSES: Final[Mapping[str, str]] = {
    "timeout": "check its power, wiring and address",
    "bad_frame": "check baud rate, format, wiring and termination",
    "ambiguous": "another client asks it on the line",
    "line_lost": "its port was lost",
}


def count_ok(one: _Row) -> int:
    """Requests that were answered by the device, exceptions included, and broadcasts."""
    counts = one["counts"]
    return int(counts["ok"] + counts["exception"] + counts["broadcast"])


def count_failed(one: _Row) -> int:
    """Requests that were not. A result that the daemon does not know has not happened there."""
    counts: Mapping[str, int] = one["counts"]
    return sum(counts.get(result, 0) for result in RESULTS) - count_ok(one)


def for_part(part: _Row) -> Iterator[str]:
    """About a line, a server line or an upstream."""
    if part["state"] == "down":
        yield f"down: {part['reason']}"


def for_line(line: _Row) -> Iterator[str]:
    """About a line where we ask."""
    yield from for_part(line)
    busy = line["busy_share"]
    if busy is not None and busy >= BUSY:
        yield f"busy for {busy:.0%} of the time: ask less often or raise its speed"
    echoes = line["counts"]["echoes"]
    if echoes:
        yield f"{echoes} requests came back: if the adapter echoes, set echo = true"


def for_unit(unit: _Row) -> Iterator[str]:
    """About a unit that was asked."""
    yield from _about_failures(unit)
    share, late = unit["times"]["limit_share_p99"], unit["counts"]["late_responses"]
    if late:
        yield f"{late} responses came after its limit: raise its timeout ({unit['source']})"
    elif share is not None and share >= CLOSE and unit["counts"]["responses"] >= _ENOUGH:
        yield f"close to its limit ({share:.0%}): raise its timeout ({unit['source']})"


def _about_failures(unit: _Row) -> Iterator[str]:
    error = str(unit["last_error"])
    cause = _CAUSES.get(error, "see the log")
    if unit["state"] == "resting":
        yield f"rests, next try in {show_duration(ceil(unit['rests_ms'] / 1000))}; {error}: {cause}"
    elif unit["state"] == "failing":
        yield f"{error}, {unit['failures']} in a row: {cause}"
    elif count_failed(unit) > (1 - ANSWERED) * (count_ok(unit) + count_failed(unit)) and error in _CAUSES:
        yield f"{count_failed(unit)} requests failed; last was {error}{_ago(unit['last_error_ms'])}: {cause}"


def _ago(milliseconds: float | None) -> str:
    return "" if milliseconds is None else f", {show_age(milliseconds)} ago"


def show_age(milliseconds: float) -> str:
    """A time that has passed, in one figure and its unit: `3 s`, `2 h`."""
    seconds = milliseconds / 1000
    for unit, length in (("d", 86400), ("h", 3600), ("min", 60)):
        if seconds >= 2 * length:
            return f"{seconds / length:.0f} {unit}"
    return f"{seconds:.0f} s"


#: Whose rows get notes, and which.
ADVICE: Final[Mapping[str, Callable[[_Row], Iterator[str]]]] = {
    "lines": for_line,
    "servers": for_part,
    "upstreams": for_part,
    "units": for_unit,
}
