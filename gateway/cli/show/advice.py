"""The notes of `status`: what to do about lines and units that need attention."""

from collections.abc import Callable, Iterator, Mapping
from math import ceil
from typing import Any, Final

from gateway.config.values.duration import show_age, show_duration
from gateway.devices.quirks import how_to_forget
from gateway.lines.counts import RESULTS
from gateway.timing.verdict import verdict

#: A row gets a note from this share of a line's time on, and below this share of answers.
BUSY: Final = 0.9
ANSWERED: Final = 0.95

_Row = Mapping[str, Any]

#: Results of requests that are nothing against their unit: the gateway answers for it, or nobody waits any more.
_WITHOUT_ITS_FAULT: Final = frozenset({"refused", "unwanted"})

#: The usual cause of a unit's last error.
_CAUSES: Final[Mapping[str, str]] = {
    "timeout": "check its power, wiring and address",
    "bad_frame": "check baud rate, format, wiring and termination",
    "ambiguous": "another client on the line polls it",
    "line_lost": "its port was lost",
}
#: Of a unit in place of whose responses frames of others came.
_OTHER_TRAFFIC: Final = "what came was probably other traffic: check its power, wiring and address"
_NOT_FITTING: Final = "what came did not fit the request: modbus-gateway doctor says why"
_MORE_TIME: Final = "modbus-gateway doctor says how to give it more time"


def count_ok(one: _Row) -> int:
    """Requests that the device answered, with an exception or not, and broadcasts."""
    counts = one["counts"]
    return int(counts["ok"] + counts["exception"] + counts["broadcast"])


def count_failed(one: _Row) -> int:
    """Requests that failed for want of an answer. A result that an older gateway does not know counts as 0."""
    counts: Mapping[str, int] = one["counts"]
    return sum(counts.get(result, 0) for result in RESULTS if result not in _WITHOUT_ITS_FAULT) - count_ok(one)


def for_part(part: _Row) -> Iterator[str]:
    """Notes about a line, a server line or an upstream."""
    if part["state"] == "down":
        yield f"down: {part['reason']}"
    elif part["state"] == "standby":
        yield str(part["reason"])


def for_line(line: _Row) -> Iterator[str]:
    """Notes about a client line."""
    yield from for_part(line)
    busy = line["busy_share"]
    if busy is not None and busy >= BUSY:
        yield f"busy for {busy:.0%} of the time{_mostly(line)}: poll less often or raise the baud rate"
    echoes = line["counts"]["echoes"]
    if echoes:
        yield f"{echoes} requests came back: if the adapter echoes, set echo = true"


def _mostly(line: _Row) -> str:
    """Who takes most of a line's time. Gateways of earlier versions do not tell."""
    users = line.get("users")
    if not users:
        return ""
    first = users[0]
    where = first["device"] or f"address {first['on_the_wire']}"
    return f" ({first['share']:.0%} by {first['client']}: {where}, function {first['function']})"


def for_unit(unit: _Row) -> Iterator[str]:
    """Notes about a unit that was polled."""
    yield from _about_failures(unit)
    times, counts = unit["times"], unit["counts"]
    share, late, limit = times["limit_share_p99"], times["late"], times["limit_ms"]
    found = verdict(share, counts["responses"], late, limit or 0.0)
    if late:
        responses = "one response" if late == 1 else f"{late} responses"
        yield f"{responses} came after the limit: {_MORE_TIME} ({unit['source']})"
    elif found == "tight":
        yield f"close to its limit ({share:.0%}): {_MORE_TIME} ({unit['source']})"
    elif found == "long" and counts["timeout"]:
        yield (
            f"each request without a response stops its line for {show_duration(limit / 1000)}, which is "
            f"{limit / times['answer_p99_ms']:.0f} times what it needs: "
            f"modbus-gateway calibrate {unit['name']} finds a shorter limit"
        )


def _about_failures(unit: _Row) -> Iterator[str]:
    error = str(unit["last_error"])
    cause = _CAUSES.get(error, "see the log")
    counts = unit["counts"]
    if error == "bad_frame" and 2 * counts.get("explained", 0) >= max(1, counts["bad_frame"]):
        cause = _NOT_FITTING
    elif error == "bad_frame" and counts["foreign_frames"] >= max(1, counts["bad_frame"]):
        cause = _OTHER_TRAFFIC
    if error == "timeout" and not count_ok(unit):
        cause += ", and the unit identifier in the client"
    if unit["state"] == "resting":
        yield f"rests, next try in {show_duration(ceil(unit['rests_ms'] / 1000))}; {error}: {cause}"
    elif unit["state"] == "failing":
        yield f"{error}, {unit['failures']} in a row: {cause}"
    elif count_failed(unit) > (1 - ANSWERED) * (count_ok(unit) + count_failed(unit)) and error in _CAUSES:
        failed = count_failed(unit)
        requests = "1 request" if failed == 1 else f"{failed} requests"
        yield f"{requests} failed; last was {error}{_ago(unit['last_error_ms'])}: {cause}"


def _ago(milliseconds: float | None) -> str:
    return "" if milliseconds is None else f", {show_age(milliseconds)} ago"


def for_moved(unit: _Row) -> Iterator[str]:
    """Notes about a unit that is at another address than the config says."""
    if unit["failures"]:
        yield f"does not answer where it moved to; {how_to_forget(unit['name'], unit['configured'])}"


#: The notes for the rows of each section.
ADVICE: Final[Mapping[str, Callable[[_Row], Iterator[str]]]] = {
    "lines": for_line,
    "servers": for_part,
    "upstreams": for_part,
    "units": for_unit,
    "moved": for_moved,
}
