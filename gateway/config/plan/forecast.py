"""The time limits that follow from a plan, and how long a client may have to wait for each unit."""

from collections.abc import Hashable, Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

from gateway.config.plan.settings import LinePlan, MonitorPlan, Plan, ServerPlan, UpstreamPlan
from gateway.devices.device import DeviceSettings
from gateway.lines.settings import LineSettings
from gateway.listeners.sessions.server_line import UNNOTICED
from gateway.modbus.codes import MAX_PDU, FunctionCode
from gateway.modbus.functions import (
    FUNCTIONS,
    KNOWN_FUNCTIONS,
    READING_FUNCTIONS,
    READING_IDENTIFICATION,
    TABLE_FUNCTIONS,
    Items,
)
from gateway.modbus.pdu import RequestPdu, parse_request
from gateway.ports.port import TcpSettings
from gateway.profiles.profile import Profile
from gateway.timing.budget import AnswerTime, Budget, ServerBudget

#: A guard is longer than the transaction by this many seconds: the delay that the operating system may add.
_MARGIN: Final = 0.05

#: How much longer than a unit's longest wait the time-out of another site is: the owner sends in five sixths of it.
_TIMEOUT_AT_OTHER_SITES: Final = 1.25

#: Stands for all unknown functions.
_UNKNOWN_FUNCTION: Final = 65

#: Of functions that read or write no table: those requests that have the longest responses, or are the longest (A 6).
_LARGEST: Final[dict[int, bytes]] = {
    FunctionCode.READ_FILE_RECORD: bytes((20, 7, 6, 0, 1, 0, 0, 0, 124)),
    FunctionCode.WRITE_FILE_RECORD: bytes((21, 245, 6, 0, 1, 0, 0, 0, 119)) + bytes(2 * 119),
    FunctionCode.ENCAPSULATED_INTERFACE: bytes((*READING_IDENTIFICATION, 1, 0)),
}


#: How long an answer to a request that was heard may come, for a device without a timing table, in seconds.
USUAL_WINDOW: Final = 5.0

#: How many requests are kept: the limits of all devices are worked out from the same few.
_REQUESTS: Final = 128


@dataclass(frozen=True, slots=True)
class FunctionLimits:
    """Time limits of one function in seconds: for `one` item, and for the `most` items a device takes.

    `function` None means every function without such items, and `most` is 0 for those. `request` is the largest
    request on the wire.
    """

    function: int | None
    most: int
    one_item: float
    most_items: float
    request: float


def function_limits(
    profile: Profile, answer_time: AnswerTime, budget: Budget | ServerBudget
) -> tuple[FunctionLimits, ...]:
    """Compute the limits of all functions of a device."""
    return tuple(_limits_of(function, profile, budget, answer_time) for function in _functions(profile))


def longest_wait(plan: LinePlan, device: DeviceSettings, *, repeats: bool = True) -> float:
    """Compute the longest wait for this device: in the queue and for a new connection, for the gap, for the response.

    With `repeats`, it ends with the last one, and a device that sleeps is sent its first read twice.
    """
    limits = function_limits(device.profile, device.answer_time, plan.budget)
    longest = [one.request + one.most_items for one in limits]
    if repeats and (plan.line.retries or device.wake):
        longest += [_add_repeats(one, plan.line, device) for one in limits if _is_repeated(one.function)]
    return _longest_wait_for_turn(plan.line) + plan.line.silence_before_request + max(longest)


def owed_after_waking(plan: LinePlan, device: DeviceSettings) -> float:
    """Compute how long after the answer to a read that was sent twice, to wake a device, the other one is awaited.

    Meanwhile no read with that function is sent to it: it waits, or gets 0B if it could not be sent within `max_wait`.
    0 if the device never sleeps, or is not read.
    """
    if not device.wake:
        return 0.0
    limits = function_limits(device.profile, device.answer_time, plan.budget)
    reads = [one.most_items for one in limits if one.function in READING_FUNCTIONS]
    return max((limit + _late_window(limit, plan.line, device) for limit in reads), default=0.0)


def heard_window(plan: MonitorPlan, device: DeviceSettings | None, asked: RequestPdu | None = None) -> float:
    """Compute for how long an answer to a request that was heard may come; without a request, the longest of these.

    It is the slowest answer of the device, and at least twice the limit of the request. A unit that is not configured
    has no device.
    """
    if plan.line.late_window is not None:
        return plan.line.late_window
    if device is None:
        return USUAL_WINDOW
    time, budget = device.answer_time, plan.budget
    if asked is not None:
        limit = budget.limit(asked, time)
    else:
        limit = max(each.most_items for each in function_limits(device.profile, time, budget))
    return max(time.slowest if device.profile.timing.rows else USUAL_WINDOW, 2 * limit)


def longest_waits(plan: LinePlan, *, repeats: bool = True) -> dict[str, float]:
    """Compute the longest wait for each device of the line, by its name."""
    waits = {_limiting(each): longest_wait(plan, each, repeats=repeats) for each in one_of_each_kind(plan)}
    return {each.name: waits[_limiting(each)] for each in plan.devices}


def one_of_each_kind(plan: LinePlan) -> Iterable[DeviceSettings]:
    """Choose a device for each set of limits: all units of a line may have the same."""
    return {_limiting(each): each for each in plan.devices}.values()


def guard(plan: LinePlan) -> float:
    """Compute a time in seconds that no transaction on the line exceeds, from the moment of its writing."""
    line = plan.line
    held_back = plan.port.arrives_within if isinstance(plan.port, TcpSettings) else 0.0
    return max(_longest_transaction(plan), line.turnaround) + held_back + _MARGIN


def longest_late_window(plan: LinePlan) -> float:
    """Compute how long after its limit a response may still come on the line, in seconds."""
    limit = _longest_transaction(plan)
    return max((_late_window(limit, plan.line, device) for device in one_of_each_kind(plan)), default=2 * limit)


def _longest_transaction(plan: LinePlan) -> float:
    """Compute the longest time from the writing of a request to the end of its limit."""
    before = _longest_wait_for_turn(plan.line)
    return max(longest_waits(plan, repeats=False).values(), default=before) - before


def _longest_wait_for_turn(line: LineSettings) -> float:
    return line.max_wait + line.after_connect


def least_for_repeat(plan: LinePlan) -> float:
    """Compute the shortest `retry_within` that lets any read be sent again after silence; 0 if there are no reads."""
    needed = (_needed_for_repeat(limits, plan.line, device) for limits, device in _reads(plan))
    return min(needed, default=0.0)


def times_for_repeats(plan: LinePlan) -> tuple[float, float]:
    """Compute how long a read may take with its repeats, at least and at most; 0 if there are no reads."""
    times = [
        plan.line.time_for_repeats(limits.request, limit, _late_window(limit, plan.line, device))
        for limits, device in _reads(plan)
        for limit in (limits.one_item, limits.most_items)
    ]
    return min(times, default=0.0), max(times, default=0.0)


def longest_waits_behind(plan: UpstreamPlan) -> dict[str, float]:
    """Compute the longest wait for each unit behind another server, by its name: for its turn, and for the response.

    Reads are repeated at once, and sent once more to wake a device. That may need a new connection: the server answers
    with identifier 0, half of a response has come, or another address is tried. The first requests wait for the
    connection too, and for what has to pass after it.
    """
    settings = plan.upstream
    before = settings.max_wait + settings.gap + settings.after_connect
    is_connection = isinstance(plan.port, TcpSettings)
    waits: dict[Hashable, float] = {}
    others = [plan.usual] if plan.usual is not None and plan.unlisted else []
    for device in (*plan.devices, *others):
        kind = _limiting(device)
        if kind not in waits:
            limits = function_limits(device.profile, device.answer_time, plan.budget)
            limit, repeats = max(one.most_items for one in limits), (device.wake > 0.0) + settings.retries
            connecting = min(limit, settings.max_wait) + settings.after_connect if is_connection else 0.0
            waits[kind] = before + limit + repeats * (settings.gap + connecting + limit)
    known = {device.name: waits[_limiting(device)] for device in plan.devices}
    return known | {name: waits[_limiting(usual)] for usual in others for name in plan.unlisted.values()}


def least_timeouts_at_other_sites(plan: Plan) -> dict[str, float]:
    """Compute the shortest `timeout` of an upstream at another site, for each line and upstream here by its name."""
    waits = {line.line.name: [longest_wait(line, device) for device in line.shared] for line in plan.lines}
    waits |= {one.upstream.name: [*longest_waits_behind(one).values()] for one in plan.upstreams}
    return {name: _TIMEOUT_AT_OTHER_SITES * max(each) for name, each in waits.items() if each}


def most_items(function: int, profile: Profile) -> int:
    """Find the most items that protocol, profile and the addresses of the device allow; 1 at least."""
    items = _items_of(function)
    most = max(each.most for each in items)
    ranges = profile.areas.get(items[0].area)
    longest = most if ranges is None else max((last - first + 1 for first, last in ranges), default=1)
    return min(most, longest, profile.limits.get(function, longest))


def waits_by_name(plan: Plan) -> dict[str, float]:
    """Compute the longest wait for each unit, by its name."""
    waits = {name: wait for line in plan.lines for name, wait in longest_waits(line).items()}
    waits |= {name: wait for upstream in plan.upstreams for name, wait in longest_waits_behind(upstream).items()}
    waits |= {device.name: 0.0 for monitor in plan.monitors for device in monitor.devices}
    waits |= {image.name: image.longest_wait for image in plan.images}
    through = {mirror.name: waits[mirror.of] for mirror in plan.mirrors}
    through |= {unit.name: max((waits.get(name, 0.0) for name in unit.devices), default=0.0) for unit in plan.virtual}
    return waits | through


def waits_behind(server: ServerPlan, plan: Plan) -> dict[int, tuple[str, float]]:
    """Find the name of the destination of each unit of a server line, and the longest wait for it."""
    behind = waits_by_name(plan)
    waits = {device.known_as: (device.name, behind[device.name]) for device in plan.shared}
    waits |= {image.unit: (image.name, image.longest_wait) for image in plan.images}
    waits |= {mirror.unit: (mirror.name, behind[mirror.name]) for mirror in plan.mirrors}
    waits |= {unit.unit: (unit.name, behind[unit.name]) for unit in plan.virtual}
    return {unit: waits[unit] for unit in sorted(server.line.serves)}


def longest_wait_outside(server: ServerPlan) -> float:
    """Compute the longest time from the end of a request on a server line to the end of its response, if it has one.

    It does not depend on the request: any response may take `answer_within` when the gateway stands still.
    """
    line = server.line
    answer = line.answer_within + UNNOTICED
    return answer + line.silence_before_response + server.latency + line.timing.longest_frame


def _reads(plan: LinePlan) -> Iterator[tuple[FunctionLimits, DeviceSettings]]:
    """Find the limits of the reading functions of each kind of device."""
    for device in one_of_each_kind(plan):
        for limits in function_limits(device.profile, device.answer_time, plan.budget):
            if limits.function in READING_FUNCTIONS:
                yield limits, device


def _limiting(device: DeviceSettings) -> Hashable:
    """Give what the waits for a device depend on; tables and profiles as identities."""
    time = device.answer_time
    return id(device.profile), id(time.table), time.margin, time.timeout, time.fixed, device.wake


def _is_repeated(function: int | None) -> bool:
    """Tell whether a request with this function may be sent again. Of those without items (None), some may."""
    return function is None or function in READING_FUNCTIONS


def _add_repeats(limits: FunctionLimits, line: LineSettings, device: DeviceSettings) -> float:
    """Compute the time from the first attempt of a read until its last one has failed."""
    limit, once = limits.most_items, limits.request + limits.most_items
    waking = limits.request + max(limit, line.silence_before_request) if device.wake else 0.0
    repeats = line.time_for_repeats(limits.request, limit, _late_window(limit, line, device)) if line.retries else once
    return waking + repeats


def _late_window(limit: float, line: LineSettings, device: DeviceSettings) -> float:
    """Compute the late window after this limit."""
    return max(2 * limit, device.answer_time.slowest) if line.late_window is None else line.late_window


def _needed_for_repeat(limits: FunctionLimits, line: LineSettings, device: DeviceSettings) -> float:
    """Compute the time from the first attempt of a read of one item until its second one has failed, after silence."""
    return 2 * (limits.request + limits.one_item) + _late_window(limits.one_item, line, device)


def _functions(profile: Profile) -> Iterator[int]:
    if profile.functions is None:
        yield from (*sorted(TABLE_FUNCTIONS), _UNKNOWN_FUNCTION)
    else:
        yield from sorted(profile.functions)


def _limits_of(
    function: int, profile: Profile, budget: Budget | ServerBudget, answer_time: AnswerTime
) -> FunctionLimits:
    if function not in TABLE_FUNCTIONS:
        named = None if profile.functions is None else function
        functions = {*KNOWN_FUNCTIONS - TABLE_FUNCTIONS, _UNKNOWN_FUNCTION} if named is None else {named}
        longest = [_largest_request(each) for each in functions]
        limit = max(budget.limit(asked, answer_time) for asked in longest)
        return FunctionLimits(named, 0, limit, limit, max(map(budget.request_wire_time, longest)))
    most = most_items(function, profile)
    largest = request_for(function, most)
    return FunctionLimits(
        function,
        most,
        budget.limit(request_for(function, 1), answer_time),
        budget.limit(largest, answer_time),
        budget.request_wire_time(largest),
    )


@lru_cache(maxsize=_REQUESTS)
def _largest_request(function: int) -> RequestPdu:
    row = FUNCTIONS.get(function)
    size = row.request.sizes[-1] if row else MAX_PDU
    return parse_request(_LARGEST.get(function, bytes((function,)) + bytes(size - 1)))


def _items_of(function: int) -> list[Items]:
    """List what a function reads or writes in the tables."""
    row = FUNCTIONS[function]
    return [items for items in (row.reads, row.writes) if items is not None]


@lru_cache(maxsize=_REQUESTS)
def request_for(function: int, count: int) -> RequestPdu:
    """Make a request for this many items from address 0 on, or for the most there can be."""
    pdu = bytes((function,))
    for items in _items_of(function):
        named = min(count, items.most)
        pdu += bytes(2) if items.most == 1 else bytes((0, 0, *named.to_bytes(2, "big")))
        if items.values_at and items.most > 1:
            size = items.byte_count(named)
            pdu += bytes((size,)) + bytes(size)
    return parse_request(pdu.ljust(FUNCTIONS[function].request.sizes[0], b"\0"))
