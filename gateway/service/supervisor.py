"""Runs the parts of a gateway: start, ready, serve, drain, stop."""

import asyncio
import traceback
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from gateway import events
from gateway.ports.keeper import Keeper
from gateway.service.build import Gateway

#: How long requests that are under way may take after the order to stop, in seconds.
DRAIN_TIME = 5.0
#: How often a stopping gateway looks whether they are done, in seconds.
_DRAIN_STEP = 0.02
#: How long a line rests whose task met an error that nobody foresaw, in seconds.
_RESTART_PAUSE = 1.0


class Stop:
    """The order to end: the first one lets requests under way finish, the second one does not wait for them."""

    def __init__(self) -> None:
        self.reason = ""
        self.at_once = False
        self._asked = asyncio.Event()

    def order(self, reason: str) -> None:
        """Order an end, or a quicker one."""
        self.at_once = self._asked.is_set()
        self.reason = self.reason or reason
        self._asked.set()

    async def asked(self) -> None:
        """Wait for the order."""
        await self._asked.wait()


async def serve(gateway: Gateway, stop: Stop, emit: events.Emit) -> None:
    """Run `gateway` until `stop`. It is ready when clients can connect and every line was tried once.

    Raises:
        ListenError: an address cannot be used; no port has been opened.
    """
    try:
        for listener in gateway.listeners:
            await listener.bind()
        async with keep_lines_open(gateway, emit):
            await _open_doors(gateway, emit)
            await stop.asked()
            emit(events.Stopping(stop.reason))
            await _drain(gateway, stop)
    finally:
        for listener in gateway.listeners:
            listener.close()
    emit(events.Stopped())


@asynccontextmanager
async def keep_lines_open(gateway: Gateway, emit: events.Emit) -> AsyncIterator[None]:
    """Open the port of every line and keep it open; on entry each one was tried once. At the end all are closed."""
    keepers = gateway.keepers.items()
    tasks = [asyncio.create_task(_keep(name, keeper, emit), name=f"line:{name}") for name, keeper in keepers]
    try:
        for _, keeper in keepers:
            await keeper.tried.wait()
        yield
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        for driver in gateway.drivers:
            driver.close()


async def _open_doors(gateway: Gateway, emit: events.Emit) -> None:
    for listener in gateway.listeners:
        await listener.start()
    up = sum(keeper.error is None for keeper in gateway.keepers.values())
    emit(events.Ready(tuple(each.address for each in gateway.listeners), up, len(gateway.keepers) - up))


async def _keep(name: str, keeper: Keeper, emit: events.Emit) -> None:
    while True:
        try:
            await keeper.run()
        except Exception as error:  # noqa: BLE001 - the supervisor's border: one line's defect is not the others'
            text = "".join(traceback.format_exception(error))
            emit(events.PartFailed(f"line {name}", repr(error), text))
        await asyncio.sleep(_RESTART_PAUSE)


async def _drain(gateway: Gateway, stop: Stop) -> None:
    """Accept nobody any more and let requests under way finish, within `DRAIN_TIME`."""
    loop = asyncio.get_running_loop()
    end = loop.time() + DRAIN_TIME
    for listener in gateway.listeners:
        listener.stop_accepting()
    while loop.time() < end and not stop.at_once and not all(each.is_idle for each in gateway.listeners):
        await asyncio.sleep(_DRAIN_STEP)
