"""What is kept while the broker is away, and sent as history, in virtual time: a whole gateway, its file included."""

import asyncio
import json
import sqlite3
from contextlib import asynccontextmanager
from datetime import datetime
from itertools import pairwise

import pytest

from gateway.plant.kept import keeper
from gateway.plant.kept.history import PAUSE, REFUSED_PAUSE, SETTLING
from gateway.plant.kept.keeper import FILE_NAME, Keeper
from gateway.plant.messages import Message, Reading, Record
from gateway.plant.plain import PlainForm
from gateway.plant.sparkplug_payload import decode
from gateway.plant.topics import Topics
from gateway.timing.clock_setting import ClockSetting
from kit.broker import BEGIN, FakeBroker
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import gateway_bench

CONFIG = """
site = "plant"

[[line]]
name    = "hall"
port    = "/dev/hall"
baud    = 115200
devices = [{ unit = 1, name = "silo-1", points = [{ name = "weight", holding = 0 }, { name = "state", holding = 9 }] }]

[mqtt]
broker  = "mqtt://broker"
publish = [{ device = "silo-1", every = "400 ms" }]
"""
SPARKPLUG = CONFIG + 'sparkplug = { group = "g" }\n'
SILO = "modbus/plant/silo-1"
HISTORY = f"{SILO}/history"
SET = ClockSetting("boot", 1000.0, is_set=True)


class Plant:
    """A gateway that keeps values, a device whose weight counts up once a second, and a broker."""

    def __init__(self, bench, folder, clock) -> None:
        self.bench = bench
        self.silo = SimulatedDevice(1, delay=0.002)
        bench.attach("hall", SimulatedLine("rtu", self.silo))
        self.keeper = Keeper(folder, 2**20, 10.0, bench.events.append, clock)
        self.broker = FakeBroker.of(bench, keeper=self.keeper)

    async def count(self, seconds: int) -> None:
        """Let the weight count up."""
        for _ in range(seconds):
            self.silo.holding[0] += 1
            await asyncio.sleep(1.0)

    async def connect(self) -> None:
        """Connect; all that was kept is taken."""
        self.broker.connect()
        await self.drain()

    async def one(self) -> Message:
        """The next message of history, which is not confirmed."""
        for _ in range(100):
            for message in self.broker.take(confirmed=False):
                if message.topic == HISTORY:
                    return message
            await asyncio.sleep(0.1)
        raise AssertionError

    async def drain(self, seconds: float = 5.0) -> list[dict]:
        """The records that the broker gets as history; each message is confirmed."""
        records = []
        end = self.broker.driver.now() + seconds
        while self.broker.driver.now() < end:
            records += self.history(self.broker.take())
            await asyncio.sleep(0.05)
        return records

    @staticmethod
    def history(messages) -> list[dict]:
        """The records in messages of history."""
        return [each for message in messages if message.topic == HISTORY for each in json.loads(message.payload)]


@asynccontextmanager
async def plant(folder=None, config=CONFIG, clock=lambda: SET):
    async with gateway_bench(config) as bench:
        made = Plant(bench, folder, clock)
        yield made
        await made.keeper.close()


def weights(records) -> list[int]:
    return [record["weight"] for record in records if "weight" in record]


def times(records) -> list[float]:
    return [datetime.fromisoformat(record["time"]).timestamp() - BEGIN for record in records]


async def test_every_change_while_the_broker_was_away_comes_once_in_order_with_its_time(tmp_path):
    async with plant(tmp_path) as hall:
        await hall.count(2)
        await hall.connect()
        hall.broker.lose()
        before = hall.silo.holding[0]
        await hall.count(60)
        assert hall.keeper.status.values == 60
        hall.broker.connect()
        live = json.loads(hall.broker.retained[SILO])
        assert live["weight"] == before + 60
        records = await hall.drain()
        assert weights(records) == list(range(before + 1, before + 61))
        assert times(records) == sorted(times(records))
        assert all(0.5 < later - earlier < 1.5 for earlier, later in pairwise(times(records)))
        assert await hall.drain() == []
        assert (hall.keeper.status.values, hall.keeper.status.since, hall.keeper.status.given_up) == (0, None, 0)
        assert [event.values for event in hall.bench.events if event.name == "kept_values_sent"][-1] == 60


async def test_what_was_read_is_told_with_the_time_at_which_the_device_answered():
    async with plant() as hall:
        await hall.count(2)
        await hall.connect()
        hall.silo.holding[0] = 77
        await asyncio.sleep(0.79)  # a broker that takes its time
        (message,) = hall.broker.take()
        read_at = hall.broker.driver.publisher.watches["silo-1"].readings(hall.broker.driver.now())["weight"].at
        assert datetime.fromisoformat(json.loads(message.payload)["time"]).timestamp() == pytest.approx(read_at)
        assert read_at - BEGIN < hall.broker.driver.now() - 0.01


async def test_what_the_broker_has_not_confirmed_is_sent_again_with_the_same_time(tmp_path):
    async with plant(tmp_path) as hall:
        await hall.count(2)
        await hall.connect()
        await hall.count(1)
        messages = hall.broker.take(confirmed=False)
        assert [message.topic for message in messages] == [SILO]
        hall.broker.lose()
        await asyncio.sleep(3.0)
        await hall.count(1)
        hall.broker.connect()
        records = await hall.drain()
        told = json.loads(messages[0].payload)
        assert [(record["time"], record["weight"]) for record in records][:1] == [(told["time"], told["weight"])]


async def test_a_value_that_waits_for_a_slow_broker_is_kept_when_the_next_takes_its_place():
    async with plant() as hall:
        await hall.count(2)
        await hall.connect()
        first = hall.silo.holding[0]
        await hall.count(4)
        live, *history = hall.broker.take()
        assert json.loads(live.payload)["weight"] == first + 4
        assert weights(hall.history(history) + await hall.drain()) == [first + 1, first + 2, first + 3]


async def test_what_a_slow_broker_has_not_confirmed_comes_before_what_waited_behind_it(tmp_path):
    async with plant(tmp_path) as hall:
        await hall.count(2)
        await hall.connect()
        first = hall.silo.holding[0]
        await hall.count(1)
        (under_way,) = hall.broker.take(confirmed=False)
        await hall.count(12)
        hall.broker.lose()
        hall.broker.connect()
        records = await hall.drain()
        assert weights(records) == list(range(first + 1, first + 14))
        assert records[0]["time"] == json.loads(under_way.payload)["time"]


async def test_what_a_slow_broker_confirms_at_last_is_not_sent_again(tmp_path):
    async with plant(tmp_path) as hall:
        await hall.count(2)
        await hall.connect()
        first = hall.silo.holding[0]
        await hall.count(1)
        (under_way,) = hall.broker.take(confirmed=False)
        await hall.count(12)
        hall.broker.driver.confirmed(under_way)
        assert weights(await hall.drain(15.0)) == list(range(first + 2, first + 13))
        assert hall.keeper.status.values == 0


async def test_a_kill_loses_nothing_older_than_the_interval_if_the_broker_stands_still(tmp_path):
    async with gateway_bench(CONFIG) as bench:
        killed = Plant(bench, tmp_path, lambda: SET)
        await killed.count(2)
        await killed.connect()
        first = killed.silo.holding[0]
        await killed.count(1)
        killed.broker.take(confirmed=False)
        await asyncio.sleep(11.0)
        killed.keeper._task.cancel()
        killed.keeper._file.close()
    async with plant(tmp_path) as hall:
        await asyncio.sleep(1.0)
        hall.broker.connect()
        assert first + 1 in weights(await hall.drain())


async def test_a_value_inside_the_deadband_is_not_kept(tmp_path):
    config = CONFIG.replace('every = "400 ms"', 'every = "400 ms", on_change = 5')
    async with plant(tmp_path, config) as hall:
        await hall.count(1)
        await hall.connect()
        hall.broker.lose()
        await hall.count(21)
        hall.broker.connect()
        assert weights(await hall.drain()) == [6, 11, 16, 21]


async def test_one_message_is_under_way_and_the_next_comes_a_pause_later(tmp_path):
    async with plant(tmp_path) as hall:
        await hall.count(2)
        await hall.connect()
        hall.broker.lose()
        await hall.count(2000)
        hall.broker.connect()
        first = await hall.one()
        assert not first.retain
        assert first.qos == 1
        assert len(first.payload) < 32_768
        await asyncio.sleep(1.0)
        assert not [message for message in hall.broker.take(confirmed=False) if message.topic == HISTORY]
        hall.broker.driver.confirmed(first)
        sent = []
        for _ in range(100):
            sent += [hall.broker.driver.now() for message in hall.broker.take() if message.topic == HISTORY]
            await asyncio.sleep(0.01)
        assert len(sent) > 5
        assert min(later - earlier for earlier, later in pairwise(sent)) >= PAUSE - 1e-6


async def test_a_live_value_goes_before_what_was_kept(tmp_path):
    async with plant(tmp_path) as hall:
        await hall.count(2)
        await hall.connect()
        hall.broker.lose()
        await hall.count(30)
        hall.broker.connect()
        hall.broker.take(confirmed=False)
        await asyncio.sleep(SETTLING)
        hall.broker.take(confirmed=False)  # nothing yet: the file must be read
        hall.silo.holding[0] = 1000
        await asyncio.sleep(1.0)
        assert [message.topic for message in hall.broker.take(confirmed=False)] == [SILO, HISTORY]


async def test_another_process_sends_what_one_that_was_killed_has_kept(tmp_path):
    async with gateway_bench(CONFIG) as bench:
        killed = Plant(bench, tmp_path, lambda: SET)
        await killed.count(35)
        killed.keeper._task.cancel()
        killed.keeper._file.close()
    async with plant(tmp_path) as hall:
        await asyncio.sleep(2.0)
        assert hall.keeper.status.values >= 30
        hall.broker.connect()
        records = await hall.drain()
        assert weights(records)[:30] == list(range(1, 31)), "all but the last ten seconds"


async def test_what_a_slow_broker_has_not_confirmed_is_not_lost_with_the_gateway(tmp_path):
    async with gateway_bench(CONFIG) as bench:
        killed = Plant(bench, tmp_path, lambda: SET)
        await killed.count(2)
        await killed.connect()
        before = killed.silo.holding[0]
        for _ in range(35):
            await killed.count(1)
            killed.broker.take(confirmed=False)
        killed.keeper._task.cancel()
        killed.keeper._file.close()
    async with plant(tmp_path) as hall:
        await asyncio.sleep(2.0)
        hall.broker.connect()
        records = await hall.drain()
        assert weights(records)[:24] == list(range(before + 1, before + 25)), "all but the last ten seconds"


async def test_what_was_not_confirmed_comes_before_what_waited_behind_it(tmp_path, monkeypatch):
    monkeypatch.setattr("gateway.plant.kept.file._ROWS", 1)  # so that order is not only that of what was read together
    async with plant(tmp_path) as hall:
        await hall.count(2)
        await hall.connect()
        before = hall.silo.holding[0]
        await hall.count(1)
        hall.broker.take(confirmed=False)
        await hall.count(15)  # all of these wait, the last one in the end
        hall.broker.lose()
        await hall.count(1)
        hall.broker.connect()
        assert weights(await hall.drain()) == list(range(before + 1, before + 18))


async def test_what_is_confirmed_late_is_not_sent_as_history(tmp_path):
    async with plant(tmp_path) as hall:
        await hall.count(2)
        await hall.connect()
        before = hall.silo.holding[0]
        await hall.count(1)
        (slow,) = hall.broker.take(confirmed=False)
        await hall.count(15)
        waited = hall.history(hall.broker.take()) + await hall.drain()
        assert waited == [], "they are behind what may still be lost"
        hall.broker.driver.confirmed(slow)
        assert weights(await hall.drain()) == list(range(before + 2, before + 16))
        await asyncio.sleep(11.0)
        assert hall.keeper.status.values == 0


async def test_older_ones_of_the_file_go_first_however_long_it_takes_to_open(tmp_path):
    for value in (1.0, 2.0):
        keeper = Keeper(tmp_path, 2**20, 10.0, print, lambda: SET)
        keeper.keep("silo-1", {"weight": Reading(value, BEGIN + value, value)})
        assert keeper.take(lambda _: True, 1000) is None, "it is not open yet"
        await asyncio.sleep(1.0)
        if value == 2.0:
            keeper.take(lambda _: True, 1000)
            await asyncio.sleep(1.0)
            batch = keeper.take(lambda _: True, 1000)
            assert [record.values["weight"] for record in batch.records] == [1.0, 2.0]
        await keeper.close()


async def test_a_proper_end_loses_nothing(tmp_path):
    async with plant(tmp_path) as hall:
        await hall.count(35)
    async with plant(tmp_path) as again:
        await asyncio.sleep(0.5)
        again.broker.connect()
        assert weights(await again.drain())[:35] == list(range(1, 36))


async def test_the_oldest_are_given_up_when_there_is_no_more_room(tmp_path):
    async with gateway_bench(CONFIG) as bench:
        hall = Plant(bench, None, lambda: SET)
        hall.keeper = Keeper(tmp_path, 65536, 10.0, bench.events.append, lambda: SET)
        hall.broker.driver.publisher.history._keeps = hall.keeper
        await hall.count(6_000)
        status = hall.keeper.status
        assert status.given_up > 1000
        told = [event.values for event in bench.events if event.name == "values_given_up"]
        assert 0 <= status.given_up - sum(told) < 1000, "the rest is told within a minute"
        assert len(told) < 6_000 / 60
        assert status.bytes <= status.limit == 65536
        assert sum(file.stat().st_size for file in tmp_path.iterdir()) < 2 * 65536
        hall.keeper.ready = hall.broker.driver.look
        hall.broker.connect()
        records = await hall.drain(60.0)
        kept = weights(records)
        assert kept == list(range(kept[0], 6_001))
        assert kept[0] - 1 == pytest.approx(hall.keeper.status.given_up, abs=1)
        await hall.keeper.close()


async def test_times_of_before_the_clock_was_set_are_marked(tmp_path):
    now = [ClockSetting("boot", 1000.0, is_set=False)]
    async with plant(tmp_path, clock=lambda: now[0]) as hall:
        await hall.count(15)
        now[0] = ClockSetting("boot", 90000.0, is_set=True)
        await hall.count(5)
        hall.broker.connect()
        records = await hall.drain()
        assert [record.get("clock") for record in records][:15] == ["unsure"] * 15
        assert not any("clock" in record for record in records[16:])


async def test_history_of_a_device_in_sparkplug_waits_until_it_is_born(tmp_path):
    async with plant(tmp_path, SPARKPLUG) as hall:
        await hall.count(20)
        hall.silo.silent = True
        await asyncio.sleep(30.0)
        hall.broker.connect()
        await hall.drain()
        assert not any("DDATA" in message.topic for message in hall.broker.messages)
        hall.silo.silent = False
        await hall.drain(60.0)
        data = [decode(each.payload) for each in hall.broker.messages if "DDATA" in each.topic]
        metrics = [metric for payload in data for metric in payload.metrics if metric.is_historical]
        assert [metric.value for metric in metrics if metric.name == "weight"] == list(range(1, 21))
        assert all(metric.at < BEGIN + 25 for metric in metrics)


def test_a_point_called_time_that_was_kept_for_sparkplug_hides_no_time():
    record = Record(BEGIN, {"time": 7, "clock": 5, "weight": 1}, is_unsure=True)
    (told,) = json.loads(PlainForm(Topics("plant"), ()).history("silo-1", [record], BEGIN).payload)
    assert datetime.fromisoformat(told.pop("time")).timestamp() == BEGIN
    assert told == {"clock": "unsure", "weight": 1}


async def test_a_refused_message_is_tried_again_later_or_given_up(tmp_path):
    async with plant(tmp_path) as hall:
        await hall.count(20)
        hall.broker.connect()
        first = await hall.one()
        hall.broker.driver.refused(first, is_passing=True)
        assert await hall.drain(REFUSED_PAUSE - 2.0) == []
        again = await hall.one()
        assert again.payload.startswith(first.payload[:-1])
        hall.broker.driver.refused(again, is_passing=False)
        assert await hall.drain() == []
        assert hall.keeper.status.given_up >= 19


async def test_a_disk_that_is_full_is_told_once_and_values_are_sent_from_memory(tmp_path, monkeypatch):
    async with plant(tmp_path) as hall:
        await hall.count(2)

        def fail(*_):
            raise sqlite3.OperationalError("database or disk is full")

        monkeypatch.setattr("gateway.plant.kept.file.KeptFile.write", fail)
        await hall.count(40)
        assert hall.keeper.status.trouble
        assert [event.name for event in hall.bench.events if "state" in event.name] == ["state_not_kept"]
        hall.broker.connect()
        assert weights(await hall.drain()) == list(range(1, 43))
        monkeypatch.undo()
        await asyncio.sleep(11.0)
        assert not hall.keeper.status.trouble


async def test_nothing_is_written_while_the_broker_is_there(tmp_path):
    async with plant(tmp_path) as hall:
        await hall.count(2)
        hall.broker.connect()
        await hall.drain(15.0)
        file = tmp_path / f"{FILE_NAME}-wal"
        before = file.stat().st_size
        for _ in range(60):
            await hall.count(1)
            hall.broker.take()
        assert file.stat().st_size == before


async def test_messages_get_smaller_when_connections_are_lost_by_them(tmp_path):
    """As with a broker that closes the connection upon a message which it finds too large."""
    async with plant(tmp_path) as hall:
        await hall.count(2000)
        sizes = []
        for _ in range(4):
            hall.broker.connect()
            sizes.append(len((await hall.one()).payload))
            hall.broker.lose()
        assert sizes == sorted(sizes, reverse=True)
        assert sizes[0] < 5000
        assert sizes[-1] < 1500
        hall.broker.connect()
        assert weights(await hall.drain(30.0)) == list(range(1, 2001))
        assert max(len(message.payload) for message in hall.broker.messages) > 15_000


async def test_what_is_in_a_file_that_opens_slowly_comes_before_later_values(tmp_path, monkeypatch):
    async with plant(tmp_path) as hall:
        await hall.count(12)
    in_thread = keeper.in_thread

    async def slowly(*call):
        await asyncio.sleep(0.5)
        return await in_thread(*call)

    monkeypatch.setattr(keeper, "in_thread", slowly)
    async with plant(tmp_path) as again:
        again.silo.holding[0] = 1000
        await asyncio.sleep(0.4)
        again.silo.holding[0] = 1001
        await asyncio.sleep(0.5)
        again.broker.connect()
        first = await again.one()
        assert weights(json.loads(first.payload))[:12] == list(range(1, 13))


async def test_history_begins_when_readers_of_a_broker_that_was_restarted_may_be_there_again(tmp_path):
    async with plant(tmp_path) as hall:
        await hall.count(20)
        hall.broker.connect()
        assert await hall.drain(SETTLING - 0.1) == []
        assert weights(await hall.drain(0.5))
