"""The last events over a restart: what the file has, and what is told when it cannot be written. In virtual time."""

import asyncio
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from gateway import events
from gateway.observe import event_file
from gateway.observe.event_file import FILE_NAME, events_kept
from gateway.observe.fan_out import FanOut
from gateway.observe.last_events import COUNTS_EVERY, MOST_ALIKE, LastEvents
from gateway.state.database import open_table
from gateway.state.row_file import WRITE_EVERY, RowFile

NOON = 1_777_636_800.0
LOST = events.LineLost("hall", "/dev/hall", "unplugged")


@asynccontextmanager
async def run(folder: Path):
    """A run of a gateway that begins with `config_loaded`."""
    loop = asyncio.get_running_loop()
    fan_out = FanOut(lambda _: None, LastEvents(lambda: NOON + loop.time()))
    fan_out.emit(events.ConfigLoaded("gateway.toml", 1, 1))
    async with events_kept(fan_out.last, folder, fan_out.emit):
        yield fan_out


def names(fan_out: FanOut) -> list[str]:
    return [each.name for each in fan_out.last.all()]


@pytest.fixture
def written(monkeypatch):
    """The numbers of events in each write."""
    found, save = [], RowFile.save

    def saved(file, database, changes):
        found.append(len(changes.written))
        save(file, database, changes)

    monkeypatch.setattr(RowFile, "save", saved)
    return found


async def test_a_run_knows_the_events_of_the_one_before(tmp_path):
    async with run(tmp_path) as first:
        await asyncio.sleep(1)
        first.emit(LOST)
        first.emit(events.Stopped())
    async with run(tmp_path) as second:
        await asyncio.sleep(1)
        assert names(second) == ["config_loaded", "line_lost", "stopped", "config_loaded"]
        assert [each.number for each in second.last.all()] == [1, 2, 3, 4]
        assert second.last.began("line hall") is not None


async def test_what_was_told_a_minute_before_the_end_is_there_also_after_a_crash(tmp_path, monkeypatch):
    async with run(tmp_path) as first:
        await asyncio.sleep(1)
        first.emit(LOST)
        await asyncio.sleep(WRITE_EVERY)
        first.emit(events.WebUp("http://x"))
        monkeypatch.setattr(first.last, "changes", LastEvents().changes)  # nothing more is written
    monkeypatch.undo()
    async with run(tmp_path) as second:
        await asyncio.sleep(1)
        assert names(second) == ["config_loaded", "line_lost", "config_loaded"]


async def test_where_nothing_happens_nothing_is_written(tmp_path, written):
    async with run(tmp_path):
        await asyncio.sleep(24 * 3600)
        assert written == [1]


async def test_what_happens_all_the_time_is_written_every_ten_minutes(tmp_path, written):
    async with run(tmp_path) as gateway:
        for _ in range(3 * 3600):
            gateway.emit(LOST)
            await asyncio.sleep(1)
        assert len(written) <= 3 * 3600 / COUNTS_EVERY + 5
        assert max(written) <= MOST_ALIKE + 1


async def test_the_counts_of_the_last_minutes_are_written_at_the_end(tmp_path):
    async with run(tmp_path) as first:
        await asyncio.sleep(1)
        for _ in range(20):
            first.emit(LOST)
            await asyncio.sleep(WRITE_EVERY / 2)
    async with run(tmp_path) as second:
        await asyncio.sleep(1)
        assert sum(each.times for each in second.last.all() if each.name == "line_lost") == 20


async def test_a_folder_that_cannot_be_written_costs_nothing_but_the_file(tmp_path):
    folder = tmp_path / "state"
    folder.write_text("no folder")
    async with run(folder) as gateway:
        await asyncio.sleep(5 * WRITE_EVERY)
        assert names(gateway) == ["config_loaded", "state_not_kept"]
        folder.unlink()
        await asyncio.sleep(WRITE_EVERY)
    async with run(folder) as again:
        await asyncio.sleep(1)
        assert names(again) == ["config_loaded", "state_not_kept", "state_kept_again", "config_loaded"]


@pytest.mark.parametrize("content", [b"", b"no database at all\n" * 500])
async def test_a_damaged_file_is_set_aside(tmp_path, content):
    (tmp_path / FILE_NAME).write_bytes(content)
    async with run(tmp_path) as gateway:
        await asyncio.sleep(1)
        assert names(gateway) == ["config_loaded", "state_damaged"]
        assert "it is now" in gateway.last.all()[-1].text


async def test_events_of_another_version_are_left_out(tmp_path):
    async with run(tmp_path):
        await asyncio.sleep(1)
    opened = open_table(tmp_path / FILE_NAME, event_file._TABLE)
    opened.database.write([(7, '{"other": 1}')])
    opened.database.close()
    async with run(tmp_path) as gateway:
        await asyncio.sleep(1)
        assert names(gateway) == ["config_loaded", "config_loaded"]


async def test_a_defect_ends_the_file_and_nothing_else(tmp_path, monkeypatch):
    async with run(tmp_path) as gateway:
        monkeypatch.setattr(gateway.last, "changes", None)
        await asyncio.sleep(2 * WRITE_EVERY)
        assert names(gateway) == ["config_loaded", "part_failed"]
        monkeypatch.undo()
