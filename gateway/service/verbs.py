"""The verbs of the control socket."""

import asyncio
import time
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from gateway.service.bench import bench
from gateway.service.control import IsThere, Verb
from gateway.service.doctor import examine
from gateway.service.operator import ask, picture
from gateway.service.reload import Reloader
from gateway.service.running import Running
from gateway.service.status import status
from gateway.service.trace import Clock, lines, page, stories


def verbs(running: Running, reloader: Reloader) -> Mapping[str, Verb]:
    """The verbs, by name."""
    examining = asyncio.Lock()  # two that look for a device at once would be in each other's way

    async def show_status(_request: Mapping[str, Any], _is_there: IsThere) -> dict[str, Any]:
        return {"status": status(running.gateway, asyncio.get_running_loop().time(), running.recent)}

    async def reload(_request: Mapping[str, Any], _is_there: IsThere) -> dict[str, Any]:
        outcome = await asyncio.shield(reloader.order())
        return {"ok": not (outcome.problems or outcome.defect), **asdict(outcome)}

    async def request(request: Mapping[str, Any], is_there: IsThere) -> dict[str, Any]:
        return await ask(running.gateway, request, is_there)

    async def unit(request: Mapping[str, Any], _is_there: IsThere) -> dict[str, Any]:
        return {"unit": picture(running.gateway, request.get("unit"))}

    async def doctor(request: Mapping[str, Any], is_there: IsThere) -> dict[str, Any]:
        async with examining:
            return await examine(running, request, is_there)

    async def trace(request: Mapping[str, Any], _is_there: IsThere) -> dict[str, Any]:
        answer = page(running.gateway, request, _clock())
        return {**answer, "lines": lines(running.gateway)} if request.get("lines") else answer

    async def why(request: Mapping[str, Any], _is_there: IsThere) -> dict[str, Any]:
        return stories(running.gateway, request, _clock())

    async def measure(request: Mapping[str, Any], is_there: IsThere) -> dict[str, Any]:
        return {"bench": await bench(running.gateway, request, is_there)}

    return {
        "status": show_status,
        "reload": reload,
        "unit": unit,
        "request": request,
        "doctor": doctor,
        "trace": trace,
        "why": why,
        "bench": measure,
    }


def _clock() -> Clock:
    return asyncio.get_running_loop().time(), time.time()
