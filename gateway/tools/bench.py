"""The verb `bench`: the calculated throughput of a line, and the measured one of consecutive reads.

The reads are requests of the client `control`, with its rights: they take turns in the line's queue with those of other
clients. At most READS_AHEAD of them are under way, so another client waits for one of them at most.
"""

import asyncio
from collections import deque
from collections.abc import AsyncGenerator, Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

from gateway.config.plan.line_load import a_read, time_of
from gateway.config.plan.settings import LinePlan, Plan
from gateway.devices.device import DeviceSettings
from gateway.errors import WrongQuestion
from gateway.images.polls import Poll, joined
from gateway.lines.breaker import FAILURES
from gateway.modbus.codes import EXCEPTION_BIT
from gateway.modbus.functions import READERS
from gateway.modbus.pdu import Span
from gateway.operator.operations.answers.bench import BenchProgress, BenchRead, BenchResult, BenchStep
from gateway.operator.operations.asked import ToMeasure
from gateway.operator.operations.operation import Asker, IsThere
from gateway.operator.operator import Operator
from gateway.operator.units.units import find_line, find_unit
from gateway.operator.values.requests import AwaitedOrigin
from gateway.profiles.holes import Holes
from gateway.profiles.read_rules import ReadRules
from gateway.registers.items import read_request
from gateway.request import Request
from gateway.routing.router import Router
from gateway.runtime.gateway import Gateway
from gateway.runtime.running import Running

#: One on the line, and one waiting.
READS_AHEAD: Final = 2
#: After this many failures in a row a unit is not read any more: one more, and it would rest for clients too.
MOST_FAILURES: Final = FAILURES - 1
_NOT_ANSWERED: Final = ("timeout", "bad_frame", "ambiguous")
#: Seconds between progress reports.
_STEP: Final = 1.0
#: Pause after a failed read, in seconds: a line that is down refuses at once.
_PAUSE: Final = 0.1


@dataclass(slots=True, eq=False)
class _Read:
    """A read of a device, its failures in a row, and how often it is under way."""

    name: str
    unit: int
    pdu: bytes
    failures: int = 0
    under_way: int = 0

    @property
    def may_be_sent(self) -> bool:
        """Whether one more failure would not yet make its unit rest."""
        return self.failures + self.under_way < MOST_FAILURES


async def measure(operator: Operator, asked: ToMeasure, asker: Asker) -> AsyncGenerator[BenchStep, None]:
    """Measure a line, and yield its progress, if asked for, and the result.

    Raises:
        WrongQuestion: as `bench`.
    """
    await operator.running.settled()
    begun: list[BenchResult] = []
    now = asyncio.get_running_loop().time
    began = now()
    measuring = asyncio.create_task(bench(operator.running, asked, asker.is_there, begun.append), name="bench")
    try:
        while not (await asyncio.wait((measuring,), timeout=_STEP))[0]:
            if asked.progress:
                reads = sum(each.answered + each.exceptions + each.failed for each in begun)
                yield BenchStep(progress=BenchProgress(round(now() - began, 1), reads))
        yield BenchStep(bench=measuring.result())
    finally:
        measuring.cancel()
        await asyncio.gather(measuring, return_exceptions=True)


async def bench(
    running: Running,
    asked: ToMeasure,
    is_there: IsThere,
    begin: Callable[[BenchResult], object] = lambda _: None,
) -> BenchResult:
    """Read the units of a line, or one of them, for `asked.seconds`, and count the answers.

    Each read is of `asked.items` items, from `asked.address` on if that is given. `begin` gets the result, which grows
    while it measures. It ends early if the client has left, or no unit answers.

    Raises:
        WrongQuestion: there is no such line or unit, nothing of it can be read, or a reload has changed the line.
    """
    gateway = running.gateway
    line = find_line(gateway, asked.line)
    wanted = list(_reads(gateway, line.plan, asked))
    if not wanted:
        raise WrongQuestion(f"no unit of {line.name} can be read by its number; name one of them")
    planned = [one for one in wanted if not line.devices[one.device.known_as].breaker.is_resting(line.now())]
    left_out = [one.device.name for one in wanted if one not in planned]
    if not planned:
        what = f"{', '.join(left_out)} backs off after several failures, and nothing is sent to it"
        raise WrongQuestion(f"{what}; modbus-gateway status says until when")
    pictures = tuple(_picture(line.plan, one) for one in planned)
    result = BenchResult(line.name, pictures, left_out=left_out, expected_per_second=_expected(pictures))
    begin(result)
    now = asyncio.get_running_loop().time
    began, sent_before, busy_before = now(), line.sent, line.driver.line.phases(now()).busy
    reads = deque(_Read(one.device.name, one.device.known_as, read_request(one.span)) for one in planned)

    def is_wanted() -> bool:
        return is_there() and running.ports.keeps(line)

    async with asyncio.TaskGroup() as group:
        for number in range(READS_AHEAD):
            reading = _read_on(running.routers.control, reads, began + asked.seconds, is_wanted, result)
            group.create_task(reading, name=f"bench:{line.name}:{number}")
    if not running.ports.keeps(line):
        raise WrongQuestion(f"a reload has changed {line.name}: measure it again")
    elapsed = now() - began
    own = result.answered + result.exceptions
    result.seconds = round(elapsed, 3)
    result.others = max(0, line.sent - sent_before - own - result.failed)
    result.busy_share = round(min(1.0, (line.driver.line.phases(now()).busy - busy_before) / elapsed), 3)
    result.measured_per_second = round(own / elapsed, 3)
    return result


def _expected(reads: Sequence[BenchRead]) -> float | None:
    """Calculate how many of these reads per second the line can carry; None if they take no time."""
    time = sum(one.line_time_ms for one in reads)
    return round(1000 * len(reads) / time, 3) if time else None


class _Planned(NamedTuple):
    device: DeviceSettings
    span: Span


async def _read_on(
    control: Router, reads: deque[_Read], until: float, is_wanted: Callable[[], bool], result: BenchResult
) -> None:
    """Read until it is time to stop or no unit answers, and count the results."""
    now = asyncio.get_running_loop().time
    while now() < until and is_wanted() and any(each.failures < MOST_FAILURES for each in reads):
        read, origin = reads[0], AwaitedOrigin(is_wanted)
        reads.rotate(-1)
        if not read.may_be_sent:
            await asyncio.sleep(0 if any(each.may_be_sent for each in reads) else _PAUSE)
            continue
        read.under_way += 1
        control.submit(Request(read.unit, read.pdu, origin, now()), now())
        error, response = await origin.outcome
        read.under_way -= 1
        if error is None:
            read.failures = 0
        elif error.result in _NOT_ANSWERED:
            read.failures += 1
        if error is not None and error.result == "resting":  # because of requests of other clients
            read.failures = MOST_FAILURES
            result.left_out = sorted({*result.left_out, read.name})
        elif error is not None and error.result == "overdue":  # a late response of the unit may still come
            await asyncio.sleep(_PAUSE)
        elif error is not None or response is None:
            result.failed += 1
            result.last_failure = "" if error is None else error.result
            await asyncio.sleep(_PAUSE)
        elif response[0] & EXCEPTION_BIT:
            result.exceptions += 1
        else:
            result.answered += 1


def _reads(gateway: Gateway, line: LinePlan, asked: ToMeasure) -> Iterator[_Planned]:
    """Plan the reads, and their devices."""
    for device in _devices(gateway, line, asked.unit):
        span = _span(gateway.plan, device, asked.items)
        if span is not None:
            yield _Planned(device, span if asked.address is None else replace(span, start=asked.address))


def _devices(gateway: Gateway, line: LinePlan, wanted: object) -> list[DeviceSettings]:
    if wanted is None:
        return [] if line.passes_through else list(line.devices)
    unit = find_unit(gateway.plan, wanted)
    found = [device for device in line.shared if device.known_as == unit]
    if not found:
        called = f"unit {wanted}" if isinstance(wanted, int) else wanted
        raise WrongQuestion(f"{called} is not on {line.line.name}")
    return found


def _span(plan: Plan, device: DeviceSettings, items: int) -> Span | None:
    """Choose a read that the device answers: from its longest run of points, else from its profile."""
    points = [point for point in plan.points.get(device.known_as, ()) if point.write != "only"]
    runs = [poll.span for poll in joined(map(Poll.of, points), ReadRules(device.profile.limits), Holes())]
    known = [span for span in runs if device.profile.knows(READERS[span.area][0])]
    if not known:
        return a_read(device.profile, items)
    longest = max(known, key=lambda span: span.count)
    return replace(longest, count=min(items, longest.count))


def _picture(line: LinePlan, one: _Planned) -> BenchRead:
    time = time_of(line, one.device, read_request(one.span))
    has_time = READERS[one.span.area][0] in one.device.profile.timing.rows
    span = one.span
    return BenchRead(
        one.device.client_unit, one.device.name, span.area, span.start, span.count, round(1000 * time, 3), has_time
    )
