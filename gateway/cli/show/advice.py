"""The notes of `status`: what to do about lines and units that need attention."""

from collections.abc import Iterator, Mapping
from math import ceil
from typing import Final, Literal, NamedTuple

from gateway.config.values.duration import show_age, show_duration
from gateway.devices.moved import how_to_forget
from gateway.lines.counts import RESULTS, Counts
from gateway.operator.operations.answers.status import (
    AnyLine,
    LineStatus,
    MonitorStatus,
    MovedStatus,
    Status,
    UnitStatus,
    UpstreamStatus,
)
from gateway.operator.operations.answers.trouble import FULL
from gateway.timing.verdict import verdict

#: A unit gets a note below this share of answers.
_ANSWERED: Final = 0.95

#: Results of requests that are nothing against their unit: the gateway answers for it, or nobody waits any more.
_WITHOUT_ITS_FAULT: Final = frozenset({"refused", "unwanted"})

#: The usual cause of a unit's last error.
_CAUSES: Final[Mapping[str, str]] = {
    "timeout": "check its power, wiring and address",
    "bad_frame": "check baud rate, format, wiring and termination",
    "ambiguous": "another client on the line polls it",
    "line_lost": "its port was lost",
}
#: The same of a unit behind another server, whose name is {server}.
_CAUSES_BEHIND: Final[Mapping[str, str]] = {
    "timeout": "modbus-gateway doctor {server} looks for the reason",
    "bad_frame": "modbus-gateway doctor {server} looks for the reason",
    "line_lost": "the connection was lost",
}
#: Of a unit in place of whose responses frames of others came.
_OTHER_TRAFFIC: Final = "what came was probably other traffic: check its power, wiring and address"
_NOT_FITTING: Final = "what came did not fit the request: modbus-gateway doctor says why"
_MORE_TIME: Final = "modbus-gateway doctor says how to give it more time"


class Note(NamedTuple):
    """What to do about a part: a line or a unit of this `name`, `called` as the user knows it."""

    page: Literal["lines", "units"]
    name: str
    called: str
    text: str

    def __str__(self) -> str:
        return f"{self.called}: {self.text}"


def notes(status: Status) -> Iterator[Note]:
    """Give all notes."""
    for line in status.lines:
        yield from (Note("lines", line.name, line.name, text) for text in _for_line(line))
    for server in status.servers:
        yield from (Note("lines", server.name, server.name, text) for text in _for_part(server))
    for upstream in status.upstreams:
        yield from (Note("lines", upstream.name, upstream.name, text) for text in _for_upstream(upstream))
    for monitor in status.monitors:
        yield from (Note("lines", monitor.name, monitor.name, text) for text in _for_monitor(monitor))
    lines = {line.name for line in status.lines}
    heard = {monitor.name for monitor in status.monitors}
    for unit in status.units:
        if unit.line in heard:
            yield from (Note("units", unit.name, called(unit), text) for text in _for_heard_unit(unit))
            continue
        found = _for_unit(unit, is_on_line=unit.line in lines)
        yield from (Note("units", unit.name, called(unit), text) for text in found)
    for moved in status.moved:
        yield from (Note("units", moved.name, called(moved), text) for text in _for_moved(moved))


def called(unit: UnitStatus | MovedStatus) -> str:
    """Name a unit as the user knows it."""
    return unit.name if unit.unit is None else f"unit {unit.unit}, {unit.name}"


def count_ok(counts: Counts) -> int:
    """Count requests that the device answered, with an exception or not, and broadcasts."""
    return counts.ok + counts.exception + counts.broadcast


def count_failed(counts: Counts) -> int:
    """Count requests that failed for want of an answer."""
    asked = sum(getattr(counts, result) for result in RESULTS if result not in _WITHOUT_ITS_FAULT)
    return int(asked) - count_ok(counts)


def _for_part(part: AnyLine) -> Iterator[str]:
    """Give the notes about any line or upstream."""
    if part.state == "down":
        yield f"down: {part.reason}"
    elif part.state == "standby":
        yield part.reason


def _for_line(line: LineStatus) -> Iterator[str]:
    """Give the notes about a client line."""
    yield from _for_part(line)
    busy = line.busy_share
    if busy is not None and busy >= FULL:
        yield f"busy for {busy:.0%} of the time{_mostly(line)}: poll less often or raise the baud rate"
    echoes = line.counts.echoes
    if echoes:
        yield f"{echoes} requests came back: if the adapter echoes, set echo = true"


def _for_upstream(upstream: UpstreamStatus) -> Iterator[str]:
    """Give the notes about an upstream."""
    yield from _for_part(upstream)
    busy = upstream.busy_share
    if busy is not None and busy >= FULL:
        yield f"busy for {busy:.0%} of the time: poll less often"


def _for_monitor(monitor: MonitorStatus) -> Iterator[str]:
    """Give the notes about a line that only listens."""
    yield from _for_part(monitor)
    if monitor.state == "up" and not monitor.counts.requests:
        yield f"nothing is heard that is Modbus: modbus-gateway doctor {monitor.name} looks for the reason"


def _for_heard_unit(unit: UnitStatus) -> Iterator[str]:
    """Give the notes about a unit that others ask: there is no limit, and no request of ours."""
    sent, answers = unit.counts.sent, unit.counts.responses + unit.counts.broadcast
    if sent > answers and answers < _ANSWERED * sent:
        yield f"{sent - answers} of {sent} requests of others had no answer that was heard"


def _mostly(line: LineStatus) -> str:
    """Say who takes most of a line's time."""
    if not line.users:
        return ""
    first = line.users[0]
    where = first.device or f"address {first.on_the_wire}"
    return f" ({first.share:.0%} by {first.client}: {where}, function {first.function})"


def _for_unit(unit: UnitStatus, *, is_on_line: bool) -> Iterator[str]:
    """Give the notes about a unit that was polled."""
    yield from _about_failures(unit, is_on_line=is_on_line)
    times, counts = unit.times, unit.counts
    share, late, limit = times.limit_share_p99, times.late, times.limit_ms or 0.0
    found = verdict(share, counts.responses, late, limit)
    if late:
        responses = "one response" if late == 1 else f"{late} responses"
        yield f"{responses} came after the limit: {_MORE_TIME} ({unit.source})"
    elif found == "tight":
        yield f"close to its limit ({share:.0%}): {_MORE_TIME} ({unit.source})"
    elif found == "long" and is_on_line and counts.timeout and times.answer_p99_ms:
        yield (
            f"each request without a response stops its line for {show_duration(limit / 1000)}, which is "
            f"{limit / times.answer_p99_ms:.0f} times what it needs: "
            f"modbus-gateway calibrate {unit.name} finds a shorter limit"
        )


def _about_failures(unit: UnitStatus, *, is_on_line: bool) -> Iterator[str]:
    error = unit.last_error
    causes = _CAUSES if is_on_line else _CAUSES_BEHIND
    cause = causes.get(error, "see the log").format(server=unit.line)
    counts, ok, failed = unit.counts, count_ok(unit.counts), count_failed(unit.counts)
    if error == "bad_frame" and 2 * counts.explained >= max(1, counts.bad_frame):
        cause = _NOT_FITTING
    elif error == "bad_frame" and counts.foreign_frames >= max(1, counts.bad_frame):
        cause = _OTHER_TRAFFIC
    if error == "timeout" and not ok and is_on_line:
        cause += ", and the unit identifier in the client"
    if unit.state == "resting":
        yield f"rests, next try in {show_duration(ceil(unit.rests_ms / 1000))}; {error}: {cause}"
    elif unit.state == "failing":
        yield f"{error}, {unit.failures} in a row: {cause}"
    elif failed > (1 - _ANSWERED) * (ok + failed) and error in causes:
        requests = "1 request" if failed == 1 else f"{failed} requests"
        yield f"{requests} failed; last was {error}{_ago(unit.last_error_ms)}: {cause}"


def _ago(milliseconds: float | None) -> str:
    return "" if milliseconds is None else f", {show_age(milliseconds)} ago"


def _for_moved(unit: MovedStatus) -> Iterator[str]:
    """Give the notes about a unit that is at another address than the config says."""
    if unit.failures:
        yield f"does not answer where it moved to; {how_to_forget(unit.name, unit.configured)}"
