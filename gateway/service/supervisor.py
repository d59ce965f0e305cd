"""Runs the parts of a gateway: start, ready, serve, drain, stop."""

import asyncio
import traceback
from collections.abc import AsyncIterator, Coroutine
from contextlib import asynccontextmanager, suppress

from gateway import events
from gateway.errors import PortError
from gateway.listeners.serial import SerialListener
from gateway.ports.keeper import Keeper, PortOwner
from gateway.service.build import Gateway, Listener

#: How long requests that are under way, and the clients that take their responses, may take after the order to stop,
#: in seconds; and how long ports may take to close then. Together with the end of the process: less than 5 s.
DRAIN_TIME = 3.0
CLOSING_TIME = 1.5
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
        ListenError: an address cannot be used.
    """
    try:
        for listener in gateway.listeners:
            await listener.bind()
        async with _lines_open(gateway, emit):
            if await _done_before(stop, _tried(gateway)):
                _open_doors(gateway, emit)
            await stop.asked()
            emit(events.Stopping(stop.reason))
            await _drain(gateway, stop)
    finally:
        _close_doors(gateway)
    emit(events.Stopped())


@asynccontextmanager
async def keep_lines_open(gateway: Gateway, emit: events.Emit) -> AsyncIterator[None]:
    """Open the port of every line and keep it open; on entry each one was tried once. At the end all are closed."""
    async with _lines_open(gateway, emit):
        await _tried(gateway)
        yield


@asynccontextmanager
async def _lines_open(gateway: Gateway, emit: events.Emit) -> AsyncIterator[None]:
    keepers = gateway.keepers.items()
    tasks = [asyncio.create_task(_keep(name, keeper, emit), name=f"line:{name}") for name, keeper in keepers]
    for mirror in gateway.mirrors:
        mirror.start()
    try:
        yield
    finally:
        for mirror in gateway.mirrors:
            mirror.close()
        for task in tasks:
            task.cancel()
        with suppress(TimeoutError):  # then a driver hangs, and the end of the process closes its port
            async with asyncio.timeout(CLOSING_TIME):
                await asyncio.gather(*tasks, return_exceptions=True)
        for driver in gateway.drivers:
            driver.close()
        for upstream in gateway.upstreams:
            upstream.driver.close()
        for server in gateway.servers:
            server.close()


async def _tried(gateway: Gateway) -> None:
    for keeper in gateway.keepers.values():
        await keeper.tried.wait()


async def _done_before(stop: Stop, step: Coroutine[None, None, None]) -> bool:
    """Whether `step` was done before the order to stop; if not, it is given up."""
    doing, asked = asyncio.create_task(step, name="start"), asyncio.create_task(stop.asked(), name="stop")
    await asyncio.wait((doing, asked), return_when=asyncio.FIRST_COMPLETED)
    doing.cancel()
    asked.cancel()
    return doing.done() and not doing.cancelled()


def _open_doors(gateway: Gateway, emit: events.Emit) -> None:
    for listener in gateway.listeners:
        listener.start()
    up = sum(keeper.error is None for keeper in gateway.keepers.values())
    emit(events.Ready(tuple(each.address for each in gateway.listeners), up, len(gateway.keepers) - up))


def _close_doors(gateway: Gateway) -> None:
    for listener in gateway.listeners:
        listener.close()


async def _keep(name: str, keeper: Keeper, emit: events.Emit) -> None:
    while True:
        try:
            await keeper.run()
        except Exception as error:  # noqa: BLE001 - the supervisor's border: one line's defect is not the others'
            text = "".join(traceback.format_exception(error))
            emit(events.PartFailed(f"line {name}", repr(error), text))
            keeper.failed(PortError(f"a defect in the gateway: {error!r}"))
        await asyncio.sleep(_RESTART_PAUSE)


async def _drain(gateway: Gateway, stop: Stop) -> None:
    """Take no more clients and requests, let what is under way finish within `DRAIN_TIME`, and close the doors.

    What is not finished then is answered as if its line had gone: 0B when it was sent, 0A when it was not.
    """
    loop = asyncio.get_running_loop()
    end = loop.time() + DRAIN_TIME
    listeners: tuple[Listener | SerialListener, ...] = (*gateway.listeners, *gateway.servers)
    for listener in listeners:
        listener.finish()
    while loop.time() < end and not stop.at_once and any(each.has_clients for each in listeners):
        await asyncio.sleep(_DRAIN_STEP)
    owners: tuple[PortOwner, ...] = (*gateway.drivers, *(upstream.driver for upstream in gateway.upstreams))
    for owner in owners:
        owner.port_down(PortError("the gateway ends"))
    _close_doors(gateway)
