"""The operation `why`: failed requests, each with what it waited behind and why its line is down."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from ipaddress import ip_address
from typing import Final

from gateway.errors import StaleValue, WrongQuestion
from gateway.operator.operations.answers.trace import Fact, Stories
from gateway.operator.operations.asked import ToExplain
from gateway.operator.operations.operation import Asker
from gateway.operator.operator import Operator
from gateway.operator.trace.facts import Clock, clocks, fact
from gateway.operator.trace.selection import asked_by, clients_of, lines, of_place, require_ring
from gateway.operator.trace.unit_names import UnitNames
from gateway.operator.units.units import find_unit, shown_unit
from gateway.ports.port import SiteSettings
from gateway.runtime.gateway import Gateway
from gateway.runtime.gateway_upstream import GatewayUpstream
from gateway.runtime.running import Running
from gateway.trace.records import Record, Refused, Sent
from gateway.trace.ring import STEP, Ring

#: How many records are searched for what a failed request waited behind.
_LOOK_BACK: Final = 4 * STEP
#: The digits of the largest unit ID.
_DIGITS: Final = 3
#: Why requests are not sent after another one has failed.
_CONSEQUENCES: Final = ("overdue", "resting")


async def tell_stories(operator: Operator, asked: ToExplain, _asker: Asker) -> Stories:
    """Return why requests failed; see `stories`."""
    return stories(operator.running, asked, clocks())


def stories(
    running: Running, asked: ToExplain, clock: Clock, is_seen: Callable[[Record], bool] = lambda _: True
) -> Stories:
    """List the last failed requests, newest first, without records that the reader may not see (`is_seen`).

    Raises:
        WrongQuestion: nothing is kept, or there is no such unit, line or client.
    """
    require_ring(running.ring)
    names = UnitNames(running.gateway)
    unit, is_his = _of_whom(running, asked.who, names)
    is_wanted = of_place(running.gateway, asked.line, None)
    found = []
    for record in running.ring.failures():
        if is_his(record) and is_wanted(record) and is_seen(record):
            found.append(_story(running, record, clock, names))
            if len(found) == asked.count:
                break
    clients = sorted({each for record in running.ring.failures() for each in clients_of(record)})
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
            return None, asked_by(who)
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
    require_ring(running.ring)
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


def _site(upstream: GatewayUpstream) -> str:
    port = upstream.plan.port
    return port.site if isinstance(port, SiteSettings) else ""


def _is_client(ring: Ring, who: str) -> bool:
    """Return whether this is an address, with or without a port, or the name of a client whose requests have failed."""
    for address in (who, who.rpartition(":")[0].strip("[]")):
        with suppress(ValueError):
            return bool(ip_address(address))
    return any(map(asked_by(who), ring.failures()))


def _is_of_line(gateway: Gateway, name: str) -> Callable[[Record], bool]:
    """Make the test for records of this line, or of the client at the server line of this name."""
    is_there, is_from_there = of_place(gateway, name, None), asked_by(name)
    return lambda record: is_there(record) or is_from_there(record)


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
