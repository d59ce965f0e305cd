"""`[web]`: metrics and health over HTTP. Its libraries are loaded only if configured."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from errno import EINVAL
from importlib import import_module
from pathlib import Path

from gateway import events
from gateway.config.plan import WebPlan
from gateway.ports.threads import ThreadPerCall
from gateway.service.running import Running

#: The package's extra with the libraries.
_MISSING = "{} is not installed: pip install 'mbgw[web]'"


@asynccontextmanager
async def web_pages(plan: WebPlan | None, running: Running) -> AsyncIterator[None]:
    """Serve HTTP inside the context if configured. A failure to do so is only logged."""
    async with AsyncExitStack() as stack:
        if plan is not None:
            try:
                await stack.enter_async_context(_open(plan, running))
            except ModuleNotFoundError as error:
                running.emit(events.WebClosed(str(plan.bind), _MISSING.format(error.name)))
            except OSError as error:
                running.emit(
                    events.WebClosed(str(plan.bind), f"{error.filename or ''} {error.strerror or error}".strip())
                )
        yield


@asynccontextmanager
async def _open(plan: WebPlan, running: Running) -> AsyncIterator[None]:
    server = import_module("gateway.web.server")
    settings = server.WebSettings(plan.bind.host, plan.bind.port, plan.hosts, _token(plan))
    async with server.web_open(settings, _Answers(running)) as address:
        running.emit(events.WebUp(address))
        yield


def _token(plan: WebPlan) -> str:
    """Read the required token; empty for none.

    Raises:
        OSError: the file cannot be read or is empty.
    """
    if plan.token is None:
        return ""
    token = Path(plan.token).read_text(encoding="ascii", errors="replace").strip()
    if not token:
        raise OSError(EINVAL, "the file is empty", plan.token)
    return token


class _Answers:
    """See gateway.web.server."""

    def __init__(self, running: Running) -> None:
        self._running = running
        self._read = import_module("gateway.service.metrics").read
        metrics = import_module("gateway.observe.metrics")
        self._exposition = metrics.exposition
        self.content_type: str = metrics.CONTENT_TYPE

    async def metrics(self) -> bytes:
        """Read the counters at once and format them in a thread, so that lines do not wait for that."""
        loop = asyncio.get_running_loop()
        families = self._read(self._running, loop.time())
        text: bytes = await loop.run_in_executor(ThreadPerCall("metrics"), self._exposition, families)
        return text

    def failed(self, error: Exception) -> None:
        """See gateway.web.server."""
        self._running.emit(events.PartFailed.of("web", error))

    def trouble(self) -> str:
        """Why the gateway is not ready: it is while clients can connect and a line is up or an image exists."""
        if not self._running.ready.is_set():
            return "clients cannot connect"
        gateway = self._running.gateway
        reconnectors = [
            *(line.reconnector for line in gateway.lines),
            *(upstream.reconnector for upstream in gateway.upstreams),
        ]
        return (
            ""
            if gateway.images or any(reconnector.is_open for reconnector in reconnectors)
            else "no line is up, and there is no image"
        )
