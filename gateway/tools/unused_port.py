"""A scan of a port that no gateway has open, with a line of our own on it; its rate and format may be unknown."""

import asyncio
from collections.abc import AsyncGenerator, Callable, Sequence
from contextlib import aclosing
from dataclasses import replace
from itertools import product
from typing import Final

from gateway.config.plan.settings import LinePlan
from gateway.errors import PortError
from gateway.events import discard_event
from gateway.lines.settings import LineSettings
from gateway.operator.operations.answers.scan import Found, Progress
from gateway.ports.port import Opener, PortSettings
from gateway.profiles.recognition import KnownKind
from gateway.runtime.gateway_line import GatewayLine
from gateway.state.memory import Memory
from gateway.timing.characters import LineTiming, Mode
from gateway.tools.scan import RATES, USUAL_LIMIT, Scan, opened
from gateway.tools.search import FORMATS, Speed
from gateway.trace.ring import Ring

#: The silence before each request, in characters: enough for a v80, which may be on the line.
_IDLE_CHARS: Final = 4.5

#: The rate and format at which a unit answered, then the progress of a scan, and at the end all units found.
SpeedSteps = AsyncGenerator[Speed | Progress | tuple[Found, ...], None]


#: Makes a line on the port, at this rate and format.
AtSpeed = Callable[[Speed], GatewayLine]


def unused_line(port: PortSettings, timing: LineTiming, opener: Opener) -> GatewayLine:
    """Make a line that belongs to no gateway, without devices and without memory."""
    settings = LineSettings(port.port, timing, turnaround=0.1, idle_chars=_IDLE_CHARS)
    plan = LinePlan(port, settings, devices=())
    return GatewayLine(plan, asyncio.get_running_loop(), opener, Memory(), discard_event, Ring())


async def scan_at(
    at_speed: AtSpeed, speed: Speed, units: Sequence[int], limit: float, kinds: Sequence[KnownKind]
) -> SpeedSteps:
    """Scan at this rate and format.

    Raises:
        PortError: the port cannot be opened.
        WrongQuestion: as a Scan.
    """
    yield speed
    line = at_speed(speed)
    async with opened(line), aclosing(Scan(line, units, limit, kinds).run()) as steps:
        async for step in steps:
            yield step


async def scan_at_found_speed(
    at_speed: AtSpeed,
    mode: Mode,
    likely: Sequence[int],
    units: Sequence[int],
    limit: float,
    kinds: Sequence[KnownKind],
) -> SpeedSteps:
    """Scan at the first usual rate and format at which one of the `likely` units answers; find nobody if none does.

    Raises:
        PortError: the port can do none of them.
        WrongQuestion: as a Scan.
    """
    speeds = [Speed(*each) for each in product(RATES, FORMATS[mode])]
    troubles: list[PortError] = []
    for number, speed in enumerate(speeds):
        line, is_found = at_speed(speed), False
        try:
            async with opened(line), aclosing(Scan(line, likely, limit).run()) as steps:
                async for step in steps:
                    if isinstance(step, tuple):
                        is_found = any(each.result != "garbled" for each in step)
                    else:
                        yield _of_all(step, number, len(speeds))
        except PortError as error:  # the port cannot do this rate or format
            troubles.append(error)
            continue
        if is_found:
            async with aclosing(scan_at(at_speed, speed, units, limit, kinds)) as found:
                async for each in found:
                    yield each
            return
        if line.driver.is_virtual:  # any other rate or format is the same there
            break
    if len(troubles) == len(speeds):
        raise troubles[0]
    yield ()


def _of_all(step: Progress, number: int, speeds: int) -> Progress:
    """Turn the progress at one of so many speeds into that of all."""
    asked, of = number * step.of + step.asked, speeds * step.of
    one = step.left_s / (step.of - step.asked) if step.asked < step.of else USUAL_LIMIT
    return replace(step, asked=asked, of=of, left_s=round((of - asked) * one, 1))
