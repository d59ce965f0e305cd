"""The life of a gateway: start, ready, serve, drain, stop."""

import asyncio
from collections.abc import AsyncIterator, Coroutine, Iterable
from contextlib import AbstractAsyncContextManager, AsyncExitStack, asynccontextmanager
from functools import partial

from gateway import events
from gateway.clock.beside import Work, beside, end
from gateway.readconfig import expiry
from gateway.runtime.add_on import AddOn
from gateway.runtime.reload import Reloader
from gateway.runtime.running import Running
from gateway.runtime.summary import summary
from gateway.runtime.tightness import TightLimits
from gateway.service.systemd import Notifier
from gateway.service.watchdog import watch
from gateway.tools.site_inventory import keep_telling


class Stop:
    """The order to stop: requests in progress are finished first; a second order ends them."""

    def __init__(self) -> None:
        self.reason = ""
        self.at_once = False
        self._asked = asyncio.Event()

    def order(self, reason: str) -> None:
        """Order a stop; the second time, an immediate one."""
        self.at_once = self._asked.is_set()
        self.reason = self.reason or reason
        self._asked.set()

    async def wait(self) -> None:
        """Wait for the order."""
        await self._asked.wait()


async def serve(
    running: Running,
    stop: Stop,
    systemd: Notifier | None = None,
    reloader: Reloader | None = None,
    pages: AbstractAsyncContextManager[None] | None = None,
    *,
    control: str = "",
) -> None:
    """Run a gateway until `stop`. It is ready when clients can connect; lines that were not tried yet may delay that.

    `pages` are entered after the addresses of all listeners are bound. `control` is the path of the control socket, for
    the log. The order to stop ends a reload of `reloader`.

    Raises:
        ListenError: an address cannot be used.
    """
    systemd = systemd or Notifier({})
    async with AsyncExitStack() as opened:
        try:
            is_bound = await _complete_before(stop, running.bind())
            if is_bound and pages is not None:
                await opened.enter_async_context(pages)
            await running.connect_add_ons()
            async with running.lines_open():
                try:
                    if is_bound and await _complete_before(stop, running.tried()):
                        running.start_listening()
                        await _serve_until(stop, running, systemd, reloader, control)
                finally:
                    if reloader is not None:
                        await reloader.close()
                running.emit(events.Stopping(stop.reason))
                systemd.stopping()
                async with _leaving(running.add_ons):
                    await running.drain(lambda: stop.at_once)
                running.stop_listening()
        finally:
            running.stop_listening()
            async with AsyncExitStack() as stops:  # each stops, whatever happens to another
                for each in reversed(running.add_ons):
                    stops.push_async_callback(each.stop)
        running.emit(events.Stopped())


async def _serve_until(
    stop: Stop, running: Running, systemd: Notifier, reloader: Reloader | None, control: str
) -> None:
    parts = running.gateway.parts
    up = sum(part.reconnector.is_open for part in parts)
    listeners = tuple(each.address for each in running.gateway.listeners)
    running.emit(events.Ready(listeners, up, len(parts) - up, running.page, control))
    systemd.ready(summary(running.gateway))
    running.ready.set()
    works: dict[str, Work] = {
        "watchdog": partial(watch, running, systemd),
        "recent": partial(running.recent.keep_sampling, lambda: running.gateway),
        "limits": partial(TightLimits().keep_looking, lambda: running.gateway, running.emit),
        "certificates": partial(expiry.keep_looking, lambda: running.contexts, running.emit),
    }
    if reloader is not None:
        works["keep config"] = reloader.keep_in_use
        works["site inventory"] = partial(keep_telling, running, reloader)
    if running.troubles is not None:
        works["state folder"] = running.troubles.keep_looking
    try:
        await running.start_add_ons()
        async with beside(works, running.emit):
            await stop.wait()
    finally:
        running.ready.clear()


@asynccontextmanager
async def _leaving(add_ons: Iterable[AddOn]) -> AsyncIterator[None]:
    """Let add-ons leave, beside what is done in the context.

    Without any the event loop gets no turn here: that would let lines open that were not tried yet.
    """
    async with asyncio.TaskGroup() as group:
        for each in add_ons:
            if each.status() is not None:
                group.create_task(each.leave(), name=f"{each.key}: leave")
        yield


async def _complete_before(stop: Stop, step: Coroutine[None, None, None]) -> bool:
    """Run `step`, which the order to stop cancels; tell whether it finished. Raises what `step` raises."""
    doing, asked = asyncio.create_task(step, name="start"), asyncio.create_task(stop.wait(), name="stop")
    try:
        await asyncio.wait((doing, asked), return_when=asyncio.FIRST_COMPLETED)
        if doing.done():
            doing.result()
        return doing.done()
    finally:
        await end(doing, asked)
