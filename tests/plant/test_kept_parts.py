"""What readings are kept in: chunks, the backlog in memory, and the file."""

import asyncio
import json
import math
import sqlite3
import zlib
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.clock.times import rfc_3339
from gateway.errors import StateError
from gateway.plant.kept.backlog import MOST_IN_MEMORY, Backlog
from gateway.plant.kept.file import TABLE, KeptFile
from gateway.plant.kept.keeper import Keeper
from gateway.plant.kept.records import Chunk, Totals, Written
from gateway.plant.messages import Reading, Record
from gateway.plant.plain import PlainForm
from gateway.plant.topics import Topics
from gateway.profiles.published import PublishedDevice
from gateway.state.database import open_table
from gateway.timing.clock_setting import ClockSetting

SET = ClockSetting("boot", 1000.0, is_set=True)
BEGIN = 1_800_000_000.0


def always(_device):
    return True


def chunk(at=BEGIN, device="d", **values):
    return Chunk(device, SET, [Record(at, values or {"p": 1})])


def opened(folder, most=2**20):
    file, damage = KeptFile.open(folder / "kept.sqlite", most)
    assert not damage
    return file


def written(file, chunks, gone=()):
    done = Written(Totals())
    file.write(chunks, gone, done)
    return done


def told(found):
    return [record.values for each in found.chunks for record in each.records]


VALUES = st.one_of(st.none(), st.integers(), st.floats(allow_nan=False), st.text())


@given(st.lists(st.tuples(st.floats(0, 4e9), st.dictionaries(st.text(), VALUES, min_size=1)), min_size=1))
@settings(max_examples=60, deadline=None)
def test_a_chunk_is_read_as_it_was_packed(records):
    packed = Chunk("d", SET, [Record(at, values) for at, values in records]).pack()
    again = Chunk.unpack(7, "d", packed)
    assert [(each.at, each.values) for each in again.records] == records
    assert (again.clock, again.number, again.readings) == (SET, 7, sum(len(values) for _, values in records))


@given(st.binary(max_size=60))
@settings(max_examples=100, deadline=None)
def test_what_is_no_chunk_is_a_value_error(content):
    for each in (content, zlib.compress(content)):
        with pytest.raises(ValueError, match=r"."):
            Chunk.unpack(1, "d", each)


@pytest.mark.parametrize("text", ["{}", "[]", '{"clock":["b",1,true],"records":[]}', '{"clock":[],"records":[[1,{}]]}'])
def test_json_that_is_no_chunk_is_a_value_error(text):
    with pytest.raises(ValueError, match=r"."):
        Chunk.unpack(1, "d", zlib.compress(text.encode()))


@pytest.mark.parametrize("at", range(0, 90, 3))
def test_a_row_that_is_damaged_at_any_byte_is_told_of_and_no_other_is(tmp_path, at):
    file = opened(tmp_path)
    written(file, [chunk(BEGIN + each, p=each) for each in range(5)])
    file.close()
    database = sqlite3.connect(tmp_path / "kept.sqlite")
    content = bytearray(database.execute("SELECT content FROM kept WHERE number = 3").fetchone()[0])
    content[at % len(content)] ^= 1 << at % 8
    database.execute("UPDATE kept SET content = ? WHERE number = 3", (bytes(content),))
    database.commit()
    database.close()
    file = opened(tmp_path)
    found = file.after(0)
    assert told(found) == [{"p": 0}, {"p": 1}, {"p": 3}, {"p": 4}]
    assert found.damaged == {3: 1}
    backlog = Backlog(lambda: SET)
    backlog.opened(file.readings(), 5)
    for _ in range(2):
        backlog.load(file.after(0), 0)
        backlog.rewind()
    assert (backlog.given_up, backlog.in_file) == (1, 4), "counted once"
    assert backlog.changes()[1] == {3}, "and deleted"
    file.close()


def test_a_file_with_any_byte_changed_gives_true_values_or_is_set_aside(tmp_path):
    file = opened(tmp_path)
    written(file, [chunk(BEGIN + each, p=each) for each in range(20)])
    file.close()
    path = tmp_path / "kept.sqlite"
    whole = path.read_bytes()
    true = [{"p": each} for each in range(20)]
    for at in (*range(100), *range(100, len(whole), 41)):
        damaged = bytearray(whole)
        damaged[at] ^= 0xFF
        for each in tmp_path.iterdir():
            each.unlink()
        path.write_bytes(damaged)
        try:
            file, _ = KeptFile.open(path, 2**20)
        except (StateError, sqlite3.Error):  # a later version, perhaps
            continue
        try:
            file.readings()
            found = file.after(0)
            assert all(each in true for each in told(found)), at
            number = written(file, [chunk(BEGIN + 100, p=100)], found.damaged).chunks[0][1]
            assert {"p": 100} in told(file.after(number - 1)), at
        except sqlite3.Error:  # the keeper has it set aside
            pass
        finally:
            file.close()


@pytest.mark.parametrize("most", [65536, 100_000, 2**20])
@pytest.mark.parametrize("points", [1, 12, 300])
def test_the_file_and_its_journal_never_take_more_than_they_may(tmp_path, most, points):
    file = opened(tmp_path, most)
    largest = 0
    count = 1500 if most < 2**20 else 6000
    gone = 0
    for first in range(0, max(40, count // points), 20):
        chunks = [
            chunk(BEGIN + at, **{f"p{each}": math.sin(at * each + each) * 1e9 for each in range(points)})
            for at in range(first, first + 20)
        ]
        gone += len(written(file, chunks).given_up)
        largest = max(largest, sum(each.stat().st_size for each in tmp_path.iterdir()))
    assert largest <= most
    newest = file.after(file._last - 1)
    assert len(newest.chunks) == 1, "the newest is there"
    file.close()


def test_the_oldest_go_first_and_are_counted(tmp_path):
    file = opened(tmp_path, 65536)
    given_up = []
    for at in range(400):
        done = written(file, [chunk(BEGIN + at, **{f"p{each}": math.sin(at * each) for each in range(100)})])
        given_up += done.given_up
    assert given_up == [(number, 100) for number in range(1, len(given_up) + 1)]
    rest = []
    while (found := file.after(len(given_up) + len(rest))).chunks:
        rest += [each.number for each in found.chunks]
    assert rest == list(range(len(given_up) + 1, 401))
    assert len(rest) > 5
    file.close()


def test_a_file_that_may_take_less_than_before_keeps_the_newest(tmp_path):
    file = opened(tmp_path, 4 * 2**20)
    for number in range(200):
        values = {f"p{each}": math.sin(number + each) for each in range(500)}
        written(file, [chunk(BEGIN + number, **values)])
    before = file.readings()
    file.close()
    less = opened(tmp_path, 2**20)
    done = written(less, [chunk(BEGIN + 300)])
    assert 0.7 * less.room < done.totals.size <= less.room
    numbers = [number for number, _ in done.given_up]
    assert numbers == list(range(1, len(numbers) + 1))
    assert sum(readings for _, readings in done.given_up) == before + 1 - less.readings()
    assert (tmp_path / "kept.sqlite-wal").stat().st_size < 2**20
    less.close()


def test_numbers_are_not_used_again(tmp_path):
    file = opened(tmp_path)
    assert [number for _, number in written(file, [chunk(), chunk()]).chunks] == [1, 2]
    assert [number for _, number in written(file, [chunk()], {1, 2}).chunks] == [3]
    written(file, [], {3})
    assert [number for _, number in written(file, [chunk()]).chunks] == [4]
    file.close()


def test_a_file_of_a_later_version_is_left_alone(tmp_path):
    open_table(tmp_path / "kept.sqlite", replace(TABLE, version=2)).database.close()
    with pytest.raises(StateError, match="later version"):
        KeptFile.open(tmp_path / "kept.sqlite", 2**20)


def test_a_second_process_cannot_open_it(tmp_path):
    file = opened(tmp_path)
    with pytest.raises(StateError, match="another modbus-gateway"):
        KeptFile.open(tmp_path / "kept.sqlite", 2**20)
    file.close()


@pytest.mark.interpreted
def test_a_write_that_fails_halfway_tells_what_is_on_the_disk(tmp_path):
    file = opened(tmp_path, 65536)
    whole, calls = file._database.write, []

    def fail(*rows):
        calls.append(1)
        if len(calls) > 2:
            raise sqlite3.OperationalError("disk I/O error")
        whole(*rows)

    file._database.write = fail
    done = Written(Totals())
    chunks = [chunk(BEGIN + at, **{f"p{each}": math.sin(at * each) for each in range(200)}) for at in range(20)]
    with pytest.raises(sqlite3.OperationalError):
        file.write(chunks, (), done)
    assert 0 < len(done.chunks) < 20
    assert [each.number for each in file.after(0).chunks] == [number for _, number in done.chunks]
    file.close()


def test_after_a_connection_that_found_nothing_the_file_is_not_read_for_ever(tmp_path):
    file = opened(tmp_path)
    backlog = Backlog(lambda: SET)
    backlog.keep("d", {"p": Reading(1, BEGIN)})
    backlog.written(written(file, *backlog.changes()))
    backlog.load(file.after(0), 0)
    backlog.sent(backlog.take(always, 1000))
    backlog.written(written(file, *backlog.changes()))
    backlog.rewind()
    assert backlog.must_load
    backlog.load(file.after(0), 0)
    assert backlog.take(always, 1000) is None
    assert not backlog.must_load
    assert (backlog.in_file, backlog.in_memory) == (0, 0)
    file.close()


def test_a_confirmation_while_its_row_is_written_is_not_forgotten(tmp_path):
    file = opened(tmp_path)
    backlog = Backlog(lambda: SET)
    backlog.keep("d", {"p": Reading(1, BEGIN)})
    batch = backlog.take(always, 1000)
    done = written(file, *backlog.changes())
    backlog.sent(batch)
    backlog.written(done)
    assert (backlog.in_file, backlog.in_memory) == (0, 0)
    assert backlog.changes() == ([], {1})
    file.close()


def test_a_device_that_must_not_be_told_does_not_hold_up_others(tmp_path):
    file = opened(tmp_path)
    backlog = Backlog(lambda: SET)
    for at in range(150):
        backlog.keep("dead", {"p": Reading(at, BEGIN + at)})
        backlog.written(written(file, *backlog.changes()))
    backlog.keep("d", {"p": Reading(7, BEGIN)})
    backlog.written(written(file, *backlog.changes()))

    def drain(may_tell):
        values = []
        for _ in range(400):
            if (batch := backlog.take(may_tell, 1000)) is not None:
                values += [record.values["p"] for record in batch.records]
                backlog.sent(batch)
            elif backlog.must_load:
                backlog.load(file.after(backlog.loaded_to), backlog.loaded_to)
        return values

    assert drain(lambda device: device == "d") == [7]
    assert drain(always) == list(range(150)), "and is told when it may be"
    file.close()


def test_a_row_that_is_given_up_while_a_message_with_it_is_under_way_is_kept_in_memory():
    backlog = Backlog(lambda: SET)
    backlog.keep("d", {"p": Reading(1, BEGIN)})
    batch = backlog.take(always, 1000)
    (written_chunk,) = batch.parts
    backlog.written(Written(Totals(), [(written_chunk, 1)]))
    backlog.written(Written(Totals(), given_up=[(1, 1)]))
    assert (backlog.given_up, backlog.in_memory, backlog.in_file) == (0, 1, 0)
    backlog.sent(batch)
    assert (backlog.given_up, backlog.in_memory) == (0, 0)
    assert backlog.take(always, 1000) is None


def test_memory_alone_gives_up_the_oldest_and_not_all():
    backlog = Backlog(lambda: SET)
    for at in range(MOST_IN_MEMORY + 1):
        backlog.keep("d", {"p": Reading(at, BEGIN + at)})
    assert backlog.in_memory > MOST_IN_MEMORY - 1000
    assert backlog.in_memory + backlog.given_up == MOST_IN_MEMORY + 1


def test_what_a_message_has_told_of_a_chunk_is_not_told_again_after_a_loss():
    backlog = Backlog(lambda: SET)
    for at in range(10):
        backlog.keep("d", {"p": Reading(at, BEGIN + at)})
    first = backlog.take(always, 200)
    backlog.sent(first)
    backlog.rewind()
    rest = backlog.take(always, 10_000)
    assert [record.values["p"] for record in first.records + rest.records] == list(range(10))


def test_another_process_counts_all_values_of_a_chunk_that_was_told_in_part(tmp_path):
    file = opened(tmp_path)
    backlog = Backlog(lambda: SET)
    for at in range(10):
        backlog.keep("d", {"p": Reading(at, BEGIN + at)})
    backlog.sent(backlog.take(always, 200))
    backlog.written(written(file, *backlog.changes()))
    assert backlog.in_file < 10
    assert file.readings() == 10
    file.close()


def test_at_a_proper_end_the_file_has_only_the_rest_of_a_chunk(tmp_path):
    file = opened(tmp_path)
    backlog = Backlog(lambda: SET)
    for at in range(10):
        backlog.keep("d", {"p": Reading(at, BEGIN + at)})
    backlog.written(written(file, *backlog.changes()))
    backlog.load(file.after(0), 0)
    batch = backlog.take(always, 200)
    backlog.sent(batch)
    backlog.rewind()
    chunks, gone = backlog.changes()
    backlog.written(written(file, [*chunks, *backlog.rests()], gone))
    assert told(file.after(0)) == [{"p": at} for at in range(len(batch.records), 10)]
    assert file.readings() == backlog.in_file == 10 - len(batch.records)
    file.close()


@pytest.mark.interpreted
async def test_a_write_that_fails_halfway_is_not_written_again(tmp_path):
    keeper = Keeper(tmp_path, 65536, 10.0, lambda event: None, lambda: SET)
    await asyncio.sleep(1.0)
    database = keeper._file._database
    whole, calls = database.write, []

    def fail(*rows):
        calls.append(1)
        if len(calls) == 2:
            raise sqlite3.OperationalError("disk I/O error")
        whole(*rows)

    database.write = fail
    for at in range(6):
        keeper.keep(f"d{at}", {f"p{each}": Reading(math.sin(at * each), BEGIN) for each in range(200)})
    await asyncio.sleep(25.0)
    assert len(calls) > 2
    assert keeper._file.readings() == 1200 - keeper.status.given_up == keeper.status.values
    await keeper.close()


@pytest.mark.parametrize("text", ["\x01" * 200, "\u2713" * 200, '"' * 200, "x" * 200])
def test_a_message_does_not_get_larger_than_it_may_by_its_texts(text):
    backlog = Backlog(lambda: SET)
    for each in range(100):
        backlog.keep("d", {text: Reading(text, BEGIN + each)})
    records = backlog.take(always, 16_000).records
    content = json.dumps([dict(each.values) for each in records], ensure_ascii=False).encode()
    assert 8_000 < len(content) < 18_500


def test_what_comes_late_is_told_in_order():
    backlog = Backlog(lambda: SET)
    backlog.keep("d", {"p": Reading(2, BEGIN + 2)})
    backlog.keep("d", {"p": Reading(1, BEGIN + 1)})
    assert [record.values["p"] for record in backlog.take(always, 1000).records] == [1, 2]


def test_what_was_loaded_of_a_file_that_is_damaged_is_kept_anew(tmp_path):
    file = opened(tmp_path)
    backlog = Backlog(lambda: SET)
    for at in range(150):
        backlog.keep("d", {"p": Reading(at, BEGIN + at)})
        backlog.written(written(file, *backlog.changes()))
    backlog.load(file.after(0), 0)
    backlog.take(always, 200)
    backlog.lost_file()
    assert (backlog.in_memory, backlog.in_file, backlog.given_up) == (100, 0, 50)
    backlog.rewind()
    assert backlog.take(always, 100_000).records[-1].values == {"p": 99}
    file.close()


def test_a_time_is_unsure_if_it_is_before_the_program_or_the_clock_was_set_since_in_the_same_boot():
    chunk = Chunk("silo-1", ClockSetting("boot", 1000.0, is_set=True))
    now, of_old = Record(1_800_000_000.0, {"weight": 1}), Record(1.0, {"weight": 1})
    assert not chunk.as_sent(now, chunk.clock).is_unsure
    assert chunk.as_sent(of_old, chunk.clock).is_unsure
    assert chunk.as_sent(now, chunk.clock._replace(ahead=1002.0)).is_unsure
    assert not chunk.as_sent(now, chunk.clock._replace(ahead=1000.5)).is_unsure
    assert not chunk.as_sent(now, chunk.clock._replace(ahead=5000.0, boot="next")).is_unsure


def test_a_live_message_has_the_time_of_what_was_read_last_also_after_the_clock_was_set_back():
    device = PublishedDevice("silo-1", 1, "Silo", ())
    readings = {"weight": Reading(1, 1_800_000_100.0, 5.0), "state": Reading(2, 1_800_000_000.0, 6.0)}
    (message,) = PlainForm(Topics("plant"), (device,)).values(device, readings, set(readings), 1_800_000_001.0)
    assert json.loads(message.payload)["time"] == rfc_3339(1_800_000_000.0)
    assert {reading.at for reading in message.told.values()} == {1_800_000_000.0}
