"""Trends of points out of what passes: their slots, their file, and what a disk or a clock does to them."""

import asyncio
import sqlite3
from contextlib import asynccontextmanager, closing
from pathlib import Path

import pytest

from gateway.errors import WrongQuestion
from gateway.operator.operations.answers.trend import TrendSlot
from gateway.operator.operations.asked import TrendOfPoint
from gateway.operator.operations.operation import Asker
from gateway.operator.operations.parameters import read_parameters
from gateway.operator.operations.table import VALUE_HISTORY
from gateway.operator.operator import Operator
from gateway.operator.trends import kept as kept_module
from gateway.operator.trends import table as table_module
from gateway.operator.trends.kept import FILE_NAME, WRITE_EVERY, kept_trends, trends_kept
from gateway.operator.trends.told import slots_of
from gateway.operator.trends.trends import Trends
from gateway.operator.units.units import picture
from gateway.operator.values.requests import AT_CONTROL
from gateway.operator.values.unit_values import point_named
from gateway.timing.trend import Layout
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import gateway_bench
from kit.others import Others

CONFIG = """
[profile.meter]
points = [
  { name = "power", holding = 0, type = "int16", unit = "kW", scale = 0.1 },
  { name = "energy", holding = 1, type = "uint32", scale = 0.1 },
  { name = "state", holding = 3, labels = { 1 = "running" } },
  { name = "name", holding = 4, type = "string", length = 4 },
  { name = "alarm", coils = 3 },
]

[[line]]
name = "hall"
port = "/dev/hall"
devices = [{ unit = 1, name = "meter", profile = "meter" }, { unit = 2, name = "press" }]
"""
#: A multiple of ten minutes.
NOON = 1_777_636_800
DAY = 24 * 3600.0


class Bench:
    """A gateway that keeps trends. `by` is added to its clock."""

    def __init__(self, home, device: SimulatedDevice) -> None:
        self.home = home
        self.device = device
        self.by = 0.0
        self.began = asyncio.get_running_loop().time()
        self.operator = Operator(home.running, None, self.time)

    def time(self) -> float:
        return NOON + asyncio.get_running_loop().time() - self.began + self.by

    async def reads(self, value: int, seconds: int = 1, pdu: str = "03 0000 0008") -> None:
        """Read it each second, half a second after the last look."""
        self.device.holding[0] = value
        for _ in range(seconds):
            await self.home.client().asks(1, pdu)
            await asyncio.sleep(1)

    async def slots(self, point: str = "power", since: float = NOON - DAY):
        unit = picture(self.operator, "meter")
        found = await slots_of(self.operator, unit, point_named(unit, point), since, self.time() + DAY)
        return [(slot.time - NOON, slot.least, slot.mean, slot.greatest) for slot in found]

    async def tells(self, **asked):
        asked = read_parameters(TrendOfPoint, {"device": "meter", "point": "power", **asked})
        return await VALUE_HISTORY.answer(self.operator, asked, Asker(AT_CONTROL, lambda: True))

    def events(self, name: str):
        return [event for event in self.home.events if event.name == name]


@asynccontextmanager
async def bench_with_trends(folder: Path | None, kept: float = DAY, config: str = CONFIG, at: float = 0.0):
    async with gateway_bench(config) as home:
        device = SimulatedDevice(1)
        home.attach("hall", SimulatedLine("rtu", device))
        bench = Bench(home, device)
        bench.by = at
        async with trends_kept(bench.operator, kept, folder):
            yield bench


@pytest.fixture
async def bench(tmp_path):
    async with bench_with_trends(tmp_path) as bench:
        yield bench


async def test_least_mean_and_greatest_of_a_minute(bench):
    for value in (100, 110, 150):
        await bench.reads(value)
    await bench.reads(200, 2)
    assert await bench.slots() == [(0, 10.0, pytest.approx(15.2), 20.0)]
    await asyncio.sleep(60)
    await bench.reads(7)
    assert await bench.slots() == [(0, 10.0, pytest.approx(15.2), 20.0), (60, 0.7, 0.7, 0.7)]


async def test_numbers_have_trends_and_texts_have_none(bench):
    bench.device.holding[:8] = [0, 1883, 0xFFFF, 1, 0x4142, 0, 0, 0]
    bench.device.coils[3] = True
    await bench.reads(0xFFFF)
    await bench.reads(0xFFFF, pdu="01 0000 0008")
    assert await bench.slots("power") == [(0, -0.1, -0.1, -0.1)]
    assert await bench.slots("energy") == [(0, 12346982.3, 12346982.3, 12346982.3)]
    assert await bench.slots("alarm") == [(0, 1, 1, 1)]
    assert await bench.slots("state") == await bench.slots("name") == []
    bench.device.holding[3] = 2
    await bench.reads(0)
    assert await bench.slots("state") == [(0, 2, 2, 2)]


async def test_what_others_read_on_a_monitor_line_makes_a_trend(tmp_path):
    config = CONFIG.replace('port = "/dev/hall"', 'port = "/dev/hall"\nrole = "monitor"')
    async with bench_with_trends(tmp_path, config=config) as bench:
        others = Others(bench.home.lines["hall"], bench.device)
        await asyncio.sleep(10)
        for value in (100, 150):
            bench.device.holding[0] = value
            await others.ask(1, "03 0000 0008")
            await asyncio.sleep(2)
        assert await bench.slots() == [(0, 10.0, 12.5, 15.0)]


async def test_a_response_counts_once_also_over_a_reload(bench):
    await bench.reads(100)
    await asyncio.sleep(3 * 60)
    await bench.home.reload(CONFIG.replace('name = "press"', 'name = "saw"'))
    await asyncio.sleep(3 * 60)
    assert [time for time, *_ in await bench.slots()] == [0]
    await bench.reads(120)
    assert [least for _, least, *_ in await bench.slots()] == [10.0, 12.0]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('unit = "kW", scale = 0.1', 'unit = "kW", scale = 0.01'),
        ("holding = 0,", "holding = 5,"),
        ('unit = "kW"', 'unit = "W"'),
        ("{ unit = 1,", "{ unit = 3, as = 1,"),
    ],
)
async def test_a_point_that_means_something_else_begins_another_trend(bench, old, new):
    await bench.reads(100)
    changed = CONFIG.replace(old, new)
    assert changed != CONFIG
    await bench.home.reload(changed)
    await asyncio.sleep(2)
    assert await bench.slots() == []
    await bench.home.reload(CONFIG)
    assert len(await bench.slots()) == 1


async def test_what_is_read_after_a_reload_is_decoded_as_the_new_config_says(bench):
    await bench.reads(100)
    await bench.home.reload(CONFIG.replace("scale = 0.1 },", "scale = 0.01 },", 1))
    await bench.reads(200)
    assert [least for _, least, *_ in await bench.slots()] == [2.0]


async def test_two_names_of_one_unit_have_a_trend_each(tmp_path):
    config = CONFIG.replace("{ unit = 2,", '{ unit = 1, as = 7, name = "twin", profile = "meter" }, { unit = 2,')
    async with bench_with_trends(tmp_path, config=config) as bench:
        await bench.reads(100)
        assert [each.min for name in ("meter", "twin") for each in (await bench.tells(device=name)).slots] == [10, 10]


# --- the file --------------------------------------------------------------------------------------


async def test_a_run_goes_on_where_the_one_before_has_stopped(tmp_path):
    async with bench_with_trends(tmp_path) as bench:
        await bench.reads(100, 2)
    async with bench_with_trends(tmp_path, at=20) as bench:
        await bench.reads(300, 2)
        await asyncio.sleep(WRITE_EVERY)
        await bench.reads(500)
    async with bench_with_trends(tmp_path, at=1800) as bench:
        await asyncio.sleep(1)
        assert await bench.slots() == [(0, 10.0, 30.0, 30.0), (600, 50.0, 50.0, 50.0)]


@pytest.mark.parametrize("kept", [DAY, 7 * DAY])
async def test_a_kill_loses_ten_minutes(tmp_path, kept):
    async with bench_with_trends(tmp_path, kept) as bench:
        for _ in range(20):
            await bench.reads(100)
            await asyncio.sleep(59)
        await asyncio.sleep(10)
        copies = tmp_path / "copies"
        copies.mkdir()
        for file in tmp_path.glob(f"{FILE_NAME}*"):
            (copies / file.name).write_bytes(file.read_bytes())
        before = await bench.slots()
    async with bench_with_trends(copies, kept, at=1500) as bench:
        await asyncio.sleep(1)
        assert await bench.slots() == before
        assert len(before) == (20 if kept == DAY else 2)


async def test_the_disk_is_written_every_ten_minutes_and_only_if_something_was_heard(tmp_path, monkeypatch):
    written = []
    write = table_module.write
    monkeypatch.setattr("gateway.operator.trends.kept.write", lambda *args: written.append(args) or write(*args))
    async with bench_with_trends(tmp_path) as bench:
        for _ in range(60):
            await bench.reads(100)
            await asyncio.sleep(59)
        assert len(written) == 5
        assert [len({block for (block, _), _ in pieces}) for _, _, pieces, _ in written] == [1] * 5
        await asyncio.sleep(3600)
        assert len(written) == 6


async def test_without_a_folder_the_last_hours_are_in_memory(tmp_path):
    async with bench_with_trends(None) as bench:
        for _ in range(60):
            await bench.reads(100)
            await asyncio.sleep(59)
        assert len(await bench.slots()) == 60


async def test_no_trends_are_kept_for_0(tmp_path):
    async with bench_with_trends(tmp_path, 0.0) as bench:
        await bench.reads(100)
        assert kept_trends(bench.operator) is None
        with pytest.raises(WrongQuestion, match="no trends are kept"):
            await bench.tells()
    assert list(tmp_path.iterdir()) == []


async def test_what_is_too_old_is_dropped(tmp_path):
    kept = 3600.0
    async with bench_with_trends(tmp_path, kept) as bench:
        for _ in range(3 * int(kept / 600)):
            await bench.reads(100)
            await asyncio.sleep(599)
        slots = await bench.slots()
        assert kept / 600 - 1 <= len(slots) <= kept / 600 + 1
    with closing(sqlite3.connect(tmp_path / FILE_NAME)) as connection:
        ((oldest,),) = connection.execute("SELECT min(block) FROM pieces")
    assert oldest >= NOON + 2 * kept - 1200


async def test_the_oldest_are_dropped_where_there_is_no_room(tmp_path, monkeypatch):
    monkeypatch.setattr(table_module, "MOST_BYTES", table_module.LOG_BYTES + 16 * 4096)
    points = ", ".join(f'{{ name = "p{at}", holding = {at} }}' for at in range(120))
    config = CONFIG.replace('{ name = "alarm", coils = 3 },', f'{{ name = "alarm", coils = 3 }}, {points},')
    async with bench_with_trends(tmp_path, config=config) as bench:
        for value in range(20):
            for second in range(10):
                bench.device.holding[:120] = [(value * at + second) % 1000 for at in range(120)]
                await bench.reads(value, pdu="03 0000 0078")
                await asyncio.sleep(59)
        slots = await bench.slots("p7")
        assert 10 < len(slots) < 100
        assert slots[-1][0] >= 19 * 600
    assert (tmp_path / FILE_NAME).stat().st_size < 32 * 4096


# --- trouble ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("content", [None, b"", b"no database at all\n" * 500])
async def test_a_torn_file_is_set_aside_and_a_new_one_begun(tmp_path, content):
    async with bench_with_trends(tmp_path) as bench:
        await bench.reads(100)
    file = tmp_path / FILE_NAME
    good = file.read_bytes()
    file.write_bytes(good[: len(good) // 3] if content is None else content)
    async with bench_with_trends(tmp_path, at=60) as bench:
        await bench.reads(200)
        await asyncio.sleep(WRITE_EVERY)
        (damaged,) = bench.events("state_damaged")
        assert "it is now" in damaged.damage
        assert "begun anew" in damaged.damage
        assert bench.events("state_not_kept") == []
    async with bench_with_trends(tmp_path, at=1800) as bench:
        await asyncio.sleep(1)
        assert await bench.slots() == [(60, 20.0, 20.0, 20.0)]


async def test_a_file_that_is_torn_while_it_is_open_is_set_aside_at_the_next_write(tmp_path):
    async with bench_with_trends(tmp_path) as bench:
        await bench.reads(100)
        await asyncio.sleep(WRITE_EVERY + 10)
        with kept_trends(bench.operator)._file._database._connection as torn:
            torn.execute("PRAGMA writable_schema = ON")
            torn.execute("UPDATE sqlite_master SET rootpage = 77")
            torn.execute("PRAGMA writable_schema = RESET")
        await bench.reads(200)
        assert len(await bench.slots()) >= 1
        await asyncio.sleep(2 * WRITE_EVERY)
        assert len(bench.events("state_damaged")) == 1
        assert len(bench.events("state_kept_again")) == len(bench.events("state_not_kept"))
        assert (await bench.slots())[-1][1:] == (20.0, 20.0, 20.0)


async def test_a_value_that_has_changed_by_itself_is_a_gap(tmp_path):
    async with bench_with_trends(tmp_path) as bench:
        await bench.reads(100)
        await asyncio.sleep(WRITE_EVERY)
        await bench.reads(100)
    with closing(sqlite3.connect(tmp_path / FILE_NAME)) as connection, connection:
        connection.execute("UPDATE pieces SET content = x'010000000000000059c0' WHERE block = ?", (NOON,))
    async with bench_with_trends(tmp_path, at=1800) as bench:
        await asyncio.sleep(1)
        assert [time for time, *_ in await bench.slots()] == [600]
        assert bench.events("state_damaged") == []


async def test_a_disk_that_fails_is_told_once_and_nothing_is_lost(tmp_path, monkeypatch):
    def fail(*_: object) -> None:
        raise sqlite3.OperationalError("database or disk is full")

    async with bench_with_trends(tmp_path) as bench:
        with monkeypatch.context() as full:
            full.setattr("gateway.operator.trends.kept.write", fail)
            for _ in range(60):
                await bench.reads(100)
                await asyncio.sleep(59)
            assert [event.reason for event in bench.events("state_not_kept")] == ["database or disk is full"]
            assert len(await bench.slots()) == 60
        await asyncio.sleep(WRITE_EVERY)
        assert len(bench.events("state_kept_again")) == 1
    async with bench_with_trends(tmp_path, at=3 * 3600) as bench:
        await asyncio.sleep(1)
        assert len(await bench.slots()) == 60


async def test_memory_stays_bounded_while_the_disk_fails(tmp_path, monkeypatch):
    monkeypatch.setattr("gateway.operator.trends.trends.MOST_PIECES", 6)
    (tmp_path / "state").write_text("no folder")
    async with bench_with_trends(tmp_path / "state") as bench:
        for _ in range(12):
            await bench.reads(100)
            await asyncio.sleep(599)
        assert len(await bench.slots()) <= 4
        assert len(bench.events("state_not_kept")) == 1


async def test_a_clock_that_is_set_back_and_right_again(bench):
    await bench.reads(100)
    bench.by = -3600
    await bench.reads(200)
    await asyncio.sleep(60)
    bench.by = 0
    await bench.reads(300)
    assert [row[:2] for row in await bench.slots()] == [(-3600, 20.0), (0, 10.0), (60, 30.0)]


async def test_a_clock_far_ahead_for_a_while_spoils_an_hour_at_most(bench):
    for _ in range(3 * 6):
        await bench.reads(100)
        await asyncio.sleep(599)
    bench.by = 30 * DAY
    await bench.reads(200)
    await asyncio.sleep(WRITE_EVERY)
    bench.by = 0
    await asyncio.sleep(2)
    assert len(await bench.slots()) >= 12


# --- the operation ---------------------------------------------------------------------------------


async def test_the_trend_of_a_point_for_programs(bench):
    for value in range(100, 220, 10):
        await bench.reads(value)
        await asyncio.sleep(59)
    told = await bench.tells()
    assert (told.device, told.point, told.measure, told.step_s) == ("meter", "power", "kW", 60)
    assert told.slots[0] == TrendSlot("2026-05-01T12:00:00Z", 10.0, 10.0, 10.0)
    assert len(told.slots) == 12
    in_fives = await bench.tells(step="270 s", since="2026-05-01T14:00:00+02:00", until="2026-05-01T12:10:00Z")
    assert in_fives.step_s == 300
    assert in_fives.slots == [
        TrendSlot("2026-05-01T12:00:00Z", 10.0, 12.0, 14.0),
        TrendSlot("2026-05-01T12:05:00Z", 15.0, 17.0, 19.0),
    ]
    assert len((await bench.tells(since="3 min")).slots) in (3, 4)
    assert (await bench.tells(since="2 h", until="1 h")).slots == []
    assert len((await bench.tells(since="1970-01-01T00:00:00Z", until="9999-01-01T00:00:00Z")).slots) == 12


@pytest.mark.parametrize("asked", [{"since": "yesterday"}, {"until": "-1"}, {"step": "soon"}, {"point": "powr"}])
async def test_what_cannot_be_told(bench, asked):
    ((name, value),) = asked.items()
    with pytest.raises(WrongQuestion, match=f"{name}.*must be|{value}"):
        await bench.tells(**asked)


async def test_a_mirror_has_no_trend_of_its_own(tmp_path):
    mirror = '[[image]]\nunit = 11\nof = "meter"\nread = [{ holding = "0-7", every = "1 s" }]\n'
    async with bench_with_trends(tmp_path, config=CONFIG + mirror) as bench:
        with pytest.raises(WrongQuestion, match="not a device"):
            await bench.tells(device=11)


async def test_the_last_hour_of_all_points_is_read_once_a_slot(bench, monkeypatch):
    await bench.reads(100)
    kept = kept_trends(bench.operator)
    first = await kept.recent(bench.time())
    await bench.reads(200)
    assert await kept.recent(bench.time()) is first
    await asyncio.sleep(60)
    (means,) = [means for means in (await kept.recent(bench.time())).values() if 15.0 in means]
    assert len(means) == kept_module.RECENT_SLOTS == 60
    assert [place for place, mean in enumerate(means) if mean == mean] == [58]  # noqa: PLR0124 - others are none


def test_what_is_being_written_can_be_read_and_comes_back_if_it_could_not_be():
    trends = Trends(Layout.of(DAY))

    def heard(at: float, number: float) -> None:
        for _ in trends.at(at):
            pass
        trends.add(7, number)

    def slots():
        return [
            (slot.time - NOON, slot.least, slot.greatest) for slot in trends.newest().slots(None, 7, NOON, NOON + 900)
        ]

    heard(NOON, 1.0)
    heard(NOON + 60, 2.0)
    taken = trends.changes()
    heard(NOON + 61, 3.0)
    heard(NOON + 120, 4.0)
    assert slots() == [(0, 1.0, 1.0), (60, 2.0, 3.0), (120, 4.0, 4.0)]
    trends.put_back(taken)
    assert slots() == [(0, 1.0, 1.0), (60, 2.0, 3.0), (120, 4.0, 4.0)]
    assert len(trends.changes().written) == 1
