"""What the daemon does for those who ask at its control socket."""

import asyncio
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from gateway.service.control import Verb
from gateway.service.reload import Reloader
from gateway.service.running import Running
from gateway.service.status import status


def verbs(running: Running, reloader: Reloader) -> Mapping[str, Verb]:
    """The verbs, by name."""

    async def show_status(_request: Mapping[str, Any]) -> dict[str, Any]:
        return {"status": status(running.gateway, running.recent, asyncio.get_running_loop().time())}

    async def reload(_request: Mapping[str, Any]) -> dict[str, Any]:
        outcome = await asyncio.shield(reloader.order())
        return {"ok": not (outcome.problems or outcome.defect), **asdict(outcome)}

    return {"status": show_status, "reload": reload}
