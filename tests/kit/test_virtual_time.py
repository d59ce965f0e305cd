import asyncio
import os
import socket

import pytest

from kit.virtual_time import DescriptorRefused, VirtualTimeLoop, WaitsForEver


async def test_a_day_passes_at_once():
    await asyncio.sleep(24 * 3600)
    assert asyncio.get_running_loop().time() == 24 * 3600


async def test_the_clock_stands_at_zero_until_something_waits():
    for _ in range(100):
        await asyncio.sleep(0)
    assert asyncio.get_running_loop().time() == 0


async def test_a_timer_runs_at_exactly_its_time():
    loop, ran = asyncio.get_running_loop(), []
    for when in (0.3, 0.1, 0.1 + 1e-8, 0.2):
        loop.call_at(when, lambda: ran.append(loop.time()))
    await asyncio.sleep(1)
    assert ran == [0.1, 0.1 + 1e-8, 0.2, 0.3]


async def test_a_cancelled_timer_does_not_move_the_clock():
    loop = asyncio.get_running_loop()
    loop.call_later(1, lambda: None).cancel()
    await asyncio.sleep(0.5)
    assert loop.time() == 0.5


async def test_a_timer_in_the_past_does_not_turn_the_clock_back():
    loop = asyncio.get_running_loop()
    await asyncio.sleep(5)
    loop.call_at(1, lambda: None)
    await asyncio.sleep(0)
    assert loop.time() == 5


async def test_an_executor_job_runs_inline():
    loop = asyncio.get_running_loop()
    future = loop.run_in_executor(None, os.getpid)
    assert future.done()
    assert await future == os.getpid()
    assert await asyncio.to_thread(str, 7) == "7"


async def test_an_executor_job_raises_where_it_is_awaited():
    future = asyncio.get_running_loop().run_in_executor(None, int, "seven")
    with pytest.raises(ValueError, match="seven"):
        await future


async def test_descriptors_are_refused():
    reader, writer = socket.socketpair()
    with reader, writer, pytest.raises(DescriptorRefused, match="tests/system"):
        asyncio.get_running_loop().add_reader(reader, lambda: None)


def test_a_test_that_nothing_can_wake_fails_and_names_what_waits():
    with (
        pytest.raises(WaitsForEver, match=r"at 2\.0 s(.|\n)*wait_in_vain"),
        asyncio.Runner(loop_factory=VirtualTimeLoop) as runner,
    ):
        runner.run(wait_in_vain())


async def wait_in_vain() -> None:
    await asyncio.sleep(2)
    await asyncio.get_running_loop().create_future()
