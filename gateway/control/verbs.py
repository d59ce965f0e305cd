"""The verbs of the control socket."""

import asyncio
from collections.abc import AsyncGenerator, Mapping
from contextlib import aclosing
from dataclasses import asdict
from typing import Any, Final

from gateway.control.server import Verbs
from gateway.errors import FleetError, WrongQuestion
from gateway.operator.calibration import measured
from gateway.operator.forgetting import forget
from gateway.operator.status import status_in_slices
from gateway.operator.trace import clocks, lines, page, stories
from gateway.operator.units import IsThere, ask, picture
from gateway.runtime.reload import Reloader
from gateway.runtime.running import Running
from gateway.tools.bench import bench_in_steps
from gateway.tools.doctor import examine
from gateway.tools.scans import scan

#: How long an examination waits for another one to end, in seconds.
_TURN: Final = 60.0


def verbs(running: Running, reloader: Reloader) -> Verbs:
    """The verbs, by name."""
    each = _Verbs(running, reloader)
    return {
        "status": each.status,
        "fleet": each.fleet,
        "reload": each.reload,
        "unit": each.unit,
        "request": each.request,
        "forget": each.forget,
        "doctor": each.doctor,
        "trace": each.trace,
        "why": each.why,
        "which": each.which,
        "bench": each.bench,
        "times": each.times,
        "scan": each.scan,
    }


class _Verbs:
    """What each verb of a running gateway answers."""

    def __init__(self, running: Running, reloader: Reloader) -> None:
        self._running = running
        self._reloader = reloader

    async def status(self, _request: Mapping[str, Any], _is_there: IsThere) -> dict[str, Any]:
        running = self._running
        return {"status": await status_in_slices(running)}

    async def which(self, _request: Mapping[str, Any], _is_there: IsThere) -> dict[str, Any]:
        return {"config": str(self._reloader.file.absolute())}

    async def fleet(self, _request: Mapping[str, Any], _is_there: IsThere) -> dict[str, Any]:
        try:
            sites = await self._running.gateway.fleet.sites()
        except FleetError as error:
            raise WrongQuestion(f"the other sites are not known: {error}") from error
        return {"sites": [asdict(each) for each in sites]}

    async def reload(self, _request: Mapping[str, Any], _is_there: IsThere) -> dict[str, Any]:
        outcome = await asyncio.shield(self._reloader.order())
        done = not (outcome.problems or outcome.defect)
        return {"ok": done, "file": str(self._reloader.file.absolute()), **asdict(outcome)}

    async def request(self, request: Mapping[str, Any], is_there: IsThere) -> dict[str, Any]:
        await self._running.settled()
        return await ask(self._running.gateway, request, is_there)

    async def unit(self, request: Mapping[str, Any], _is_there: IsThere) -> dict[str, Any]:
        return {"unit": picture(self._running.gateway, request.get("unit"))}

    async def forget(self, request: Mapping[str, Any], _is_there: IsThere) -> dict[str, Any]:
        running = self._running
        forgotten = forget(running.gateway, request.get("device"), running.emit)
        return {"forgotten": forgotten}

    async def doctor(self, request: Mapping[str, Any], is_there: IsThere) -> dict[str, Any]:
        await self._running.settled()
        try:
            async with asyncio.timeout(_TURN):
                await self._running.examining.acquire()
        except TimeoutError:
            raise WrongQuestion(f"another examination has not ended within {_TURN:.0f} s: try again later") from None
        try:
            return await examine(self._running, request, is_there)
        finally:
            self._running.examining.release()

    async def trace(self, request: Mapping[str, Any], _is_there: IsThere) -> dict[str, Any]:
        answer = page(self._running.gateway, request, clocks())
        return {**answer, "lines": lines(self._running.gateway)} if request.get("lines") else answer

    async def why(self, request: Mapping[str, Any], _is_there: IsThere) -> dict[str, Any]:
        return stories(self._running.gateway, request, clocks())

    async def bench(self, request: Mapping[str, Any], is_there: IsThere) -> AsyncGenerator[dict[str, Any], None]:
        await self._running.settled()
        async with aclosing(bench_in_steps(self._running, request, is_there)) as steps:
            async for step in steps:
                yield step

    async def times(self, request: Mapping[str, Any], _is_there: IsThere) -> dict[str, Any]:
        return {"times": measured(self._running.gateway, request.get("unit"))}

    async def scan(self, request: Mapping[str, Any], _is_there: IsThere) -> AsyncGenerator[dict[str, Any], None]:
        await self._running.settled()
        async with aclosing(scan(self._running, request)) as steps:
            async for step in steps:
                yield step
