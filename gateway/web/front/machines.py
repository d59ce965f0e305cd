"""What monitoring asks: whether the gateway is alive and ready, and its metrics."""

from collections.abc import Sequence

from aiohttp import web

from gateway.clock.threads import in_thread
from gateway.observe.metrics import CONTENT_TYPE, exposition
from gateway.operator.status.metrics import read
from gateway.runtime.garbage import no_collection
from gateway.runtime.running import Running
from gateway.web.access.guard import Need
from gateway.web.front.problems import Handler
from gateway.web.front.turns import Turns


def machine_routes(running: Running) -> Sequence[tuple[str, str, Handler, Need]]:
    """List the routes: method, path, handler, and what it needs."""
    turns = Turns()

    async def healthz(_request: web.Request) -> web.Response:
        return web.Response(text="ok\n")

    async def readyz(_request: web.Request) -> web.Response:
        trouble = why_not_ready(running)
        if trouble:
            raise web.HTTPServiceUnavailable(text=trouble)
        return web.Response(text="ready\n")

    async def metrics(request: web.Request) -> web.Response:
        async with turns.turn(request):
            body = await _metrics(running)
        return web.Response(body=body, headers={"Content-Type": CONTENT_TYPE, "Cache-Control": "no-store"})

    return [
        ("GET", "/healthz", healthz, "nothing"),
        ("GET", "/readyz", readyz, "nothing"),
        ("GET", "/metrics", metrics, "metrics"),
    ]


def why_not_ready(running: Running) -> str:
    """Say why the gateway is not ready; empty while clients can connect and a line is up or an image exists."""
    if not running.ready.is_set():
        return "clients cannot connect"
    gateway = running.gateway
    reconnectors = [owner.reconnector for owner in gateway.owners if owner not in gateway.monitors]
    is_ready = gateway.images or any(reconnector.is_open for reconnector in reconnectors)
    return "" if is_ready else "no line is up, and there is no image"


async def _metrics(running: Running) -> bytes:
    """Read the counters in slices and format them in a thread, so that lines do not wait for that."""
    with no_collection():
        families = await read(running)
        return await in_thread("metrics", exposition, families)
