"""What the store writes together, what it does when the disk refuses, and what it says an image holds."""

import asyncio

import pytest

from gateway.events import StateKeptAgain, StateNotKept
from gateway.images.drivers.store import INTERVAL, Store
from gateway.images.persistent import Change
from gateway.modbus.codes import Area
from images.disk import MemoryFiles


class Bench:
    """A store above a disk in memory. A batch is on that disk at the next turn of the loop."""

    def __init__(self, folder, files: MemoryFiles) -> None:
        self.files = files
        self.events = []
        self.store = Store(folder, self.events.append)
        self.store.open()
        #: What became of each change, in the order in which that was told.
        self.told: list[tuple[int, bool]] = []

    def at_once(self, address: int, value: int, image: str = "shift") -> None:
        self.store.keep_at_once(Change(image, Area.HOLDING, address, (value,)), self._done(value))

    def soon(self, address: int, value: int, image: str = "shift") -> None:
        self.store.keep_soon(Change(image, Area.HOLDING, address, (value,)), lambda is_kept: None)

    def present(self, image: str = "shift") -> dict[int, int]:
        return dict(self.store.values(image)[Area.HOLDING])

    def on_disk(self, image: str = "shift") -> dict[int, int]:
        return self.files.kept.get((image, Area.HOLDING), {})

    def _done(self, value: int):
        return lambda is_kept: self.told.append((value, is_kept))


@pytest.fixture
def files(monkeypatch):
    files = MemoryFiles()
    monkeypatch.setattr("gateway.images.drivers.store.open_saved", files.open)
    return files


@pytest.fixture
def bench(tmp_path, files):
    return Bench(tmp_path, files)


async def written() -> None:
    """Let the batch that is being written, and one behind it, reach the disk."""
    await asyncio.sleep(INTERVAL / 10)


async def test_what_comes_while_a_batch_is_written_is_one_batch(bench):
    for value in range(1, 5):
        bench.at_once(value, value)
    assert bench.told == []
    await written()
    assert bench.files.batches == [{("shift", Area.HOLDING): each} for each in ({1: 1}, {2: 2, 3: 3, 4: 4})]
    assert bench.told == [(1, True), (2, True), (3, True), (4, True)]


async def test_an_interval_is_one_batch(bench):
    for value in range(100):
        bench.soon(value % 10, value)
    await asyncio.sleep(0.9 * INTERVAL)
    assert bench.files.batches == []
    await asyncio.sleep(0.2 * INTERVAL)
    assert bench.on_disk() == {address: 90 + address for address in range(10)}
    await asyncio.sleep(5 * INTERVAL)
    assert len(bench.files.batches) == 1


async def test_a_later_write_stays_the_later_one(bench):
    bench.soon(0, 1)
    bench.at_once(0, 2)
    await written()
    assert (bench.told, bench.on_disk()) == ([(2, True)], {0: 2})
    await asyncio.sleep(2 * INTERVAL)
    assert bench.on_disk() == {0: 2}


async def test_a_later_write_of_an_interval_does_too(bench):
    bench.at_once(1, 1)
    bench.at_once(0, 1)
    bench.soon(0, 2)
    await asyncio.sleep(2 * INTERVAL)
    assert bench.on_disk() == {0: 2, 1: 1}


async def test_a_batch_that_fails_takes_all_that_came_since_with_it(bench):
    bench.at_once(0, 1)
    await written()
    bench.files.is_full = True
    bench.at_once(0, 2)
    bench.at_once(0, 3)
    assert bench.present() == {0: 3}
    await written()
    assert bench.told == [(1, True), (2, False), (3, False)]
    assert (bench.present(), bench.on_disk(), len(bench.files.batches)) == ({0: 1}, {0: 1}, 2)


async def test_what_comes_while_a_failure_is_told_fails_too(bench):
    bench.files.is_full = True
    bench.store.keep_at_once(Change("shift", Area.HOLDING, 0, (1,)), lambda is_kept: bench.at_once(1, 2))
    bench.at_once(2, 3)
    await written()
    assert bench.told == [(3, False), (2, False)]
    assert (bench.present(), len(bench.files.batches)) == ({}, 1)
    bench.files.is_full = False
    bench.at_once(2, 4)
    await written()
    assert (bench.told[2:], bench.on_disk()) == ([(4, True)], {2: 4})


async def test_a_defect_in_one_image_does_not_end_the_keeping_of_others(bench):
    def defect(is_kept):
        raise ZeroDivisionError

    defects = []
    asyncio.get_running_loop().set_exception_handler(lambda loop, context: defects.append(context["exception"]))
    bench.files.is_full = True
    bench.store.keep_at_once(Change("shift", Area.HOLDING, 0, (1,)), defect)
    await written()
    bench.files.is_full = False
    bench.at_once(0, 2)
    await written()
    assert ([type(each) for each in defects], bench.told) == ([ZeroDivisionError], [(2, True)])


async def test_what_was_acknowledged_is_tried_until_the_disk_takes_it(bench):
    bench.files.is_full = True
    bench.soon(0, 1)
    await asyncio.sleep(4.5 * INTERVAL)
    assert (bench.present(), bench.on_disk()) == ({0: 1}, {})
    bench.files.is_full = False
    await asyncio.sleep(INTERVAL)
    assert bench.on_disk() == {0: 1}
    assert [type(event) for event in bench.events] == [StateNotKept, StateKeptAgain]


async def test_while_the_disk_fails_nothing_more_is_acknowledged_before_it_is_kept(bench):
    told = []
    bench.files.is_full = True
    bench.soon(0, 1)
    await asyncio.sleep(1.5 * INTERVAL)
    bench.store.keep_soon(Change("shift", Area.HOLDING, 1, (2,)), told.append)
    assert told == []
    await written()
    assert (told, bench.present()) == ([False], {0: 1})
    bench.files.is_full = False
    bench.store.keep_soon(Change("shift", Area.HOLDING, 1, (3,)), told.append)
    await written()
    assert (told, bench.on_disk()) == ([False, True], {0: 1, 1: 3})
    bench.store.keep_soon(Change("shift", Area.HOLDING, 1, (4,)), told.append)
    assert told == [False, True, True], "as before"


async def test_a_write_that_fails_does_not_take_an_acknowledged_one_with_it(bench):
    bench.soon(0, 1)
    bench.files.is_full = True
    bench.at_once(0, 2)
    bench.at_once(0, 3)
    await written()
    assert (bench.told, bench.present()) == ([(2, False), (3, False)], {0: 1})
    bench.files.is_full = False
    await asyncio.sleep(2 * INTERVAL)
    assert bench.on_disk() == {0: 1}


async def test_values_are_those_of_the_disk_and_those_on_their_way(bench, tmp_path, files):
    bench.at_once(0, 1)
    bench.at_once(2, 1, image="other")
    await written()
    bench = Bench(tmp_path, files)
    assert bench.present() == {0: 1}
    bench.at_once(0, 2)
    bench.at_once(1, 3)
    bench.soon(3, 4)
    assert bench.present() == {0: 2, 1: 3, 3: 4}
    assert bench.present("other") == {2: 1}
    await asyncio.sleep(2 * INTERVAL)
    assert bench.present() == bench.on_disk() == {0: 2, 1: 3, 3: 4}


@pytest.mark.parametrize("is_full", [True, False])
async def test_whoever_goes_on_with_values_is_told_whether_they_could_be_kept(bench, is_full):
    told = []
    bench.store.when_kept(told.append)
    assert told == [True]
    bench.files.is_full = is_full
    bench.at_once(0, 1)
    bench.store.when_kept(told.append)
    assert told == [True]
    await written()
    bench.at_once(0, 2)
    await written()
    assert told == [True, not is_full]


async def test_a_stop_writes_what_is_not_kept_yet_and_the_later_value_last(bench):
    bench.at_once(0, 1)
    bench.soon(0, 2)
    bench.soon(1, 3)
    bench.store.close()
    assert bench.on_disk() == {0: 2, 1: 3}
