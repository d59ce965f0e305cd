"""What lines leave behind on their ports: for the next line, process, and start of the machine."""

import json
from pathlib import Path

import pytest

from gateway.events import Event, StateDamaged
from gateway.lines.late import Overdue
from gateway.ports.port import SerialSettings, TcpSettings
from gateway.service import overdue
from gateway.service.overdue import FILE_NAME, Aftermath, LeftBehind, is_entry, place
from gateway.service.shared_file import SharedFile

PORT, OTHER = "/dev/ttyS1", "/dev/ttyS2"
READ = Overdue(unit=1, answers_from=1, pdu=bytes.fromhex("03 00 07 00 01"), owed=1, ends_at=103.0)
MOVE = Overdue(unit=1, answers_from=None, pdu=bytes.fromhex("06 01 00 00 05"), owed=2, ends_at=101.5)
PATIENCE = 3.5


class Process:
    """One run of a gateway with this state folder."""

    def __init__(self, folder: Path) -> None:
        self.events: list[Event] = []
        self.left_behind = LeftBehind(SharedFile(folder / FILE_NAME, is_entry, self.events.append))

    def begins(self, now: float, at: str = PORT, patience: float = PATIENCE) -> Aftermath:
        return self.left_behind.begin(at, patience, now)

    def ends(self, now: float, *answers: Overdue, at: str = PORT) -> None:
        self.left_behind.end(at, answers, now)
        self.exits()

    def exits(self) -> None:
        self.left_behind.close()
        assert self.events == []


def found(folder: Path, now: float, at: str = PORT) -> Aftermath:
    """What a process would find, which then leaves the file alone."""
    process = Process(folder)
    process.left_behind._file = None
    return process.begins(now, at)


@pytest.fixture
def machine(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    """Starts the machine anew."""

    def start(boot: str) -> None:
        (tmp_path / "boot_id").write_text(boot)
        monkeypatch.setattr(overdue, "_BOOT_ID", tmp_path / "boot_id")

    start("first")
    return start


def test_a_line_finds_what_the_one_before_it_has_left(machine) -> None:
    left_behind = LeftBehind()
    assert left_behind.begin(PORT, PATIENCE, 90.0) == Aftermath()
    left_behind.end(PORT, [READ, MOVE], 100.0)
    assert left_behind.begin(OTHER, PATIENCE, 101.0) == Aftermath()
    assert left_behind.begin(PORT, PATIENCE, 101.0) == Aftermath(overdue=(READ, MOVE))
    assert left_behind.begin(PORT, PATIENCE, 101.0) == Aftermath()


def test_what_is_past_is_not_found(machine) -> None:
    left_behind = LeftBehind()
    left_behind.end(PORT, [READ, MOVE], 100.0)
    assert left_behind.begin(PORT, PATIENCE, 102.0) == Aftermath(overdue=(READ,))


def test_the_next_process_finds_it(machine, tmp_path: Path) -> None:
    Process(tmp_path).ends(100.0, READ, MOVE)
    again = Process(tmp_path)
    assert again.begins(102.0) == Aftermath(overdue=(READ,))
    again.ends(110.0)
    assert json.loads((tmp_path / FILE_NAME).read_text()) == {}


def test_after_a_start_of_the_machine_it_is_at_least_as_old_as_that(machine, tmp_path: Path) -> None:
    Process(tmp_path).ends(100.0, READ, MOVE)
    machine("second")
    assert found(tmp_path, 1.0) == Aftermath(overdue=(READ._replace(ends_at=3.0), MOVE._replace(ends_at=1.5)))
    assert found(tmp_path, 2.5) == Aftermath(overdue=(READ._replace(ends_at=3.0),))
    assert found(tmp_path, 20.0) == Aftermath()


def test_a_clock_that_has_gone_back_keeps_nothing_for_longer(machine, tmp_path: Path) -> None:
    Process(tmp_path).ends(100.0, READ)
    assert found(tmp_path, 50.0) == Aftermath(overdue=(READ._replace(ends_at=53.0),))


def test_behind_a_line_that_was_killed_nothing_is_asked_until_all_that_it_may_have_asked_is_past(
    machine, tmp_path: Path
) -> None:
    killed = Process(tmp_path)
    killed.begins(100.0)
    killed.exits()
    assert found(tmp_path, 500.0, OTHER) == Aftermath()
    again = Process(tmp_path)
    assert again.begins(500.0, patience=1.0) == Aftermath(silent_until=503.5)
    again.exits()
    assert found(tmp_path, 500.5) == Aftermath(silent_until=504.0)


def test_a_line_that_ends_while_it_must_be_silent_leaves_that_behind(machine, tmp_path: Path) -> None:
    killed = Process(tmp_path)
    killed.begins(100.0)
    killed.exits()
    again = Process(tmp_path)
    again.begins(200.0)
    again.ends(201.0)
    assert found(tmp_path, 201.5) == Aftermath(silent_until=201.5 + PATIENCE - 1.0)
    assert again.begins(201.5) == Aftermath(silent_until=201.5 + PATIENCE - 1.0)
    again.ends(201.5, READ._replace(ends_at=209.0))
    assert found(tmp_path, 202.0) == Aftermath(silent_until=209.5)
    again.begins(202.0)
    again.ends(220.0)
    assert found(tmp_path, 220.0) == Aftermath()


def test_a_line_that_is_killed_leaves_what_it_has_found_too(machine, tmp_path: Path) -> None:
    Process(tmp_path).ends(100.0, READ)
    killed = Process(tmp_path)
    killed.begins(100.5, patience=1.0)
    killed.exits()
    assert found(tmp_path, 101.0) == Aftermath(silent_until=103.5)


def test_a_machine_that_lost_its_power_has_been_up_for_a_while(machine, tmp_path: Path) -> None:
    killed = Process(tmp_path)
    killed.begins(100.0)
    killed.exits()
    machine("second")
    assert found(tmp_path, 20.0).silent_until < 20.0


def test_a_machine_without_a_boot_identifier_waits_rather_than_believes(machine, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(overdue, "_BOOT_ID", tmp_path / "nowhere")
    Process(tmp_path).ends(100.0, READ)
    assert found(tmp_path, 20.0) == Aftermath(overdue=(READ._replace(ends_at=23.0),))


ANSWER = {"unit": 1, "answers_from": 1, "pdu": "03 00 07 00 01", "owed": 1, "ends_at": 103.0}


@pytest.mark.parametrize(
    "entry",
    [
        3,
        {},
        {"boot": "a"},
        {"boot": 1, "silence": 3.0},
        {"boot": "a", "silence": "long"},
        {"boot": "a", "silence": -1},
        {"boot": "a", "at": None, "answers": []},
        {"boot": "a", "at": 1.0, "answers": [3]},
        {"boot": "a", "at": 1.0, "answers": [{}]},
        {"boot": "a", "at": 1.0, "answers": [ANSWER | {"more": 1}]},
        *(
            {"boot": "a", "at": 1.0, "answers": [ANSWER | {key: value}]}
            for key, value in [
                ("unit", "x"), ("pdu", "xy"), ("pdu", ""), ("pdu", "03 00"), ("owed", 0), ("ends_at", None),
            ]
        ),
    ],
)  # fmt: skip
def test_a_foreign_file_is_moved_aside(machine, tmp_path: Path, entry: object) -> None:
    content = json.dumps({PORT: entry})
    (tmp_path / FILE_NAME).write_text(content)
    process = Process(tmp_path)
    assert process.events == [StateDamaged(str(tmp_path / FILE_NAME), "it is not a file of this gateway")]
    assert (tmp_path / "late.damaged").read_text() == content


def test_behind_a_damaged_file_lines_begin_as_after_a_kill(machine, tmp_path: Path) -> None:
    (tmp_path / FILE_NAME).write_text("")
    process = Process(tmp_path)
    assert [type(event) for event in process.events] == [StateDamaged]
    process.events.clear()
    assert process.begins(100.0) == Aftermath(silent_until=100.0 + PATIENCE)
    process.ends(110.0)
    assert process.begins(110.0) == Aftermath()
    process.ends(111.0)
    assert found(tmp_path, 112.0) == Aftermath()


def test_two_names_of_one_port_are_one_place(tmp_path: Path) -> None:
    link = tmp_path / "by-id"
    link.symlink_to("/dev/null")
    assert place(SerialSettings(str(link), 9600, None)) == place(SerialSettings("/dev/null", 19200, None))
    assert place(TcpSettings("rtu+tcp://Moxa:4001", "Moxa", 4001)) == place(TcpSettings("x", "moxa", 4001))
    assert place(TcpSettings("x", "moxa", 4001)) != place(TcpSettings("x", "moxa", 4002))
