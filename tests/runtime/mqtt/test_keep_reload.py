"""What is kept outlives reloads, in virtual time: the file is opened once, and closed when nothing is kept any more."""

import asyncio
import threading
from contextlib import asynccontextmanager

import pytest

from gateway.plant.kept import keeper
from gateway.plant.kept.file import KeptFile
from gateway.plant.kept.keeper import FILE_NAME
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import gateway_bench

CONFIG = """
site = "plant"

[[line]]
name    = "hall"
port    = "/dev/hall"
devices = [{ unit = 1, name = "silo-1", points = [{ name = "weight", holding = 0 }] }]
"""
#: Nobody is at this address.
MQTT = """
[mqtt]
broker  = "mqtt://127.0.0.1:9"
publish = [{ device = "silo-1", every = "400 ms" }]
"""
KEEP = f'{CONFIG}{MQTT}keep = "1 MiB"\n'


class Files:
    """The files of kept values that were opened, and those that are open."""

    def __init__(self, monkeypatch) -> None:
        self.opened = 0
        self.open = 0
        opening, closing = KeptFile.open, KeptFile.close

        def opened(path, most):
            found = opening(path, most)
            self.opened += 1
            self.open += 1
            return found

        def closed(file):
            closing(file)
            self.open -= 1

        monkeypatch.setattr(KeptFile, "open", opened)
        monkeypatch.setattr(KeptFile, "close", closed)


@pytest.fixture
def files(monkeypatch):
    return Files(monkeypatch)


@asynccontextmanager
async def plant(folder, config):
    """A gateway whose broker is away, and a device whose weight counts up once a second."""
    async with gateway_bench(CONFIG) as bench:
        silo = SimulatedDevice(1, delay=0.002)
        bench.attach("hall", SimulatedLine("rtu", silo))
        publishing = bench.running.add_ons.mqtt
        publishing._folder = folder
        counting = asyncio.create_task(count(silo))
        before = tasks()
        await bench.reload(config)
        yield bench, publishing
        await publishing.stop()
        assert tasks() == before
        counting.cancel()
    assert not [thread for thread in threading.enumerate() if thread.name == "kept readings"]


async def count(silo) -> None:
    while True:
        silo.holding[0] += 1
        await asyncio.sleep(1.0)


def tasks() -> list[str]:
    """The tasks of what is published and kept."""
    return sorted(task.get_name() for task in asyncio.all_tasks() if task.get_name() in ("broker", "kept readings"))


async def test_two_reloads_in_a_row_keep_what_is_kept_and_open_the_file_once(tmp_path, files):
    async with plant(tmp_path, KEEP) as (bench, publishing):
        await asyncio.sleep(30.0)
        before = publishing.status().kept
        other = KEEP.replace("400 ms", "200 ms")
        await bench.reload(other)
        await bench.reload(KEEP)
        kept = publishing.status().kept
        assert kept.values >= before.values >= 29
        assert kept.since == before.since
        assert (files.opened, files.open) == (1, 1)
    assert files.open == 0


async def test_two_changes_of_keep_at_once_lose_nothing(tmp_path, files):
    async with plant(tmp_path, KEEP) as (bench, publishing):
        await asyncio.sleep(25.0)
        before = publishing.status().kept
        await bench.reload(KEEP.replace("1 MiB", "2 MiB"))
        await bench.reload(KEEP.replace("1 MiB", "3 MiB"))
        await asyncio.sleep(1.0)
        kept = publishing.status().kept
        assert kept.limit == 3 * 2**20
        assert kept.values >= before.values >= 24
        assert kept.since == before.since
        assert files.open == 1
        assert not [event for event in bench.events if event.name in ("state_not_kept", "values_given_up")]
    assert files.open == 0


async def test_without_mqtt_the_file_is_closed_and_its_values_are_found_again_with_it(tmp_path, files):
    async with plant(tmp_path, KEEP) as (bench, publishing):
        await asyncio.sleep(25.0)
        before = publishing.status().kept
        await bench.reload(CONFIG)
        assert publishing.status() is None
        assert (files.open, tasks()) == (0, [])
        assert (tmp_path / FILE_NAME).exists()
        await asyncio.sleep(5.0)
        await bench.reload(KEEP)
        await asyncio.sleep(0.2)
        kept = publishing.status().kept
        assert kept.values >= before.values
        assert kept.since == before.since
    assert files.open == 0


async def test_without_keep_nothing_is_said_of_it(tmp_path, files):
    async with plant(tmp_path, KEEP) as (bench, publishing):
        await asyncio.sleep(5.0)
        await bench.reload(CONFIG + MQTT)
        assert publishing.status().kept is None
        assert (files.open, tasks()) == (0, ["broker"])


async def test_a_disk_that_hangs_holds_up_a_stop_for_a_second_and_is_told(tmp_path, monkeypatch):
    async with plant(tmp_path, KEEP) as (bench, publishing):
        await asyncio.sleep(5.0)
        in_thread = keeper.in_thread

        async def slow(*call):
            await asyncio.sleep(3.0)
            return await in_thread(*call)

        monkeypatch.setattr(keeper, "in_thread", slow)
        loop = asyncio.get_running_loop()
        begin = loop.time()
        await publishing.stop()
        assert 0.9 < loop.time() - begin < 1.2
        (trouble,) = (event for event in bench.events if event.name == "state_not_kept")
        assert trouble.reason == "the disk takes too long"
        (lost,) = (event for event in bench.events if event.name == "values_given_up")
        assert lost.values >= 3
        await asyncio.sleep(10.0)
