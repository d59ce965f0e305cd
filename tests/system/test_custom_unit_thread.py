"""Units made in Python that the config names, in their thread: what blocks there holds up nobody else."""

import asyncio
import random
import sys
import threading
import time
from contextlib import asynccontextmanager

import pytest

from gateway import Busy, ConfigError, CustomUnit, Gateway, NoResponse, Refused
from gateway.clock.loop_thread import MOST_THREADS, LoopThread
from gateway.events import CustomUnitsLeft
from gateway.images.drivers.custom_driver import CustomDriver
from gateway.images.image import ImageSettings
from gateway.modbus.codes import Area
from gateway.trace.ring import Ring
from images.asking import GENERIC
from kit.asker import Asker

CONFIG = """
[[listen]]
bind = "tcp://127.0.0.1:0"
"""
UNITS = """
import asyncio, threading, time
from gateway import CustomUnit

class Quick(CustomUnit):
    async def read(self, area, address, count):
        return [address] * count

class Thread(CustomUnit):
    async def read(self, area, address, count):
        return [threading.current_thread().name == "custom units"] * count

class Blocks(CustomUnit):
    async def read(self, area, address, count):
        time.sleep(address / 1000)
        return [address] * count

class InThread(CustomUnit):
    async def read(self, area, address, count):
        await asyncio.to_thread(time.sleep, address / 1000)
        return [address] * count

class Asks(CustomUnit):
    async def read(self, area, address, count):
        quick, own = self.unit(1).read_holding(address, count), self.unit("own").read_holding(address, count)
        return [a + b for a, b in zip(*await asyncio.gather(quick, own))]

class Leaves(CustomUnit):
    def __init__(self):
        self.tasks = []
    async def read(self, area, address, count):
        self.tasks.append(asyncio.get_running_loop().create_task(asyncio.sleep(3600)))
        return [0] * count

class Ends(CustomUnit):
    async def read(self, area, address, count):
        raise SystemExit
"""
NAMES = {1: "Quick", 2: "Thread", 3: "Blocks", 4: "InThread", 5: "Asks", 6: "Leaves", 7: "Ends"}
#: What some of them, and another one like the first, may take for a request; the others have time on any machine.
SHORT = "300 ms"


class Own(CustomUnit):
    """A unit of the program, in the loop of the test."""

    async def read(self, area, address, count):
        return [threading.current_thread() is threading.main_thread()] * count


@pytest.fixture
def config(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    name = f"units_{tmp_path.name}".replace("-", "_")
    (tmp_path / f"{name}.py").write_text(UNITS)
    rows = [
        row(unit, each.lower(), f"{name}:{each}", SHORT if each == "Blocks" else "10 s") for unit, each in NAMES.items()
    ]
    rows += [row(8, "neighbour", f"{name}:Quick", SHORT), row(60, "own", "own:Own", "10 s")]
    file = tmp_path / "gateway.toml"
    file.write_text(CONFIG + "\n".join(rows))
    return file


def row(unit: int, name: str, python: str, timeout: str) -> str:
    return f'[[image]]\nunit = {unit}\nname = "{name}"\npython = "{python}"\ntimeout = "{timeout}"\n'


@asynccontextmanager
async def latest():
    """How late the loop of the test was at most: the last of the list."""
    worst = [0.0]

    async def look() -> None:
        while True:
            due = time.monotonic() + 0.01
            await asyncio.sleep(0.01)
            worst.append(max(worst[-1], time.monotonic() - due))

    looking = asyncio.create_task(look())
    try:
        yield worst
    finally:
        looking.cancel()


def threads() -> list[str]:
    return [each.name for each in threading.enumerate() if each.name == "custom units"]


async def test_they_are_called_in_one_thread_and_those_of_the_program_in_its_loop(config):
    async with Gateway.from_toml(config, units={60: Own()}) as gateway:
        assert threads() == []  # before the first call
        assert await gateway.unit(2).read_holding(0) == [1]
        assert await gateway.unit("quick").read_holding(7, 2) == [7, 7]
        assert await gateway.unit(60).read_holding(0) == [1]
        assert await gateway.unit("asks").read_holding(7) == [8]
        assert threads() == ["custom units"]
    assert threads() == []


MADE = """
import threading
from gateway import CustomUnit

turned = threading.Event()

class Zeros(CustomUnit):
    async def read(self, area, address, count):
        return [0] * count

class Waits(Zeros):
    def __init__(self):
        if not turned.wait(5.0):
            raise TimeoutError("the loop of the program stood still")

class Broken(Zeros):
    def __init__(self):
        raise OSError("no sensor")
"""


@pytest.mark.parametrize("name", ["Waits", "Broken"])
async def test_they_are_made_while_the_loop_of_the_program_goes_on(name, tmp_path, monkeypatch):
    module = f"made_{name}_{tmp_path.name}".replace("-", "_")
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / f"{module}.py").write_text(MADE)
    gateway = Gateway.from_text(CONFIG + row(60, "made", f"{module}:{name}", SHORT), folder=tmp_path)
    asyncio.get_running_loop().call_later(0.05, sys.modules[module].turned.set)
    if name == "Broken":
        with pytest.raises(ConfigError, match=r"Broken cannot be made: OSError: no sensor"):
            await gateway.__aenter__()
    else:
        async with gateway:
            assert await gateway.unit(60).read_holding(0) == [0]


async def test_a_start_that_is_given_up_does_not_wait_until_they_are_made(tmp_path, monkeypatch):
    module = f"waits_{tmp_path.name}".replace("-", "_")
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / f"{module}.py").write_text(MADE)
    gateway = Gateway.from_text(CONFIG + row(60, "made", f"{module}:Waits", SHORT), folder=tmp_path)
    began = time.monotonic()
    with pytest.raises(TimeoutError):
        async with asyncio.timeout(0.1), gateway:
            pass
    assert time.monotonic() - began < 4.0
    sys.modules[module].turned.set()


async def test_one_that_blocks_holds_up_only_its_neighbours_and_these_get_their_answer_in_time(config):
    async with Gateway.from_toml(config, units={60: Own()}) as gateway, latest() as late:
        started = time.monotonic()
        blocking = asyncio.create_task(gateway.unit("blocks").read_holding(2000))
        await asyncio.sleep(0.05)
        neighbour = asyncio.create_task(gateway.unit("neighbour").read_holding(7))
        with pytest.raises(NoResponse):
            await blocking
        assert time.monotonic() - started >= 0.3
        with pytest.raises(Busy):  # nothing was done
            await neighbour
        assert await gateway.unit(60).read_holding(0) == [1]
        assert time.monotonic() - started < 1.5
        assert late[-1] < 0.5
        assert await gateway.unit("quick").read_holding(7) == [7]  # afterwards
        assert time.monotonic() - started > 1.9


async def test_one_that_waits_in_a_thread_of_its_own_holds_up_nobody(config):
    async with Gateway.from_toml(config, units={60: Own()}) as gateway:
        waiting = asyncio.create_task(gateway.unit("inthread").read_holding(200))
        await asyncio.sleep(0.02)
        assert await gateway.unit("quick").read_holding(7) == [7]
        assert await waiting == [200]


async def test_at_the_stop_one_that_blocks_is_left_behind_after_a_second(config):
    gateway = Gateway.from_toml(config, units={60: Own()})
    events = gateway.events()
    async with gateway:
        with pytest.raises(NoResponse):
            await gateway.unit("blocks").read_holding(3500)
        stopping = time.monotonic()
    assert 0.9 < time.monotonic() - stopping < 2.5
    assert CustomUnitsLeft(("blocks",)) in [event async for event in events]
    (left,) = (each for each in threading.enumerate() if each.name == "custom units")
    assert left.daemon
    await asyncio.to_thread(left.join, 5.0)  # it ends as soon as it is let
    assert not left.is_alive()


async def test_tasks_that_a_unit_has_left_end_with_the_thread(config):
    async with Gateway.from_toml(config, units={60: Own()}) as gateway:
        assert await gateway.unit("leaves").read_holding(0) == [0]
    assert threads() == []


async def test_one_that_ends_its_thread_does_not(config):
    async with Gateway.from_toml(config, units={60: Own()}) as gateway:
        for _ in range(2):
            with pytest.raises(Refused) as refused:
                await gateway.unit("ends").read_holding(0)
            assert refused.value.code == 4
        assert await gateway.unit("quick").read_holding(7) == [7]


async def test_many_requests_from_many_tasks_get_their_own_answers(config):
    async with Gateway.from_toml(config, units={60: Own()}) as gateway:
        unit = gateway.unit("quick")

        async def ask(number: int) -> None:
            for at in range(50):
                assert await unit.read_holding(100 * number + at, 2) == [100 * number + at] * 2

        await asyncio.gather(*map(ask, range(20)))


class Close(CustomUnit):
    """Answers just before its time is up, or just after, or at the same moment."""

    def __init__(self) -> None:
        self.begun: list[int] = []
        self.chance = random.Random(46)

    async def read(self, area, address, count):
        self.begun.append(address)
        pause = self.chance.uniform(0.003, 0.006)
        if address % 2:
            time.sleep(pause)  # noqa: ASYNC251 - what this is about
        else:
            await asyncio.sleep(pause)
        return [address] * count


async def test_who_is_answered_as_the_time_is_up_gets_one_answer_and_the_right_one():
    """The deadline, the end of a call in another thread, and its beginning there meet in every order."""
    loop, thread, unit, client = asyncio.get_running_loop(), LoopThread("close"), Close(), Asker()
    settings = ImageSettings(60, "close", GENERIC, {Area.HOLDING: ((0, 999),)}, python="Close", timeout=0.0045)
    driver = CustomDriver(settings, unit, loop, lambda _: None, Ring(), thread.call_soon)
    requests = []
    for number in range(150):
        driver.image.breaker.record_success()
        requests.append(client.ask(f"03 {number:04X} 0001", unit=60, now=loop.time()))
        driver.image.submit(requests[-1], loop.time())
        await asyncio.sleep(unit.chance.choice([0.0, 0.002, 0.005, 0.01]))
    await asyncio.sleep(0.1)
    driver.close()
    assert await thread.close()
    assert all(request.is_over for request in requests)
    assert len(client.answers) == len(requests)
    values = [int(answer[6:].replace(" ", ""), 16) for answer in client.answers if answer.startswith("03")]
    assert {*values} <= {*unit.begun}
    assert values == sorted(set(values))
    done = {number for number, request in enumerate(requests) if request.error is None}
    assert done == {*values}
    refused = {n for n, request in enumerate(requests) if request.error is not None and request.error.code == 6}
    assert not refused & {*unit.begun}
    assert len({answer[:5] for answer in client.answers}) > 1  # of values, 0B and 06


async def test_a_thread_that_was_never_needed_is_never_started():
    thread = LoopThread("unused")
    assert await thread.close()
    assert "unused" not in [each.name for each in threading.enumerate()]


async def test_what_hangs_in_threads_takes_no_more_than_so_many():
    thread, done, ended = LoopThread("hangs"), threading.Event(), threading.Event()
    outcomes: list[object] = []

    async def hang() -> None:
        calls = (asyncio.to_thread(done.wait, 10.0) for _ in range(MOST_THREADS + 2))
        asyncio.get_running_loop().call_later(0.3, done.set)
        outcomes.extend(await asyncio.gather(*calls, return_exceptions=True))
        outcomes.append(await asyncio.to_thread(done.wait, 10.0))
        ended.set()

    tasks = []
    thread.call_soon(lambda: tasks.append(asyncio.ensure_future(hang())))
    assert await asyncio.to_thread(ended.wait, 10.0)
    assert await thread.close()
    assert outcomes[:MOST_THREADS] + outcomes[-1:] == [True] * (MOST_THREADS + 1)
    assert [str(each) for each in outcomes[MOST_THREADS:-1]] == ["64 calls of asyncio.to_thread have not ended yet"] * 2


async def test_after_its_end_a_thread_is_called_in_vain():
    thread, called = LoopThread("short"), threading.Event()
    thread.call_soon(called.set)
    assert await asyncio.to_thread(called.wait, 5.0)
    assert await thread.close()
    assert await thread.close()
    thread.call_soon(called.clear)
    assert called.is_set()


def stop_it() -> None:
    asyncio.get_running_loop().stop()


def interrupt_it() -> None:
    raise KeyboardInterrupt


@pytest.mark.parametrize("end", [stop_it, interrupt_it, sys.exit])
async def test_code_that_ends_the_loop_of_the_thread_ends_no_call_of_others(end):
    thread, called, done = LoopThread("goes on"), threading.Event(), threading.Event()
    tasks = []

    async def other() -> None:
        await asyncio.sleep(0.1)
        done.set()

    thread.call_soon(lambda: tasks.append(asyncio.ensure_future(other())))
    thread.call_soon(end)
    thread.call_soon(called.set)
    assert await asyncio.to_thread(called.wait, 5.0)
    assert await asyncio.to_thread(done.wait, 5.0)
    assert [each.name for each in threading.enumerate()].count("goes on") == 1
    assert await thread.close()
