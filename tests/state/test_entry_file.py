"""Files of entries in the state folder: what is written, what damage does, and who waits for how long."""

import errno
import json
import os
import threading
import time
from pathlib import Path

import pytest

from gateway.events import StateDamaged, StateKeptAgain, StateNotKept
from gateway.state import entry_file, files
from gateway.state.entry_file import EntryFile
from kit.patient_clock import PatientClock
from kit.process import PATIENCE


@pytest.fixture
def told():
    return []


@pytest.fixture
def kept(tmp_path: Path, told):
    return EntryFile(tmp_path / "deep" / "entries.json", lambda entry: isinstance(entry, int), told.append)


def test_changes_are_there_when_it_is_closed(kept, told) -> None:
    for number in range(100):
        kept.change(f"key-{number % 10}", number)
    kept.change("key-3", None)
    kept.close()
    assert kept.read() == {f"key-{number % 10}": number for number in range(90, 100) if number != 93}
    assert told == []


def test_entries_of_others_stay(kept, told) -> None:
    other = EntryFile(kept.file, lambda entry: True, told.append)
    for one in (kept, other, kept):
        one.change(str(id(one)), 1)
        one.close()
    assert kept.read() == {str(id(kept)): 1, str(id(other)): 1}


def test_a_file_that_another_gateway_writes_is_written_afterwards(kept, told, monkeypatch) -> None:
    monkeypatch.setattr(entry_file, "PAUSE", 0.02)
    with files.lock(kept.file.with_name("entries.json.lock")):
        kept.change("a", 1)
        while not told:
            time.sleep(0.001)
        assert not kept.file.exists()
    while len(told) < 2:
        time.sleep(0.001)
    assert [type(each) for each in told] == [StateNotKept, StateKeptAgain]
    assert kept.read() == {"a": 1}


def test_a_change_behind_a_close_is_written_too(kept) -> None:
    kept.change("a", 1)
    kept.close()
    kept.change("b", 2)
    kept.close()
    assert kept.read() == {"a": 1, "b": 2}


def test_a_disk_that_hangs_is_waited_for_once_whatever_has_changed(tmp_path, told, monkeypatch) -> None:
    monkeypatch.setattr(entry_file, "CLOSING_DEADLINE", 0.5)
    released = threading.Event()
    monkeypatch.setattr("os.fsync", lambda descriptor: released.wait(PATIENCE))
    files = [EntryFile(tmp_path / f"{number}.json", lambda entry: True, told.append) for number in range(20)]
    for file in files:
        file.change("a", 1)
    with PatientClock() as clock:
        for file in files:
            file.close()
        assert clock.seconds < 5.0  # of ten if each is waited for
    assert len(told) == len(files)
    released.set()
    monkeypatch.setattr(entry_file, "CLOSING_DEADLINE", PATIENCE)
    for file in files:
        file.close()
        assert file.read() == {"a": 1}


def test_what_could_not_be_written_is_tried_again_until_it_can(kept, told, monkeypatch) -> None:
    monkeypatch.setattr(entry_file, "PAUSE", 0.02)
    kept.file.parent.write_text("a file where a folder is wanted")
    kept.change("a", 1)
    kept.change("b", 1)
    while not told:
        time.sleep(0.01)
    time.sleep(0.1)
    kept.change("b", 2)
    kept.file.parent.unlink()
    while len(told) < 2:
        time.sleep(0.01)
    assert told == [StateNotKept(str(kept.file), "File exists"), StateKeptAgain(str(kept.file))]
    kept.close()
    assert kept.read() == {"a": 1, "b": 2}


def test_at_the_end_it_is_tried_once_more(kept, told) -> None:
    kept.file.parent.write_text("a file where a folder is wanted")
    kept.change("a", 1)
    while not told:
        time.sleep(0.01)
    kept.file.parent.unlink()
    kept.close()
    assert kept.read() == {"a": 1}


def test_whatever_goes_wrong_later_changes_are_written(tmp_path, told) -> None:
    def is_entry(entry: object) -> bool:
        return 1 / entry > 0

    kept = EntryFile(tmp_path / "entries.json", is_entry, told.append)
    kept.file.write_text('{"a": 0}')
    kept.change("b", 1)
    while not told:
        time.sleep(0.01)
    kept.file.unlink()
    kept.change("c", 2)
    kept.close()
    assert kept.read() == {"b": 1, "c": 2}


@pytest.mark.parametrize("name", ["entries.json.new", "entries.json.copy"])
def test_no_link_is_followed(kept, told, tmp_path, name) -> None:
    precious = tmp_path / "precious"
    precious.write_text("not to be touched")
    kept.file.parent.mkdir()
    (kept.file.parent / name).symlink_to(precious)
    kept.change("a", 1)
    kept.close()
    assert precious.read_text() == "not to be touched"
    assert told == []
    assert kept.read() == {"a": 1}


def test_a_file_that_is_damaged_meanwhile_is_moved_aside_and_written_anew(kept, told) -> None:
    kept.change("a", 1)
    kept.close()
    kept.file.write_text("{")
    kept.change("b", 2)
    kept.close()
    assert [type(event) for event in told] == [StateDamaged]
    assert kept.read() == {"a": 1, "b": 2}


def test_a_pipe_in_place_of_a_file_holds_nothing_up(kept, told) -> None:
    kept.file.parent.mkdir()
    os.mkfifo(kept.file)
    assert kept.read() == {}
    kept.change("a", 1)
    kept.close()
    assert told


def test_any_bit_that_turns_is_told_or_harmless(tmp_path) -> None:
    """Keys that differ in one bit only, too."""
    file = tmp_path / "entries.json"
    entries = {f"/dev/ttyS1 silo-{number}": {"configured": number, "now": 5.25} for number in (1, 3, 5)}

    def is_entry(entry: object) -> bool:
        return isinstance(entry, dict) and entry.keys() == {"configured", "now"}

    kept = EntryFile(file, is_entry, lambda event: None)
    for key, entry in entries.items():
        kept.change(key, entry)
    kept.close()
    good = file.read_bytes()
    for at in range(8 * len(good)):
        file.write_bytes(good[: at // 8] + bytes((good[at // 8] ^ 1 << at % 8,)) + good[at // 8 + 1 :])
        content = entry_file.read_content(file, is_entry)
        assert content.entries == entries  # from the copy, if need be
    entry_file._copy_of(file).unlink()
    for at in range(8 * len(good)):
        file.write_bytes(good[: at // 8] + bytes((good[at // 8] ^ 1 << at % 8,)) + good[at // 8 + 1 :])
        content = entry_file.read_content(file, is_entry)
        assert content.damage or content.entries == entries
        assert content.entries.items() <= entries.items()


def test_what_is_left_of_a_file_and_its_copy_is_used_together(tmp_path) -> None:
    file, copy = tmp_path / "entries.json", tmp_path / "entries.json.copy"
    file.write_text('{"a": 1, "b": "damaged"}')
    copy.write_text('{"a": "damaged", "b": 2}')
    content = entry_file.read_content(file, lambda entry: isinstance(entry, int))
    assert content == entry_file.Content({"a": 1, "b": 2}, "1 of 2 entries are not valid")


def test_a_copy_is_no_file_that_was_deleted(kept) -> None:
    kept.change("a", 1)
    kept.close()
    kept.file.unlink()
    assert kept.read() == {}


def test_a_file_of_an_earlier_version_has_no_checksums(tmp_path) -> None:
    file = tmp_path / "entries.json"
    file.write_text('{"a": 1}')
    assert entry_file.read_content(file, lambda entry: entry == 1) == entry_file.Content({"a": 1})


def test_a_file_of_the_version_before_is_read_as_it_was_written(tmp_path, told) -> None:
    file = tmp_path / "addresses.json"
    file.write_text(
        """{
  "/dev/ttyS1 silo-1": {
    "configured": 1,
    "now": 5
  },
  "/dev/ttyS1": {
    "configured": 9600,
    "now": 9600,
    "maybe": [
      19200
    ]
  },
  "check sums": {
    "/dev/ttyS1 silo-1": 190441187,
    "/dev/ttyS1": 2717343720
  }
}
"""
    )
    written = file.read_text()
    (tmp_path / "addresses.lock").touch()  # which it left
    kept = EntryFile(file, lambda entry: isinstance(entry, dict), told.append)
    assert kept.read() == {
        "/dev/ttyS1 silo-1": {"configured": 1, "now": 5},
        "/dev/ttyS1": {"configured": 9600, "now": 9600, "maybe": [19200]},
    }
    kept.change("b", {})
    kept.change("b", None)
    kept.close()
    assert told == []
    assert file.read_text() == written


def test_an_entry_may_be_taken_out_by_hand(kept, told) -> None:
    kept.change("a", 1)
    kept.change("b", 2)
    kept.close()
    content = json.loads(kept.file.read_text())
    del content["a"]
    kept.file.write_text(json.dumps(content))
    assert kept.read() == {"b": 2}
    assert told == []


def test_a_damaged_file_is_not_forgotten_while_the_disk_is_full(kept, told, monkeypatch) -> None:
    kept.change("a", 1)
    kept.close()
    kept.file.write_text("{")
    with monkeypatch.context() as full:
        full.setattr("os.fsync", _no_space)
        again = EntryFile(kept.file, lambda entry: True, told.append)
        assert again.read() == {"a": 1}
        again.close()
    assert EntryFile(kept.file, lambda entry: True, told.append).read() == {"a": 1}


def test_what_was_known_stays_when_a_damaged_file_cannot_be_written_at_first(kept, told, monkeypatch) -> None:
    monkeypatch.setattr(entry_file, "PAUSE", 0.02)
    kept.change("a", 1)
    kept.close()
    kept.file.write_text("{")
    with monkeypatch.context() as full:
        full.setattr("os.fsync", _no_space)
        kept.change("b", 2)
        while StateNotKept not in map(type, told):
            time.sleep(0.01)
        time.sleep(0.1)
    kept.close()
    assert kept.read() == {"a": 1, "b": 2}
    assert [type(event) for event in told] == [StateDamaged, StateNotKept, StateKeptAgain]
    assert len(list(kept.file.parent.glob("entries.json.2*"))) == 1


def _no_space(_: int) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
