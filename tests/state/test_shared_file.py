"""Files in the state folder that several gateways may share: who changes what, and who waits for how long."""

import fcntl
import json
import os
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import pytest

from gateway.events import StateDamaged, StateKeptAgain, StateNotKept
from gateway.state import shared_file
from gateway.state.shared_file import SharedFile
from kit.patient_clock import PatientClock
from kit.process import PATIENCE


@pytest.fixture
def told():
    return []


@pytest.fixture
def shared(tmp_path: Path, told):
    return SharedFile(tmp_path / "deep" / "entries.json", lambda entry: isinstance(entry, int), told.append)


def test_changes_are_there_when_it_is_closed(shared, told) -> None:
    for number in range(100):
        shared.change(f"key-{number % 10}", number)
    shared.change("key-3", None)
    shared.close()
    assert shared.read() == {f"key-{number % 10}": number for number in range(90, 100) if number != 93}
    assert told == []


def test_entries_of_others_stay(shared, told) -> None:
    other = SharedFile(shared.file, lambda entry: True, told.append)
    for one in (shared, other, shared):
        one.change(str(id(one)), 1)
        one.close()
    assert shared.read() == {str(id(shared)): 1, str(id(other)): 1}


def test_a_change_behind_a_close_is_written_too(shared) -> None:
    shared.change("a", 1)
    shared.close()
    shared.change("b", 2)
    shared.close()
    assert shared.read() == {"a": 1, "b": 2}


def test_a_lock_that_somebody_keeps_holds_up_no_end(shared, told, monkeypatch) -> None:
    monkeypatch.setattr(shared_file, "CLOSING_DEADLINE", 0.05)
    shared.file.parent.mkdir()
    with shared.file.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        shared.change("a", 1)
        shared.close()
        assert told == [StateNotKept(str(shared.file), "the disk, or another gateway, takes too long")]
    monkeypatch.setattr(shared_file, "CLOSING_DEADLINE", PATIENCE)
    shared.close()
    assert shared.read() == {"a": 1}


def test_a_disk_that_hangs_is_waited_for_once_whatever_has_changed(tmp_path, told, monkeypatch) -> None:
    monkeypatch.setattr(shared_file, "CLOSING_DEADLINE", 0.5)
    released = threading.Event()
    monkeypatch.setattr("os.fsync", lambda descriptor: released.wait(PATIENCE))
    files = [SharedFile(tmp_path / f"{number}.json", lambda entry: True, told.append) for number in range(20)]
    for file in files:
        file.change("a", 1)
    with PatientClock() as clock:
        for file in files:
            file.close()
        assert clock.seconds < 5.0  # of ten if each is waited for
    assert len(told) == len(files)
    released.set()
    monkeypatch.setattr(shared_file, "CLOSING_DEADLINE", PATIENCE)
    for file in files:
        file.close()
        assert file.read() == {"a": 1}


def test_a_lock_that_somebody_keeps_is_told_and_later_changes_are_written(shared, told, monkeypatch) -> None:
    monkeypatch.setattr(shared_file, "LOCK_DEADLINE", 0.05)
    shared.file.parent.mkdir()
    with shared.file.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        shared.change("a", 1)
        shared.close()
    assert [event.reason for event in told] == [f"another program holds {lock.name}"]
    shared.change("b", 2)
    shared.close()
    assert shared.read() == {"a": 1, "b": 2}


def test_what_could_not_be_written_is_tried_again_until_it_can(shared, told, monkeypatch) -> None:
    monkeypatch.setattr(shared_file, "FIRST_PAUSE", 0.02)
    shared.file.parent.write_text("a file where a folder is wanted")
    shared.change("a", 1)
    shared.change("b", 1)
    while not told:
        time.sleep(0.01)
    time.sleep(0.1)
    shared.change("b", 2)
    shared.file.parent.unlink()
    while len(told) < 2:
        time.sleep(0.01)
    assert told == [StateNotKept(str(shared.file), "File exists"), StateKeptAgain(str(shared.file))]
    shared.close()
    assert shared.read() == {"a": 1, "b": 2}


def test_at_the_end_it_is_tried_once_more(shared, told) -> None:
    shared.file.parent.write_text("a file where a folder is wanted")
    shared.change("a", 1)
    while not told:
        time.sleep(0.01)
    shared.file.parent.unlink()
    shared.close()
    assert shared.read() == {"a": 1}


def test_what_another_gateway_has_mended_meanwhile_stays(shared, told, monkeypatch) -> None:
    shared.file.parent.mkdir()
    shared.file.write_text("{")
    lock = shared_file._lock

    @contextmanager
    def locked_late(file):
        with lock(file):
            file.write_text('{"of-another": 2}')
            yield

    monkeypatch.setattr(shared_file, "_lock", locked_late)
    assert shared.read() == {"of-another": 2}
    assert told == []


def test_whatever_goes_wrong_later_changes_are_written(tmp_path, told) -> None:
    def is_entry(entry: object) -> bool:
        return 1 / entry > 0

    shared = SharedFile(tmp_path / "entries.json", is_entry, told.append)
    shared.file.write_text('{"a": 0}')
    shared.change("b", 1)
    while not told:
        time.sleep(0.01)
    shared.file.unlink()
    shared.change("c", 2)
    shared.close()
    assert shared.read() == {"b": 1, "c": 2}


@pytest.mark.parametrize("name", ["entries.lock", "entries.json.new"])
def test_no_link_is_followed(shared, told, tmp_path, name) -> None:
    precious = tmp_path / "precious"
    precious.write_text("not to be touched")
    shared.file.parent.mkdir()
    (shared.file.parent / name).symlink_to(precious)
    shared.change("a", 1)
    shared.close()
    assert precious.read_text() == "not to be touched"
    is_lock = name.endswith(".lock")
    assert [event.reason for event in told] == (
        [f"{shared.file.parent / name} is a symbolic link, which is not followed; remove it"] if is_lock else []
    )


def test_a_file_that_is_damaged_meanwhile_is_moved_aside_and_written_anew(shared, told) -> None:
    shared.change("a", 1)
    shared.close()
    shared.file.write_text("{")
    shared.change("b", 2)
    shared.close()
    assert [type(event) for event in told] == [StateDamaged]
    assert shared.read() == {"a": 1, "b": 2}


@pytest.mark.parametrize("name", ["entries.json", "entries.lock"])
def test_a_pipe_in_place_of_a_file_holds_nothing_up(shared, told, name) -> None:
    shared.file.parent.mkdir()
    os.mkfifo(shared.file.parent / name)
    assert shared.read() == {}
    shared.change("a", 1)
    shared.close()
    assert told


def test_any_bit_that_turns_is_told_or_harmless(tmp_path) -> None:
    """Keys that differ in one bit only, too."""
    file = tmp_path / "entries.json"
    entries = {f"/dev/ttyS1 silo-{number}": {"configured": number, "now": 5.25} for number in (1, 3, 5)}

    def is_entry(entry: object) -> bool:
        return isinstance(entry, dict) and entry.keys() == {"configured", "now"}

    shared = SharedFile(file, is_entry, lambda event: None)
    for key, entry in entries.items():
        shared.change(key, entry)
    shared.close()
    good = file.read_bytes()
    for at in range(8 * len(good)):
        file.write_bytes(good[: at // 8] + bytes((good[at // 8] ^ 1 << at % 8,)) + good[at // 8 + 1 :])
        content = shared_file.read_content(file, is_entry)
        assert content.entries == entries  # from the copy, if need be
    shared_file._copy_of(file).unlink()
    for at in range(8 * len(good)):
        file.write_bytes(good[: at // 8] + bytes((good[at // 8] ^ 1 << at % 8,)) + good[at // 8 + 1 :])
        content = shared_file.read_content(file, is_entry)
        assert content.damage or content.entries == entries
        assert content.entries.items() <= entries.items()


def test_what_is_left_of_a_file_and_its_copy_is_used_together(tmp_path) -> None:
    file, copy = tmp_path / "entries.json", tmp_path / "entries.json.copy"
    file.write_text('{"a": 1, "b": "damaged"}')
    copy.write_text('{"a": "damaged", "b": 2}')
    content = shared_file.read_content(file, lambda entry: isinstance(entry, int))
    assert content == shared_file.Content({"a": 1, "b": 2}, "1 of 2 entries are not valid")


def test_a_copy_is_no_file_that_was_deleted(shared) -> None:
    shared.change("a", 1)
    shared.close()
    shared.file.unlink()
    assert shared.read() == {}


def test_a_file_of_an_earlier_version_has_no_checksums(tmp_path) -> None:
    file = tmp_path / "entries.json"
    file.write_text('{"a": 1}')
    assert shared_file.read_content(file, lambda entry: entry == 1) == shared_file.Content({"a": 1})


def test_an_entry_may_be_taken_out_by_hand(shared, told) -> None:
    shared.change("a", 1)
    shared.change("b", 2)
    shared.close()
    content = json.loads(shared.file.read_text())
    del content["a"]
    shared.file.write_text(json.dumps(content))
    assert shared.read() == {"b": 2}
    assert told == []
