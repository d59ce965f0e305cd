"""A gateway in the event loop of one thread, and a program that asks it in those of others."""

import asyncio
import threading
from collections.abc import Callable, Coroutine, Iterator
from functools import partial
from typing import Any

import pytest

from gateway import Gateway, RequestError, UnitClient, events
from kit.slow_device import SlowDevice

PATIENCE = 10.0
CONFIG = """
[[listen]]
bind = "tcp://127.0.0.1:0"

[[image]]
unit = 5
name = "shift"
holding = 100

[[line]]
name = "hall"
port = "rtu+tcp://127.0.0.1:{port}"
gap = "0"
devices = [{{ unit = 1, as = 41, name = "silo", timeout = "5 s", points = [
  {{ name = "weight", holding = 0, write = true }}] }}]
"""


class InThread:
    """A gateway that runs in a loop of its own, in a thread."""

    def __init__(self, device: SlowDevice) -> None:
        self.gateway = Gateway.from_text(CONFIG.format(port=device.port))
        self._ready, self._loop = threading.Event(), asyncio.new_event_loop()
        self._stop = asyncio.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()
        assert self._ready.wait(PATIENCE)

    def end(self) -> None:
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._stop.set)
            self._thread.join(PATIENCE)
        assert not self._thread.is_alive()

    def _run(self) -> None:
        async def serve() -> None:
            async with self.gateway:
                self._ready.set()
                await self._stop.wait()

        try:
            self._loop.run_until_complete(serve())
        finally:
            self._loop.close()


@pytest.fixture
def device() -> Iterator[SlowDevice]:
    with SlowDevice(0.5) as device:
        yield device


@pytest.fixture
def other(device: SlowDevice) -> Iterator[InThread]:
    other = InThread(device)
    try:
        yield other
    finally:
        other.end()


def run(work: Callable[[], Coroutine[Any, Any, None]]) -> None:
    asyncio.run(asyncio.wait_for(work(), PATIENCE))


def test_units_are_asked_in_the_loops_of_other_threads(other: InThread) -> None:
    async def ask(number: int) -> None:
        shift = other.gateway.unit("shift")
        for value in range(20):
            await shift.write_holding(number, [value])
            assert await shift.read_holding(number) == [value]

    def in_thread(number: int) -> None:
        run(lambda: ask(number))

    async def ask_all() -> None:
        await asyncio.gather(*(asyncio.to_thread(in_thread, number) for number in range(4)))

    run(ask_all)


def test_a_wait_that_is_cancelled_in_one_loop_ends_in_the_other(other: InThread, device: SlowDevice) -> None:
    async def ask() -> None:
        silo: UnitClient = other.gateway.unit("silo")
        sent = asyncio.create_task(silo.read_holding(0))
        await asyncio.sleep(0.1)
        waiting = asyncio.create_task(silo.write("weight", 7))
        await asyncio.sleep(0.1)
        waiting.cancel()
        with pytest.raises(asyncio.CancelledError):
            await waiting
        assert await sent == [0]
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.2):
                await silo.read_holding(1)
        await silo.read_holding(2)

    run(ask)
    assert [frame.pdu[0] for frame in device.heard] == [3, 3, 3]  # the write was not sent


def test_a_gateway_that_has_stopped_is_told_at_once_and_while_it_is_waited_for(
    other: InThread, device: SlowDevice
) -> None:
    async def ask() -> None:
        silo = other.gateway.unit("silo")
        waiting = [asyncio.create_task(silo.read_holding(at)) for at in range(20)]
        stream = other.gateway.events()
        await asyncio.sleep(0.1)
        await asyncio.to_thread(other.end)
        for outcome in await asyncio.gather(*waiting, return_exceptions=True):
            assert isinstance(outcome, Exception | list), outcome
        with pytest.raises(RuntimeError, match="the gateway"):
            await silo.read_holding(0)
        with pytest.raises(RuntimeError, match="the gateway"):
            other.gateway.unit("silo")
        assert isinstance([event async for event in stream][-1], events.Stopped)

    run(ask)


def test_a_loop_that_ends_without_the_end_of_the_gateway_is_told_too(device: SlowDevice) -> None:
    gateway, ready = Gateway.from_text(CONFIG.format(port=device.port)), threading.Event()
    end: list[Callable[[], object]] = []

    async def serve() -> None:
        async with gateway:
            ready.set()
            await asyncio.Event().wait()

    async def leave_it() -> None:
        serving, over = asyncio.create_task(serve()), asyncio.Event()
        end.append(partial(asyncio.get_running_loop().call_soon_threadsafe, over.set))
        await over.wait()
        assert not serving.done()  # it is cancelled at the end of the loop, as all other tasks are

    thread = threading.Thread(target=asyncio.run, args=(leave_it(),))
    thread.start()
    assert ready.wait(PATIENCE)

    async def ask() -> None:
        silo = gateway.unit("silo")
        waiting = [asyncio.create_task(silo.read("weight")) for _ in range(3)]
        await asyncio.sleep(0.1)
        end[0]()
        await asyncio.to_thread(thread.join, PATIENCE)
        for outcome in await asyncio.gather(*waiting, return_exceptions=True):
            assert isinstance(outcome, RuntimeError | RequestError), outcome
        with pytest.raises(RuntimeError, match="the gateway"):
            await silo.read("weight")

    run(ask)
    assert not thread.is_alive()


def test_events_are_followed_in_another_loop(other: InThread) -> None:
    async def ask() -> None:
        shift, stream = other.gateway.unit("shift"), other.gateway.events()
        for value in range(50):
            await shift.write_holding(0, [value])
            event = await anext(stream)
            assert isinstance(event, events.WriteAudit)
            assert (event.client, event.result) == ("embedded", "ok")

    run(ask)


def test_what_is_given_up_before_the_gateway_comes_to_it_is_never_sent(device: SlowDevice) -> None:
    device.delay = 0.0

    def give_up() -> None:
        async def write() -> None:
            with pytest.raises(TimeoutError):
                async with asyncio.timeout(0.1):
                    await silo.write_holding(0, [99])

        run(write)

    async def block() -> None:
        async with gateway:
            nonlocal silo
            silo = gateway.unit("silo")
            assert await silo.read_holding(0) == [0]
            thread = threading.Thread(target=give_up)
            thread.start()
            thread.join(PATIENCE)  # and the loop of the gateway stands still
            await asyncio.sleep(0.2)
            assert await silo.read_holding(1) == [0]

    gateway = Gateway.from_text(CONFIG.format(port=device.port))
    silo: UnitClient
    run(block)
    assert [frame.pdu[0] for frame in device.heard] == [3, 3]
