"""What is known of troubles with the state folder."""

import asyncio
import os
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from gateway.diagnosis.state import about_state_file
from gateway.events import StateDamaged, StateKeptAgain, StateNotKept, Stopped
from gateway.state import troubles as module
from gateway.state.status import StateFileStatus
from gateway.state.troubles import LOOK_EVERY, StateTroubles, why_not_writable

SOMEBODY = 61_184


def test_events_tell_what_is_wrong_until_it_is_right_and_are_handed_on(tmp_path):
    told = []
    troubles = StateTroubles(tmp_path, told.append)
    events = [
        StateNotKept("late.json", "disk full"),
        StateDamaged("images.log", "torn"),
        StateNotKept("images.log", "disk full"),
        StateKeptAgain("late.json"),
        Stopped(),
    ]
    for event in events:
        troubles.emit(event)
    assert told == events
    assert troubles.status() == (
        StateFileStatus("images.log", "not written", "disk full"),
        StateFileStatus("images.log", "damaged", "torn"),
    )


async def test_a_folder_that_nothing_can_be_written_to_any_more_is_told_and_when_it_can(tmp_path, monkeypatch):
    told, reason = [], ""
    troubles = StateTroubles(tmp_path, told.append)
    monkeypatch.setattr(module, "why_not_writable", lambda folder: reason)
    troubles.look()
    looking = asyncio.create_task(troubles.keep_looking())
    await asyncio.sleep(3 * LOOK_EVERY)
    assert told == []
    reason = "Read-only file system"
    await asyncio.sleep(3 * LOOK_EVERY)
    assert told == [StateNotKept(str(tmp_path), reason)]
    assert troubles.status() == (StateFileStatus(str(tmp_path), "not written", reason),)
    reason = ""
    await asyncio.sleep(3 * LOOK_EVERY)
    assert told[1:] == [StateKeptAgain(str(tmp_path))]
    assert troubles.status() == ()
    looking.cancel()


def test_a_folder_that_can_be_made_can_be_written_and_below_a_file_it_cannot(tmp_path):
    assert why_not_writable(tmp_path) == why_not_writable(tmp_path / "not" / "yet") == ""
    (tmp_path / "file").touch()
    assert why_not_writable(tmp_path / "file" / "state") == f"{tmp_path}/file is no folder"


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can be somebody else")
def test_a_folder_of_somebody_else_cannot_be_written():
    with TemporaryDirectory() as name:  # that of pytest lets nobody else in
        Path(name).chmod(0o755)
        os.seteuid(SOMEBODY)
        try:
            assert why_not_writable(Path(name) / "state") == f"no permission to write in {name}"
        finally:
            os.seteuid(0)


def test_what_must_be_done():
    finding = about_state_file("/var/lib/modbus-gateway", "Read-only file system", was_damaged=False)
    assert (finding.level, finding.about) == ("fix", "state")
    assert finding.what == "/var/lib/modbus-gateway cannot be written: Read-only file system"
    assert about_state_file("images.log", "1 pages are damaged", was_damaged=True).level == "note"
