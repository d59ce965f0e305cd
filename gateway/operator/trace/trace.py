"""The operations `trace` and `why`: pages of facts from the ring, and the stories of failed requests.

A fact is a JSON object with `kind` and `time` (seconds since 1970) and what `_FACTS` adds. PDUs and bytes are
hexadecimal. They are decoded by the reader, not here beside the lines.
"""

import asyncio
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from ipaddress import ip_address
from typing import Any, Final

from gateway.errors import RequestError, StaleValue, WrongQuestion
from gateway.operator.operations.answers.trace import Fact, Stories, TracedLine, TracePage
from gateway.operator.operations.asked import ToExplain, Traced
from gateway.operator.operations.operation import Asker
from gateway.operator.operator import Operator
from gateway.operator.trace.meanings import Points, points_of
from gateway.operator.trace.unit_names import UnitNames
from gateway.operator.units.units import find_unit, shown_unit
from gateway.ports.port import SiteSettings
from gateway.runtime.gateway import Gateway
from gateway.runtime.gateway_line import GatewayLine
from gateway.runtime.gateway_monitor import GatewayMonitor
from gateway.runtime.gateway_server import GatewayServer
from gateway.runtime.gateway_upstream import GatewayUpstream
from gateway.runtime.running import Running
from gateway.trace.records import (
    RESULTS,
    Answered,
    Heard,
    Incident,
    PortChanged,
    Record,
    Refused,
    Sent,
)
from gateway.trace.ring import STEP, Ring

#: How many records a reader gets first, if it names no time.
TAIL: Final = 20
#: How many records are searched for what a failed request waited behind.
_LOOK_BACK: Final = 4 * STEP

#: The digits of the largest unit ID.
_DIGITS: Final = 3
#: Why requests are not sent after another one has failed.
_CONSEQUENCES: Final = ("overdue", "resting")

_OFF: Final = 'nothing is kept: [trace] ring is "0"; set it to "4 MiB", then modbus-gateway reload'

Clock = tuple[float, float]
"""The time of the event loop, and that of the day, at the same moment."""
Tell = Callable[[Record, Clock, UnitNames], Any]
Choose = Callable[[Sequence[Record]], Sequence[Record]]


def clocks() -> Clock:
    """Read both clocks."""
    return asyncio.get_running_loop().time(), time.time()


async def tell_page(operator: Operator, asked: Traced, _asker: Asker) -> TracePage:
    """Return facts from the ring, as `page` does, and the lines if asked for."""
    running = operator.running
    found = page(running, asked, clocks(), _with_points(points_of(operator)) if asked.points else None)
    return replace(found, lines=lines(running.gateway)) if asked.lines else found


def _with_points(points: Points) -> Tell:
    return lambda record, clock, names: points.beside(fact(record, clock, names))


async def tell_stories(operator: Operator, asked: ToExplain, _asker: Asker) -> Stories:
    """Return why requests failed; see `stories`."""
    return stories(operator.running, asked, clocks())


def page(
    running: Running,
    asked: Traced,
    clock: Clock,
    tell: Tell | None = None,
    choose: Choose = lambda records: records,
) -> TracePage:
    """Collect one step of facts: of the records that are `asked` for, those that `choose` keeps.

    `tell` converts a record, in place of `fact`.

    Raises:
        WrongQuestion: nothing is kept, or there is no such line, unit or result.
    """
    ring = running.ring
    is_wanted = wanted(running, asked)
    number = _number(ring, asked, clock)
    records = ring.after(number)
    following = max(number, ring.first) + len(records)
    begins_at = ring.begins_at
    names = UnitNames(running.gateway)
    chosen = choose([record for record in records if is_wanted(record)])
    return TracePage(
        facts=[(tell or fact)(record, clock, names) for record in chosen],
        next=following,
        missed=max(0, ring.first - number),
        is_all=following == ring.added,
        reaches_back_s=0.0 if begins_at is None else round(clock[0] - begins_at, 3),
    )


def wanted(running: Running, asked: Traced) -> Callable[[Record], bool]:
    """Make the test whether a record is among those that are `asked` for.

    Raises:
        WrongQuestion: nothing is kept, or there is no such line, unit or result.
    """
    if not running.ring.is_on:
        raise WrongQuestion(_OFF)
    is_there = _filter(running.gateway, asked.line, asked.unit)
    function, client, result = asked.function, asked.client, asked.result
    if result is not None and result not in RESULTS:
        raise WrongQuestion(f'there is no result "{result}"; there are {", ".join(RESULTS)}')

    def is_wanted(record: Record) -> bool:
        return (
            is_there(record)
            and (function is None or record.function == function)
            and (client is None or _asked_by(record, client))
            and (result is None or record.has_result(result))
        )

    return is_wanted


def stories(
    running: Running, asked: ToExplain, clock: Clock, is_seen: Callable[[Record], bool] = lambda _: True
) -> Stories:
    """List the last failed requests, newest first, without records that the reader may not see (`is_seen`).

    Raises:
        WrongQuestion: nothing is kept, or there is no such unit, line or client.
    """
    if not running.ring.is_on:
        raise WrongQuestion(_OFF)
    names = UnitNames(running.gateway)
    unit, is_his = _of_whom(running, asked.who, names)
    is_wanted = _filter(running.gateway, asked.line, None)
    found = []
    for record in running.ring.failures():
        if is_his(record) and is_wanted(record) and is_seen(record):
            found.append(_story(running, record, clock, names))
            if len(found) == asked.count:
                break
    clients = sorted({each for record in running.ring.failures() for each in _clients(record)})
    return Stories(found, unit, clients[:20])


def _of_whom(running: Running, who: str, names: UnitNames) -> tuple[int | None, Callable[[Record], bool]]:
    """Find which unit is meant, if any, and make the test whether a record is about that unit, line or client.

    Raises:
        WrongQuestion: there is no such unit, line or client.
    """
    gateway = running.gateway
    try:
        named = int(who) if who.isdecimal() and len(who) <= _DIGITS else who
        return shown_unit(find_unit(gateway.plan, named)), names.is_of(named)
    except WrongQuestion:
        if any(each.name == who for each in lines(gateway)):
            return None, _is_of_line(gateway, who)
        if _is_client(running.ring, who):
            return None, _asked_by_any(who)
        raise


def causes(
    running: Running, unit: int | str, most: int, clock: Clock, is_seen: Callable[[Record], bool]
) -> list[tuple[Fact, Mapping[str, int]]]:
    """List the last failures of a unit with a cause of their own, newest first, as stories.

    Each comes with the number of later requests that were not sent because of it, by result; or, if it was not sent
    itself, of earlier ones that were not sent for the same reason.

    Raises:
        WrongQuestion: nothing is kept.
    """
    if not running.ring.is_on:
        raise WrongQuestion(_OFF)
    names = UnitNames(running.gateway)
    is_his = names.is_of(unit)
    found: list[tuple[Fact, Counter[str]]] = []
    followed, first_of_them, last = Counter[str](), None, ""
    for record in running.ring.failures():
        if not is_his(record) or not is_seen(record):
            continue
        result = record.error.result if isinstance(record, Refused) else ""
        if result in _CONSEQUENCES:
            followed[result] += 1
            first_of_them = first_of_them or record
        elif result and result == last and not followed:
            found[-1][1][result] += 1
        elif len(found) == most:
            break
        else:
            found.append((_story(running, record, clock, names), followed))
            followed, first_of_them, last = Counter[str](), None, result
    else:
        if first_of_them is not None and len(found) < most:  # the cause is no longer kept
            story = _story(running, first_of_them, clock, names)
            followed[story["result"]] -= 1
            found.append((story, followed))
    return [(story, {result: count for result, count in counts.items() if count}) for story, counts in found]


def fact(record: Record, clock: Clock, names: UnitNames) -> Fact:
    """Convert a record to a fact."""
    kind, tell = next((kind, tell) for each, kind, tell in _FACTS if isinstance(record, each))
    told = {"kind": kind, "time": _time(record.at, clock), "line": record.line}
    unit = getattr(record, "unit", None)
    if unit is not None:
        told["unit"] = unit
        told["name"] = names.of(record)
    device, sources = names.device_of(record), names.sources_of(record)
    beside = ({"device": device} if device else {}) | ({"sources": sources} if sources else {})
    return told | tell(record, clock) | beside


def lines(gateway: Gateway) -> tuple[TracedLine, ...]:
    """List the lines and upstreams that facts may name."""
    on_wire = [(each.name, each.plan.line.timing, each.plan.port.port) for each in _serial(gateway)]
    told = [TracedLine(name, timing.mode, port, timing.baud, str(timing.format)) for name, timing, port in on_wire]
    return (*told, *(TracedLine(each.name, "tcp", each.plan.port.port) for each in gateway.upstreams))


def _site(upstream: GatewayUpstream) -> str:
    port = upstream.plan.port
    return port.site if isinstance(port, SiteSettings) else ""


def _serial(gateway: Gateway) -> tuple[GatewayLine | GatewayServer | GatewayMonitor, ...]:
    return (*gateway.lines, *gateway.servers, *gateway.monitors)


def _number(ring: Ring, asked: Traced, clock: Clock) -> int:
    if asked.after is not None:
        return min(asked.after, ring.added)
    if asked.since is not None:
        return ring.number_at(clock[0] - asked.since)
    return max(ring.first, ring.added - TAIL)


def _filter(gateway: Gateway, line: object, unit: object) -> Callable[[Record], bool]:
    known = [each.name for each in lines(gateway)]
    if line is not None and line not in known:
        raise WrongQuestion(f'there is no line "{line}"; there are {", ".join(known)}')
    if unit is None:
        return lambda record: line is None or record.line == line
    names = UnitNames(gateway)
    is_his, name = names.is_of(unit), names.shared.get(find_unit(gateway.plan, unit))
    places = {
        (part.name, device.unit) for part in gateway.owners for device in part.devices.values() if device.name == name
    }

    def is_wanted(record: Record) -> bool:
        if line is not None and record.line != line:
            return False
        if isinstance(record, Heard):
            return (record.line, record.frame[0]) in places
        return is_his(record)

    return is_wanted


def _is_client(ring: Ring, who: str) -> bool:
    """Return whether this is an address, with or without a port, or the name of a client whose requests have failed."""
    for address in (who, who.rpartition(":")[0].strip("[]")):
        with suppress(ValueError):
            return bool(ip_address(address))
    return any(map(_asked_by_any(who), ring.failures()))


def _is_of_line(gateway: Gateway, name: str) -> Callable[[Record], bool]:
    """Make the test for records of this line, or of the client at the server line of this name."""
    is_there, is_from_there = _filter(gateway, name, None), _asked_by_any(name)
    return lambda record: is_there(record) or is_from_there(record)


def _asked_by(record: Record, who: str) -> bool:
    """Return whether a client with this name or address asked for it."""
    clients = [getattr(record, "client", ""), *_clients(record)]
    return any(_is_called(client, who) or who == client.rpartition("@")[2] for client in clients)


def _asked_by_any(who: str) -> Callable[[Record], bool]:
    """Make the test for records of a client with this name or address."""
    return lambda record: any(_is_called(each, who) for each in _clients(record))


def _is_called(client: str, who: str) -> bool:
    """Return whether a client has this name or address; a poll has all those that want it as its client."""
    return who in (client, client.rpartition(":")[0].strip("[]"), *client.split(", "))


def _clients(record: Record) -> list[str]:
    others = [client for client, _, _ in record.others] if isinstance(record, Incident) else []
    return [record.client, *others] if isinstance(record, Sent | Refused) else others


def _story(running: Running, record: Record, clock: Clock, names: UnitNames) -> Fact:
    """Convert a failure to a fact with more: what it waited behind, and why its line is down."""
    gateway, told = running.gateway, fact(record, clock, names)
    if isinstance(record, Sent | Refused):
        end = record.sent_at if isinstance(record, Sent) else record.at
        others = _on_line_between(running.ring, record.line, record.received_at, end, record)
        behind = [(each.unit, names.of(each)) for each in others]
        told["behind"] = [{"unit": unit, "name": name} for unit, name in dict.fromkeys(behind)]
        told["behind_count"] = len(behind)
    if isinstance(record, Refused) and isinstance(record.error, StaleValue):
        told["stale"] = record.error.device
        told["stale_on"] = _owner_of(gateway, record.error.device)
    told["mode"] = next((each.mode for each in lines(gateway) if each.name == record.line), "")
    told["site"] = next((_site(each) for each in gateway.upstreams if each.name == record.line), "")
    trouble = next((part.reconnector.error for part in gateway.parts if part.name == record.line), None)
    told["line_trouble"] = "" if trouble is None else str(trouble)
    return told


def _owner_of(gateway: Gateway, device: str) -> str:
    """Find the line or upstream of a device; empty if none has it."""
    found = (part.name for part in gateway.owners for each in part.all_devices if each.name == device)
    return next(found, "")


def _on_line_between(ring: Ring, line: str, begin: float, end: float, than: Sent | Refused) -> Iterator[Sent]:
    """Yield what was sent on this line meanwhile, except for this request itself."""
    if end <= begin:
        return
    number = max(ring.number_at(begin), ring.first)
    for record in ring.after(number, _LOOK_BACK):
        if isinstance(record, Sent) and record.line == line and record.sent_at < end and not _is_same(record, than):
            yield record


def _is_same(record: Sent, other: Sent | Refused) -> bool:
    """Return whether both are of the same request, which was then sent again."""
    return (record.client, record.received_at, record.request) == (other.client, other.received_at, other.request)


def _time(at: float, clock: Clock) -> float:
    return round(at - clock[0] + clock[1], 6)


def _hex(data: bytes | None) -> str | None:
    return None if data is None else data.hex(" ").upper()


def _milliseconds(seconds: float) -> float:
    return round(seconds * 1000, 3)


def _error(error: RequestError | None) -> Fact:
    return {} if error is None else {"result": error.result, "code": f"{error.code:02X}", "reason": str(error)}


def _exchange(record: Sent, clock: Clock) -> Fact:
    return {
        "client": record.client,
        "address": record.address,
        "request": _hex(record.request),
        "response": _hex(record.response),
        "received": _time(record.received_at, clock),
        "sent": _time(record.sent_at, clock),
        "wait_ms": _milliseconds(record.sent_at - record.received_at),
        "elapsed_ms": _milliseconds(max(0.0, record.at - record.ends_at)),
        "limit_ms": _milliseconds(record.limit),
    }


def _incident(record: Incident, clock: Clock) -> Fact:
    return {
        **_exchange(record, clock),
        **_error(record.error),
        "heard": _hex(record.heard),
        "late_until": _time(record.late_until, clock) if record.late_until else None,
        "retries": record.retries,
        "sent_again": record.sent_again,
        "answered_by": record.answered_by,
        "others": [{"client": client, "unit": unit} for client, unit, _ in record.others],
    }


def _refused(record: Refused, clock: Clock) -> Fact:
    return {
        "client": record.client,
        "request": _hex(record.request),
        "received": _time(record.received_at, clock),
        "wait_ms": _milliseconds(record.at - record.received_at),
        "until": _time(record.until, clock) if record.until else None,
        "count": record.count,
        **_error(record.error),
    }


def _answered(record: Answered, clock: Clock) -> Fact:
    return {
        "client": record.client,
        "request": _hex(record.request),
        "response": _hex(record.response),
        "received": _time(record.received_at, clock),
        "reason": record.reason,
    }


def _heard(record: Heard, _: Clock) -> Fact:
    return {"owner": record.kind, "frame": _hex(record.frame), "count": record.count}


def _port(record: PortChanged, _: Clock) -> Fact:
    return {"reason": record.reason}


#: The kinds of facts, subclasses first.
_FACTS: Final[Iterable[tuple[type[Record], str, Callable[[Any, Clock], Fact]]]] = (
    (Incident, "exchange", _incident),
    (Sent, "exchange", _exchange),
    (Refused, "refused", _refused),
    (Answered, "answered", _answered),
    (Heard, "heard", _heard),
    (PortChanged, "port", _port),
)
