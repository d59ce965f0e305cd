"""Files in the state folder that several gateways may share: who changes what, and who waits for how long."""

import fcntl
import threading
import time
from pathlib import Path

import pytest

from gateway.events import StateNotKept
from gateway.service import shared_file
from gateway.service.shared_file import SharedFile


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
        began = time.monotonic()
        shared.close()
        assert time.monotonic() - began < 1.5
        assert told == [StateNotKept(str(shared.file), "the disk, or another gateway, takes too long")]
    monkeypatch.setattr(shared_file, "CLOSING_DEADLINE", 10.0)
    shared.close()
    assert shared.read() == {"a": 1}


def test_a_disk_that_hangs_is_waited_for_once_whatever_has_changed(tmp_path, told, monkeypatch) -> None:
    monkeypatch.setattr(shared_file, "CLOSING_DEADLINE", 0.5)
    released = threading.Event()
    monkeypatch.setattr("os.fsync", lambda descriptor: released.wait(10.0))
    files = [SharedFile(tmp_path / f"{number}.json", lambda entry: True, told.append) for number in range(6)]
    for file in files:
        file.change("a", 1)
    began = time.monotonic()
    for file in files:
        file.close()
    assert time.monotonic() - began < 1.5
    assert len(told) == len(files)
    released.set()
    monkeypatch.setattr(shared_file, "CLOSING_DEADLINE", 10.0)
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
    assert shared.read() == {"b": 2}
