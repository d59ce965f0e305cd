"""Where the history of lines and units comes from, and what its file does when the disk does not do its part."""

import asyncio
import gc
import sqlite3
from contextlib import asynccontextmanager, closing
from pathlib import Path

import pytest

from gateway.operator.past import uses as uses_module
from gateway.operator.past.history import _TABLE, FILE_NAME, LOOK_EVERY, history_kept
from gateway.operator.past.uses import Look
from gateway.state.database import is_damage, open_table
from gateway.state.row_file import WRITE_EVERY, RowFile
from gateway.timing.history import STEP, History
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import gateway_bench

CONFIG = """
[[line]]
name    = "hall"
port    = "/dev/hall"
timeout = "200 ms"
devices = [{ unit = 1, name = "silo" }, { unit = 2, name = "gone" }]

[[line]]
name    = "yard"
port    = "/dev/yard"
devices = [{ unit = 3, name = "crane" }]

[[upstream]]
name = "plant"
to = "tcp://10.1.0.5"
units = [{ as = 37, unit = 1 }]
"""
NOON = 1_777_636_800.0
READ = "03 0000 0001"


class Bench:
    """A gateway with a history. `by` is added to its clock."""

    def __init__(self, home, history: History) -> None:
        self.home = home
        self.history = history
        self.by = 0.0

    def time(self) -> float:
        return NOON + asyncio.get_running_loop().time() + self.by

    def last(self, count: int = 1):
        return self.history.last(self.time(), count).slots

    def events(self, name: str):
        return [event for event in self.home.events if event.name == name]


@asynccontextmanager
async def bench_with_history(folder: Path | None, config: str = CONFIG):
    async with gateway_bench(config) as home:
        home.attach("hall", SimulatedLine("rtu", SimulatedDevice(1)))
        bench = Bench(home, History())
        running = home.running
        async with history_kept(running, folder, bench.time) as bench.history:
            bench.running = running
            yield bench


@pytest.fixture
async def bench(tmp_path):
    async with bench_with_history(tmp_path) as bench:
        yield bench


async def test_what_a_unit_did(bench):
    client = bench.home.client()
    for pdu in (READ, READ, "03 FFFF 0001"):
        await client.asks(1, pdu)
    await asyncio.sleep(LOOK_EVERY)
    (slot,) = bench.last()
    silo = slot.units["silo"]
    assert (silo.requests, silo.exceptions, silo.responses, silo.unanswered) == (3, 1, 3, 0)
    assert 0 < silo.answer < 1
    assert 0 < silo.share < 3
    assert set(slot.units) == {"silo"}


async def test_what_a_unit_did_not(bench):
    client = bench.home.client()
    for _ in range(3):
        assert await client.asks(2, READ) == "83 0B"
    await asyncio.sleep(LOOK_EVERY / 2)
    assert await client.asks(2, READ) == "83 0B"
    await asyncio.sleep(LOOK_EVERY / 2)
    gone = bench.last()[0].units["gone"]
    assert gone.requests == 4
    assert gone.timeouts >= 2
    assert gone.unanswered == 4


async def test_how_long_a_unit_rested(bench):
    client = bench.home.client()
    for _ in range(40):
        await client.asks(2, READ)
        await asyncio.sleep(2)
    resting = bench.last()[0].units["gone"].resting
    assert 0.3 * 80 < resting <= 90


async def test_how_busy_a_line_was(bench):
    client = bench.home.client()
    await client.asks(1, READ)
    await client.asks(2, READ)
    await asyncio.sleep(4 * LOOK_EVERY)
    lines = bench.last()[0].lines
    status = bench.running.gateway.lines[0].driver.line.phases(asyncio.get_running_loop().time())
    assert lines["hall"].busy == pytest.approx(status.busy)
    assert lines["hall"].busy > 0.2
    assert (lines["hall"].sent, lines["hall"].failed, lines["hall"].down) == (2, 1, 0)
    assert lines["hall"].seconds == pytest.approx(4 * LOOK_EVERY, abs=LOOK_EVERY)
    assert lines["yard"].busy_share == 0
    assert set(lines) == {"hall", "yard", "plant"}


async def test_how_long_a_port_was_down(bench):
    bench.home.lines["yard"].pull()
    await asyncio.sleep(2 * LOOK_EVERY + 1)
    assert bench.last()[0].lines["yard"].down >= LOOK_EVERY


async def test_what_a_reload_has_built_begins_at_nothing():
    look = Look()
    for _ in range(2):
        async with gateway_bench(CONFIG) as home:
            home.attach("hall", SimulatedLine("rtu", SimulatedDevice(1)))
            await home.client().asks(1, READ)
            assert (await look.take(home.gateway)).units["silo"].requests == 1
            await home.client().asks(1, READ)
            assert (await look.take(home.gateway)).units["silo"].requests == 1
            assert (await look.take(home.gateway)).units == {}


async def test_lines_do_not_wait_while_the_units_are_looked_at(monkeypatch):
    async with gateway_bench(CONFIG) as home:
        turns = []
        loop = asyncio.get_running_loop()
        loop.call_soon(turns.append, 1)
        monkeypatch.setattr(uses_module, "_SLICE", 0.0)
        await Look().take(home.gateway)
        assert turns == [1]


async def test_a_gateway_that_ends_at_once_leaves_nothing_that_never_ran(tmp_path, recwarn):
    async with bench_with_history(tmp_path):
        pass
    gc.collect()
    assert [str(each.message) for each in recwarn] == []


async def test_a_run_goes_on_where_the_one_before_has_stopped(tmp_path):
    for runs in range(1, 4):
        async with bench_with_history(tmp_path) as bench:
            await bench.home.client().asks(1, READ)
            await asyncio.sleep(LOOK_EVERY)
            assert bench.last()[0].units["silo"].requests == runs


async def test_without_a_folder_nothing_is_written(tmp_path):
    async with bench_with_history(None) as bench:
        await bench.home.client().asks(1, READ)
        await asyncio.sleep(2 * WRITE_EVERY)
        assert bench.last()[0].units["silo"].requests == 1
    assert list(tmp_path.iterdir()) == []


async def test_a_disk_is_written_to_once_a_minute(tmp_path, monkeypatch):
    written = []
    save = RowFile.save
    monkeypatch.setattr(RowFile, "save", lambda *args: written.append(args) or save(*args))
    async with bench_with_history(tmp_path):
        await asyncio.sleep(60 * WRITE_EVERY)
        assert 59 <= len(written) <= 60
        assert max(len(changes.written) for *_, changes in written) <= 2


async def test_a_clock_that_is_set_back_and_right_again(bench):
    client = bench.home.client()
    await client.asks(1, READ)
    await asyncio.sleep(LOOK_EVERY)
    bench.by = -5 * STEP
    await client.asks(1, READ)
    await asyncio.sleep(LOOK_EVERY)
    assert bench.last(3)[:2] == [None, None]
    assert bench.last()[0].units["silo"].requests == 1
    bench.by = 0
    await asyncio.sleep(LOOK_EVERY)
    assert [slot is None for slot in bench.last(6)] == [False, True, True, True, True, False]


# --- trouble ---------------------------------------------------------------------------------------


def spoilt(folder: Path, content: bytes | None = None) -> None:
    file = folder / FILE_NAME
    good = file.read_bytes()
    for path in folder.glob(FILE_NAME + "*"):
        path.unlink()
    file.write_bytes(good[: len(good) // 3] if content is None else content)


@pytest.mark.parametrize("content", [None, b"", b"no database at all\n" * 500])
async def test_a_torn_file_is_set_aside_and_a_new_one_begun(tmp_path, content):
    async with bench_with_history(tmp_path) as bench:
        await bench.home.client().asks(1, READ)
        await asyncio.sleep(WRITE_EVERY + LOOK_EVERY)
    spoilt(tmp_path, content)
    async with bench_with_history(tmp_path) as bench:
        await bench.home.client().asks(1, READ)
        await asyncio.sleep(WRITE_EVERY + LOOK_EVERY)
        (damaged,) = bench.events("state_damaged")
        assert "it is now" in damaged.damage
    async with bench_with_history(tmp_path) as bench:
        await asyncio.sleep(LOOK_EVERY)
        assert bench.last()[0].units["silo"].requests == 1
        assert bench.events("state_damaged") == []


@pytest.mark.parametrize("name", [b"bontent", b"con\xf4ent"])
async def test_a_file_in_which_the_name_of_a_column_has_changed_is_set_aside(tmp_path, name):
    async with bench_with_history(tmp_path):
        await asyncio.sleep(WRITE_EVERY + LOOK_EVERY)
    file = tmp_path / FILE_NAME
    good = file.read_bytes()
    file.write_bytes(good.replace(b"content", name))
    assert file.read_bytes() != good
    async with bench_with_history(tmp_path) as bench:
        await asyncio.sleep(LOOK_EVERY + 1)
        (damaged,) = bench.events("state_damaged")
        assert "it is now" in damaged.damage


async def test_a_value_that_has_changed_by_itself_is_not_believed(tmp_path):
    async with bench_with_history(tmp_path) as bench:
        await bench.home.client().asks(1, READ)
        await asyncio.sleep(LOOK_EVERY)
    with closing(sqlite3.connect(tmp_path / FILE_NAME)) as connection, connection:
        connection.execute("UPDATE slots SET content = replace(content, '[1,', '[7,')")
    async with bench_with_history(tmp_path) as bench:
        await asyncio.sleep(LOOK_EVERY + 1)
        assert "silo" not in bench.last()[0].units
        assert "wrong checksum" in bench.events("state_damaged")[0].damage


async def test_slots_of_another_version_are_left_out(tmp_path):
    async with bench_with_history(tmp_path):
        await asyncio.sleep(LOOK_EVERY)
    opened = open_table(tmp_path / FILE_NAME, _TABLE)
    opened.database.write([(7, '{"other": 1}')])
    opened.database.close()
    async with bench_with_history(tmp_path) as bench:
        await asyncio.sleep(2 * WRITE_EVERY)
        assert bench.events("part_failed") == bench.events("state_damaged") == []
        assert bench.history.last(7 * STEP, 1).slots == [None]


async def test_a_folder_that_cannot_be_written_is_told_once_and_tried_again(tmp_path):
    folder = tmp_path / "state"
    folder.write_text("no folder")
    async with bench_with_history(folder) as bench:
        await bench.home.client().asks(1, READ)
        await asyncio.sleep(5 * WRITE_EVERY)
        (trouble,) = bench.events("state_not_kept")
        assert str(folder / FILE_NAME) in trouble.reason
        assert "pages with a history need a folder to write in" in trouble.reason
        assert bench.last()[0].units["silo"].requests == 1
        folder.unlink()
        await asyncio.sleep(WRITE_EVERY)
        assert len(bench.events("state_kept_again")) == 1
    async with bench_with_history(folder) as bench:
        await asyncio.sleep(LOOK_EVERY)
        assert bench.last()[0].units["silo"].requests == 1


@pytest.mark.parametrize("error", [sqlite3.OperationalError("disk is full"), sqlite3.DatabaseError("malformed")])
async def test_a_disk_that_fails_is_told_once_and_nothing_is_lost(tmp_path, monkeypatch, error):
    save = RowFile.save

    def fail(_file, database, _changes):
        if is_damage(error):
            database.close()
        raise error

    async with bench_with_history(tmp_path) as bench:
        await asyncio.sleep(LOOK_EVERY)
        monkeypatch.setattr(RowFile, "save", fail)
        await bench.home.client().asks(1, READ)
        await asyncio.sleep(3 * STEP)
        assert [event.reason for event in bench.events("state_not_kept")] == [str(error)]
        monkeypatch.setattr(RowFile, "save", save)
        await asyncio.sleep(2 * WRITE_EVERY)
        assert len(bench.events("state_kept_again")) == 1
        slots = bench.last(4)
    async with bench_with_history(tmp_path) as bench:
        await asyncio.sleep(LOOK_EVERY + 1)
        assert [_requests(each) for each in bench.last(4)] == [_requests(each) for each in slots] == [1, 0, 0, 0]


async def test_a_second_gateway_has_a_history_of_its_own(tmp_path):
    async with bench_with_history(tmp_path), bench_with_history(tmp_path) as second:
        await second.home.client().asks(1, READ)
        await asyncio.sleep(WRITE_EVERY + LOOK_EVERY)
        (trouble,) = second.events("state_not_kept")
        assert "is another modbus-gateway running?" in trouble.reason
        assert second.last()[0].units["silo"].requests == 1


async def test_a_defect_ends_the_history_and_nothing_else(tmp_path, monkeypatch):
    async with bench_with_history(tmp_path) as bench:
        monkeypatch.setattr(bench.history, "add", None)
        await asyncio.sleep(2 * LOOK_EVERY)
        (failed,) = bench.events("part_failed")
        assert failed.part == "history"
        monkeypatch.undo()
        assert await bench.home.client().asks(1, READ) == "03 02 00 00"


def _requests(slot) -> int:
    return slot.units["silo"].requests if "silo" in slot.units else 0


async def test_a_defect_in_the_last_look_at_the_counters_is_told_and_the_rest_is_written(tmp_path, monkeypatch):
    async with bench_with_history(tmp_path) as bench:
        await bench.home.client().asks(1, READ)
        await asyncio.sleep(LOOK_EVERY)

        def fail(*_: object) -> None:
            raise RuntimeError("defect")

        monkeypatch.setattr(bench.history, "add", fail)
    (failed,) = bench.events("part_failed")
    assert failed.part == "history"
    async with bench_with_history(tmp_path) as again:
        await asyncio.sleep(1)
        assert again.history.last(again.time(), 1).slots
