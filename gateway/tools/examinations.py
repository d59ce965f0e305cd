"""The findings of `doctor` for the web page: from the counters at any time, and after reads on a user's order.

Reads may disturb a line, so there is one such examination at a time, and a pause after it.
"""

import asyncio
import os
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

from gateway import events
from gateway.clock.threads import in_thread
from gateway.diagnosis.evidence import PortInUse
from gateway.diagnosis.finding import Finding
from gateway.diagnosis.ports import about_ports, with_ports
from gateway.runtime.running import Running
from gateway.tools.doctor import examined
from gateway.tools.outside import look_at

#: How long a report from the counters is kept, the limit of an examination with reads, and the pause after it, in
#: seconds.
KEPT: Final = 10.0
LONGEST: Final = 120.0
PAUSE: Final = 60.0


@dataclass(frozen=True, slots=True)
class Report:
    """Findings by line, with an empty name for all else; made `at` this Unix time, `by` order of this user, if any."""

    at: float
    groups: tuple[tuple[str, tuple[Finding, ...]], ...]
    by: str = ""
    took: float = 0.0


class Examinations:
    """The examinations of a running gateway. `last` is the last report with reads."""

    def __init__(self, running: Running, clock: Callable[[], float] = time.time) -> None:
        self.last: Report | None = None
        self._running = running
        self._clock = clock
        self._measured: Report | None = None
        self._measured_at = 0.0
        self._ended_at: float | None = None
        self._one_at_a_time = asyncio.Lock()
        self._task: asyncio.Task[None] | None = None

    @property
    def is_running(self) -> bool:
        """Whether devices are being asked."""
        return self._task is not None

    async def measured(self) -> Report:
        """Report without reading anything; the report may be up to KEPT seconds old."""
        async with self._one_at_a_time:
            now = asyncio.get_running_loop().time()
            if self._measured is None or now - self._measured_at >= KEPT:
                self._measured = await self._report("", asks=False)
                self._measured_at = now
            return self._measured

    def start(self, user: str) -> str:
        """Start an examination with reads for `user`. Return an empty string, or why that is not possible now."""
        now = asyncio.get_running_loop().time()
        if self._task is not None or self._running.examining.locked():
            return "an examination is in progress"
        if self._ended_at is not None and now - self._ended_at < PAUSE:
            return f"the last examination has just ended: try again in {PAUSE - (now - self._ended_at):.0f} s"
        self._task = asyncio.create_task(self._ask(user), name="web doctor")
        return ""

    async def aclose(self) -> None:
        """End what is in progress."""
        if self._task is not None:
            self._task.cancel()
            with suppress(asyncio.CancelledError):
                await self._task

    async def _ask(self, user: str) -> None:
        try:
            async with asyncio.timeout(LONGEST), self._running.examining:
                self.last = await self._report(user, asks=True)
        except TimeoutError:
            found = Finding("note", "doctor", f"the examination took longer than {LONGEST:.0f} s, and was ended")
            self.last = Report(self._clock(), (("", (found,)),), user, LONGEST)
        except Exception as error:  # noqa: BLE001 - an error boundary: a defect ends only the examination
            self._running.emit(events.PartFailed.of("doctor", error))
        finally:
            self._ended_at = asyncio.get_running_loop().time()
            self._task = None

    async def _report(self, user: str, *, asks: bool) -> Report:
        loop = asyncio.get_running_loop()
        began = loop.time()
        groups, ports = await examined(self._running, None, lambda: True, asks=asks)
        of_ports = await in_thread("web doctor", _about, ports)
        findings = tuple(
            (name, tuple(with_ports([each for line, each in of_ports if line == name], found)))
            for name, found in groups
        )
        return Report(self._clock(), findings, user, loop.time() - began)


def _about(ports: Sequence[PortInUse]) -> list[tuple[str, Finding]]:
    return [(port.line, found) for port in ports for found in about_ports(look_at(port, os.getpid()))]
