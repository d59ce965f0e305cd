"""Scans on order of a user of the web page: of a port that no line of the gateway has, or of one of its lines.

One scan goes on at a time, and it ends when nobody looks at its page any longer, when the config is reloaded, and at a
deadline. Nothing is written anywhere.
"""

import asyncio
import secrets
from collections.abc import AsyncGenerator, Sequence
from contextlib import aclosing
from dataclasses import dataclass, field
from typing import Final

from gateway import events
from gateway.clock.threads import in_thread
from gateway.config.machine.known_kinds import known_kinds
from gateway.errors import PortError, WrongQuestion
from gateway.lines.line import Line
from gateway.operator.operations.answers.scan import Found, Progress
from gateway.operator.operations.asked import ToScan
from gateway.operator.operations.operation import Asker
from gateway.operator.operator import Operator
from gateway.ports.port import SerialSettings
from gateway.runtime.gateway_line import GatewayLine
from gateway.runtime.overdue import place_of
from gateway.timing.characters import LineTiming
from gateway.tools.scan import USUAL_LIMIT
from gateway.tools.scans import scan
from gateway.tools.search import FORMATS, Speed
from gateway.tools.unused_port import SpeedSteps, scan_at, scan_at_found_speed, unused_line

#: The longest that a scan may take, and how long nobody may have looked at it, in seconds.
LONGEST: Final = 900.0
LEFT: Final = 20.0
#: How often it is looked whether a scan is to end, in seconds.
_STEP: Final = 0.25
#: Finished scans are kept for this many seconds, and so many of them.
KEPT: Final = 3600.0
MOST_KEPT: Final = 16
#: Where a unit is looked for at each rate and format: factory settings.
LIKELY: Final = (*range(1, 11), 247)


@dataclass(frozen=True, slots=True)
class PortToScan:
    """A serial port, and how its line is set. Without `speed` that is to be found."""

    port: str
    timing: LineTiming
    is_speed_known: bool
    units: tuple[int, ...]


@dataclass(slots=True)
class PageScan:
    """A scan that goes on or has ended: of the port or the line `of`, for `user`. `owner` is the user's CSRF token.

    `found` is None until it has ended with a result, and `trouble` says why it has ended without one. `speed` is the
    one at which units answered, None while it is not known. `asked` are the unit numbers.
    """

    of: str
    is_line: bool
    mode: str
    asked: tuple[int, ...]
    user: str
    owner: str
    began: float
    looked_at: float
    identifier: str = field(default_factory=lambda: secrets.token_urlsafe(12))
    speed: Speed | None = None
    progress: Progress | None = None
    found: tuple[Found, ...] | None = None
    trouble: str = ""
    ended: float | None = None


class PageScans:
    """The scan that goes on, if one does, and the last ones."""

    def __init__(self, operator: Operator) -> None:
        self._operator = operator
        self._scans: list[PageScan] = []
        self._task: asyncio.Task[None] | None = None
        self._now = asyncio.get_running_loop().time

    @property
    def current(self) -> PageScan | None:
        """The scan that goes on."""
        return self._scans[-1] if self._task is not None else None

    def find(self, identifier: str, owner: str) -> PageScan | None:
        """Find a scan of this owner, who looks at it now; None if there is none."""
        found = next((each for each in self._scans if each.identifier == identifier and each.owner == owner), None)
        if found is not None:
            found.looked_at = self._now()
        return found

    def last_of(self, owner: str) -> PageScan | None:
        """Return the last scan of this owner; None without one."""
        return next((each for each in reversed(self._scans) if each.owner == owner), None)

    def start_on_port(self, wanted: PortToScan, user: str, owner: str) -> PageScan:
        """Start a scan of a port that no line has.

        Raises:
            WrongQuestion: another scan goes on, or a line of the gateway has the port.
        """
        line = self.line_at(wanted.port)
        if line:
            raise WrongQuestion(f"the line {line} has {wanted.port}: scan that line")
        found = self._new(wanted.port, user, owner, wanted.units, wanted.timing.mode)
        return self._started(found, self._on_port(wanted))

    def start_on_line(self, line: str, asker: Asker, units: Sequence[int], user: str, owner: str) -> PageScan:
        """Start a scan of a line of the gateway, for units that the config does not name.

        Raises:
            WrongQuestion: another scan goes on.
        """
        timing = next((each.plan.line.timing for each in self._operator.gateway.lines if each.name == line), None)
        found = self._new(line, user, owner, tuple(units), timing.mode if timing else "rtu")
        found.is_line = True
        return self._started(found, self._on_line(ToScan(line, [str(unit) for unit in units]), asker))

    def end(self, found: PageScan, why: str) -> None:
        """End a scan that goes on."""
        if found is self.current and self._task is not None:
            found.trouble = why
            self._task.cancel()

    async def aclose(self) -> None:
        """End the scan that goes on, and wait until its port is closed."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)

    def line_at(self, port: str) -> str:
        """Name the line of the gateway that has this port; empty if none does."""
        place = place_of(SerialSettings(port, 9600, FORMATS["rtu"][0]))
        return next((each.name for each in self._operator.gateway.parts if place_of(each.plan.port) == place), "")

    def _new(self, of: str, user: str, owner: str, units: tuple[int, ...], mode: str) -> PageScan:
        if self.current is not None:
            raise WrongQuestion(f"a scan of {self.current.of} for {self.current.user} goes on: one at a time")
        now = self._now()
        self._scans = [each for each in self._scans if now - (each.ended or now) < KEPT][-(MOST_KEPT - 1) :]
        return PageScan(of, False, mode, units, user, owner, now, now)

    def _started(self, found: PageScan, steps: SpeedSteps) -> PageScan:
        self._scans.append(found)
        self._task = asyncio.create_task(self._run(found, steps), name="web scan")
        self._task.add_done_callback(lambda _: self._ended(found))
        return found

    def _ended(self, found: PageScan) -> None:
        found.ended = self._now()
        self._task = None

    async def _run(self, found: PageScan, steps: SpeedSteps) -> None:
        work = asyncio.create_task(_follow(found, steps), name="web scan steps")
        gateway = self._operator.gateway
        try:
            while not work.done():
                await asyncio.wait((work,), timeout=_STEP)
                why = "" if work.done() else self._why_end(found, gateway)
                if why:
                    found.trouble = why
                    return
            await work
        except (WrongQuestion, PortError) as error:
            found.trouble = str(error)
        except asyncio.CancelledError:
            found.trouble = found.trouble or "the gateway is stopping"
        except Exception as error:  # noqa: BLE001 - an error boundary: a defect ends only the scan
            found.trouble = "a defect in the gateway; its log says more"
            self._operator.running.emit(events.PartFailed.of("scan", error))
        finally:
            work.cancel()
            await asyncio.gather(work, return_exceptions=True)

    def _why_end(self, found: PageScan, gateway: object) -> str:
        now = self._now()
        if now - found.looked_at > LEFT:
            return "nobody looked at its page any longer"
        if now - found.began > LONGEST:
            return f"it took longer than {LONGEST / 60:.0f} minutes"
        return "" if self._operator.gateway is gateway else "the config was reloaded"

    async def _on_port(self, wanted: PortToScan) -> SpeedSteps:
        running, timing = self._operator.running, wanted.timing
        kinds = await in_thread("read profiles", known_kinds, self._operator.reloader.file)
        port, speed = SerialSettings(wanted.port, timing.baud, timing.format), Speed(timing.baud, timing.format)
        line = unused_line(port, timing, running.builder.opener)
        used: list[Line] = []

        def at_speed(speed: Speed) -> GatewayLine:
            there = line.at_speed(*speed)
            used.append(there.driver.line)
            return there

        steps = (
            scan_at(at_speed, speed, wanted.units, USUAL_LIMIT, kinds)
            if wanted.is_speed_known
            else scan_at_found_speed(at_speed, timing.mode, LIKELY, wanted.units, USUAL_LIMIT, kinds)
        )
        try:
            async with aclosing(steps):
                async for step in steps:
                    yield step
        finally:
            running.ports.take_back(line, used)

    async def _on_line(self, asked: ToScan, asker: Asker) -> SpeedSteps:
        async with aclosing(scan(self._operator, asked, asker)) as steps:
            async for step in steps:
                if step.progress is not None:
                    yield step.progress
                elif step.found is not None:
                    yield step.found


async def _follow(found: PageScan, steps: AsyncGenerator[Speed | Progress | tuple[Found, ...], None]) -> None:
    async with aclosing(steps):
        async for step in steps:
            if isinstance(step, Speed):
                found.speed = step
            elif isinstance(step, Progress):
                found.progress = step
            else:
                found.found = step
