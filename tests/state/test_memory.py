"""What is remembered over a restart, and for how long."""

import json
import os
from pathlib import Path

import pytest

from gateway.errors import StateError
from gateway.events import Event, StateDamaged, StateNotKept
from gateway.state.memory import FILE_NAME, Memory, StateFile, read_memory, state_folder

SOMEBODY = 61_184


@pytest.fixture(params=["memory", "file"])
def memory(request: pytest.FixtureRequest, tmp_path: Path):
    memory = Memory() if request.param == "memory" else StateFile(tmp_path, [].append)
    yield memory
    memory.close()


def kept(folder: Path, *values: tuple[str, int, int]) -> list[Event]:
    """Remember these values in a file; what was told meanwhile."""
    events: list[Event] = []
    file = StateFile(folder, events.append)
    for value in values:
        file.remember(*value)
    file.close()
    return events


def test_what_was_never_remembered_is_as_configured(memory: Memory) -> None:
    assert memory.recall("hall-a/silo-1", 1) == 1


def test_what_was_remembered_holds_as_long_as_the_config_says_the_same(memory: Memory) -> None:
    memory.remember("hall-a/silo-1", 1, 5)
    assert memory.recall("hall-a/silo-1", 1) == 5
    assert memory.recall("hall-a/silo-1", 7) == 7
    assert memory.recall("hall-a/silo-2", 1) == 1


def test_a_value_that_is_not_certain_is_remembered_with_the_other_possible_ones(memory: Memory) -> None:
    memory.remember("hall-a/silo-1", 1, 1, 5)
    assert memory.recall_all("hall-a/silo-1", 1) == (1, 5)
    assert memory.recall_all("hall-a/silo-1", 7) == (7,)
    memory.remember("hall-a/silo-1", 1, 5)
    assert memory.recall_all("hall-a/silo-1", 1) == (5,)


def test_other_possible_values_outlive_the_process(tmp_path: Path) -> None:
    file = StateFile(tmp_path, [].append)
    file.remember("hall-a/silo-1", 1, 1, 5, 7)
    file.close()
    again = StateFile(tmp_path, [].append)
    assert again.recall_all("hall-a/silo-1", 1) == (1, 5, 7)
    again.close()


def test_what_was_remembered_under_another_config_does_not_come_back_with_the_old_one(memory: Memory) -> None:
    memory.remember("hall-a/silo-1", 1, 5)
    memory.expect("hall-a/silo-1", 1)
    assert memory.recall("hall-a/silo-1", 1) == 5
    memory.expect("hall-a/silo-1", 7)
    assert memory.recall("hall-a/silo-1", 1) == 1


def test_a_value_that_is_again_as_configured_is_forgotten(tmp_path: Path) -> None:
    kept(tmp_path, ("hall-a", 9600, 19200), ("hall-a", 9600, 9600))
    assert json.loads((tmp_path / FILE_NAME).read_text()) == {}


def test_a_file_outlives_the_process(tmp_path: Path) -> None:
    folder = tmp_path / "not" / "there" / "yet"
    assert kept(folder, ("hall-a/silo-1", 1, 5), ("hall-a", 9600, 14400)) == []
    again = StateFile(folder, [].append)
    assert (again.recall("hall-a/silo-1", 1), again.recall("hall-a", 9600)) == (5, 14400)
    again.close()


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can make files for others")
def test_what_root_keeps_in_somebody_elses_folder_is_theirs(tmp_path: Path) -> None:
    os.chown(tmp_path, SOMEBODY, SOMEBODY)
    assert kept(tmp_path, ("hall-a", 9600, 14400)) == []
    assert {(file.stat().st_uid, file.stat().st_gid) for file in tmp_path.iterdir()} == {(SOMEBODY, SOMEBODY)}


def test_a_file_that_cannot_be_written_is_told_and_the_value_holds_for_this_run(tmp_path: Path) -> None:
    events: list[Event] = []
    memory = StateFile(tmp_path / "folder", events.append)
    (tmp_path / "folder").write_text("a file where a folder is wanted")
    memory.remember("hall-a", 9600, 19200)
    memory.close()
    assert events == [StateNotKept(str(tmp_path / "folder" / FILE_NAME), "File exists")]
    assert memory.recall("hall-a", 9600) == 19200


DAMAGED = [
    '{"hall-a": {"conf',
    "",
    "[]",
    "3",
    "[" * 100_000,
    '{"hall-a": 5}',
    '{"hall-a": {"configured": 1, "now": "x"}}',
    '{"hall-a": {"configured": 1, "now": 1' + 400 * "0" + "}}",
    '{"hall-a": {"configured": 9600, "now": -5}}',
    '{"hall-a": {"configured": 1, "now": 1, "maybe": 5}}',
    '{"hall-a": {"configured": 1, "now": 1, "maybe": [5, "x"]}}',
]


@pytest.mark.parametrize("content", DAMAGED)
def test_a_damaged_file_is_moved_aside_and_the_gateway_starts(tmp_path: Path, content: str) -> None:
    (tmp_path / FILE_NAME).write_text(content)
    events: list[Event] = []
    memory = StateFile(tmp_path, events.append)
    assert memory.recall("hall-a", 9600) == 9600
    (event,) = events
    assert isinstance(event, StateDamaged)
    aside = Path(event.damage.rpartition("it is now ")[2])
    assert aside.read_text() == content
    memory.remember("hall-a", 9600, 19200)
    memory.close()
    assert StateFile(tmp_path, events.append).recall("hall-a", 9600) == 19200
    assert len(events) == 1


def test_the_sound_entries_of_a_damaged_file_are_kept(tmp_path: Path) -> None:
    (tmp_path / FILE_NAME).write_text('{"hall-a": 5, "hall-b": {"configured": 9600, "now": 19200}}')
    events: list[Event] = []
    memory = StateFile(tmp_path, events.append)
    assert memory.recall("hall-b", 9600) == 19200
    memory.close()
    assert [type(event) for event in events] == [StateDamaged]
    assert StateFile(tmp_path, events.append).recall("hall-b", 9600) == 19200
    assert len(events) == 1


@pytest.mark.parametrize("content", DAMAGED)
def test_check_says_what_becomes_of_a_damaged_file_and_leaves_it(tmp_path: Path, content: str) -> None:
    (tmp_path / FILE_NAME).write_text(content)
    with pytest.raises(StateError, match=r"addresses\.json is damaged .*; the gateway moves it aside"):
        read_memory(tmp_path)
    assert (tmp_path / FILE_NAME).read_text() == content


@pytest.mark.parametrize(
    ("environment", "is_root", "folder"),
    [
        ({"STATE_DIRECTORY": "/var/lib/private/modbus-gateway"}, False, "/var/lib/private/modbus-gateway"),
        ({"STATE_DIRECTORY": "/a:/b"}, True, "/a"),
        ({"HOME": "/root"}, True, "/var/lib/modbus-gateway"),
        ({"XDG_STATE_HOME": "/home/eva/state"}, False, "/home/eva/state/modbus-gateway"),
        ({"HOME": "/home/eva"}, False, "/home/eva/.local/state/modbus-gateway"),
    ],
)
def test_where_state_is_kept(environment: dict[str, str], is_root: bool, folder: str) -> None:
    assert state_folder(environment, is_root=is_root) == Path(folder)


def test_gateways_that_share_a_file_change_their_own_entries_only(tmp_path: Path) -> None:
    one, other = StateFile(tmp_path, [].append), StateFile(tmp_path, [].append)
    one.remember("/dev/a silo-1", 1, 5)
    one.close()
    other.remember("/dev/b silo-2", 2, 6)
    other.close()
    again = StateFile(tmp_path, [].append)
    assert (again.recall("/dev/a silo-1", 1), again.recall("/dev/b silo-2", 2)) == (5, 6)
    again.close()
