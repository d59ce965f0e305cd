"""What lines leave behind on their ports: for the next line, process, and start of the machine."""

import json
import os
import time
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import pytest

from gateway.events import Event, StateDamaged
from gateway.lines.exchange import Exchange
from gateway.modbus.pdu import parse_sent
from gateway.ports.port import SerialSettings, TcpSettings
from gateway.runtime.overdue import FILE_NAME, LeftBehind, is_entry, place_of
from gateway.state.entry_file import EntryFile

WEEK = 7 * 86_400.0
PORT, OTHER = "/dev/ttyS1", "/dev/ttyS2"


class Open(NamedTuple):
    """What is told of an exchange."""

    unit: int
    answers_from: int | None
    pdu: str
    owed: int
    ends_at: float

    def exchange(self) -> Exchange:
        exchange = Exchange(self.unit, self.answers_from, parse_sent(bytes.fromhex(self.pdu)), 0)
        exchange.owed = self.owed
        exchange.ends_at = self.ends_at
        return exchange


READ = Open(1, 1, "03 00 07 00 01", owed=1, ends_at=103.0)
MOVE = Open(1, None, "06 01 00 00 05", owed=2, ends_at=101.5)


class Process:
    """One run of a gateway with this state folder."""

    def __init__(self, folder: Path) -> None:
        self.events: list[Event] = []
        self.left_behind = LeftBehind(EntryFile(folder / FILE_NAME, is_entry, self.events.append))

    def ends(self, now: float, *answers: Open, at: str = PORT) -> None:
        self.left_behind.leave(at, [each.exchange() for each in answers], now)
        self.left_behind.close()
        assert self.events == []


def shown(exchanges: Iterable[Exchange]) -> list[Open]:
    return [Open(each.unit, each.answers_from, each.asked.data.hex(" "), each.owed, each.ends_at) for each in exchanges]


def found(folder: Path, now: float, at: str = PORT) -> list[Open]:
    """What the next process would find."""
    return shown(Process(folder).left_behind.at(at, now))


def test_a_line_finds_what_the_one_before_it_has_left() -> None:
    left_behind = LeftBehind()
    assert left_behind.at(PORT, 90.0) == []
    left_behind.leave(PORT, [READ.exchange(), MOVE.exchange()], 100.0)
    assert left_behind.at(OTHER, 101.0) == []
    assert shown(left_behind.at(PORT, 101.0)) == [READ, MOVE]


def test_what_is_past_is_not_found() -> None:
    left_behind = LeftBehind()
    left_behind.leave(PORT, [READ.exchange(), MOVE.exchange()], 100.0)
    assert shown(left_behind.at(PORT, 102.0)) == [READ]


def test_a_line_that_has_had_its_answers_leaves_nothing() -> None:
    left_behind = LeftBehind()
    left_behind.leave(PORT, [READ.exchange()], 100.0)
    left_behind.leave(PORT, [], 101.0)
    assert left_behind.at(PORT, 101.0) == []


def test_the_next_process_finds_it(tmp_path: Path) -> None:
    Process(tmp_path).ends(100.0, READ, MOVE)
    assert found(tmp_path, 102.0) == [READ]
    Process(tmp_path).ends(110.0)
    assert json.loads((tmp_path / FILE_NAME).read_text()) == {}


def test_what_is_past_is_forgotten_when_a_line_ends(tmp_path: Path) -> None:
    process = Process(tmp_path)
    process.ends(100.0, READ, at=OTHER)
    process.ends(102.0)
    assert found(tmp_path, 102.0, at=OTHER) == [READ]
    process.ends(110.0)
    assert json.loads((tmp_path / FILE_NAME).read_text()) == {}


def test_where_nothing_is_overdue_nothing_is_written(tmp_path: Path) -> None:
    Process(tmp_path).ends(100.0)
    assert list(tmp_path.glob("late*")) == []


def test_after_a_start_of_the_machine_it_is_at_least_as_old_as_that(tmp_path: Path) -> None:
    Process(tmp_path).ends(100.0, READ, MOVE)
    assert found(tmp_path, 1.0) == [READ._replace(ends_at=3.0), MOVE._replace(ends_at=1.5)]
    assert found(tmp_path, 2.5) == [READ._replace(ends_at=3.0)]
    assert found(tmp_path, 20.0) == []


ANSWER = {"unit": 1, "answers_from": 1, "pdu": "03 00 07 00 01", "owed": 1, "ends_at": 103.0}


@pytest.mark.parametrize(
    "entry",
    [
        3,
        {},
        {"at": 1.0},
        {"answers": []},
        {"at": None, "answers": []},
        {"at": 1.0, "answers": [3]},
        {"at": 1.0, "answers": [{}]},
        {"at": 1.0, "answers": [ANSWER | {"more": 1}]},
        *(
            {"at": 1.0, "answers": [ANSWER | {key: value}]}
            for key, value in [
                ("unit", "x"), ("unit", 5000), ("unit", 1.0), ("pdu", "xy"), ("pdu", ""), ("pdu", "03 00"),
                ("answers_from", 256), ("answers_from", -1), ("answers_from", "x"), ("answers_from", []),
                ("answers_from", 1.0), ("owed", -1), ("owed", 1.5),
                ("ends_at", None), ("ends_at", 10**400), ("ends_at", float("inf")), ("ends_at", float("nan")),
            ]
        ),
    ],
)  # fmt: skip
def test_a_foreign_file_is_moved_aside(tmp_path: Path, entry: object) -> None:
    content = json.dumps({PORT: entry})
    (tmp_path / FILE_NAME).write_text(content)
    process = Process(tmp_path)
    (event,) = process.events
    assert isinstance(event, StateDamaged)
    assert event.damage.startswith("1 of 1 entries are not valid; 0 entries could be read; it is ")
    assert Path(event.damage.rpartition("it is now ")[2]).read_text() == content


@pytest.mark.parametrize("window", [48 * 3600.0, WEEK, 202 * WEEK])
def test_a_window_may_be_as_long_as_a_config_can_ask_for(tmp_path: Path, window: float) -> None:
    """A week, or twice a hundred times that: `margin` x a time of a table, and what the port adds."""
    long = READ._replace(ends_at=100.0 + window)
    Process(tmp_path).ends(100.0, long)
    assert found(tmp_path, 101.0) == [long]


def test_behind_a_damaged_file_nothing_is_awaited(tmp_path: Path) -> None:
    (tmp_path / FILE_NAME).write_text("")
    process = Process(tmp_path)
    assert [type(event) for event in process.events] == [StateDamaged]
    assert process.left_behind.at(PORT, 100.0) == []


def test_two_names_of_one_port_are_one_place_of(tmp_path: Path) -> None:
    link = tmp_path / "by-id"
    link.symlink_to("/dev/null")
    assert place_of(SerialSettings(str(link), 9600, None)) == place_of(SerialSettings("/dev/null", 19200, None))
    assert place_of(TcpSettings("rtu+tcp://Moxa:4001", "Moxa", 4001)) == place_of(TcpSettings("x", "moxa", 4001))
    assert place_of(TcpSettings("x", "moxa", 4001)) != place_of(TcpSettings("x", "moxa", 4002))


def test_a_pseudo_terminal_is_not_the_next_one_with_its_number(tmp_path: Path) -> None:
    link = tmp_path / "plc"

    def made() -> tuple[str, str]:
        ours, theirs = os.openpty()
        device = os.ttyname(theirs)
        link.unlink(missing_ok=True)
        link.symlink_to(device)
        place = place_of(SerialSettings(str(link), 9600, None))
        assert place == place_of(SerialSettings(device, 9600, None))
        os.close(ours)
        os.close(theirs)
        time.sleep(0.02)  # the kernel tells times by its ticks
        return device, place

    earlier: dict[str, str] = {}
    while True:  # others on this machine may take a number in between
        device, place = made()
        if device in earlier:
            assert place != earlier[device]
            return
        earlier[device] = place
