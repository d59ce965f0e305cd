"""What `-w` shows on the whole screen of a terminal of 80 columns and 24 rows, and what keys do."""

import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from kit.terminal import Terminal

#: Watches what is in a file: a line `wrong: ...` is wrong, `part: ...` can be chosen; without the file it cannot look.
PROGRAM = """
import sys
from pathlib import Path
from gateway.cli.kit import watching
from gateway.cli.kit.paint import red
from gateway.cli.kit.terminal import no_control_characters
from gateway.errors import DaemonError

watching.EVERY = float(sys.argv[2])

def look():
    try:
        return Path(sys.argv[1]).read_text().splitlines()
    except OSError:
        raise DaemonError("no running gateway found") from None

def show(seen, width, part):
    if "defect" in seen:
        raise RuntimeError("a defect")
    parts = [line[6:] for line in seen if line.startswith("part: ")]
    wrong = [red(line) for line in seen if line.startswith("wrong: ")]
    lines = [line for line in seen if not line.startswith(("wrong: ", "part: ")) and part in line]
    return watching.Screen([f"{width} wide", *lines], wrong, parts)

with no_control_characters():
    watching.watch(look, show)
"""

LINES = [f"line {number}" for number in range(1, 61)]


@pytest.fixture
def seen(tmp_path: Path) -> Path:
    file = tmp_path / "seen"
    file.write_text("\n".join(["wrong: plc is down", *LINES]))
    return file


@pytest.fixture
def terminal(seen: Path) -> Iterator[Terminal]:
    with Terminal(["-c", PROGRAM, str(seen), "0.05"]) as terminal:
        terminal.wait_for("q end")
        yield terminal


def test_what_is_wrong_stays_while_the_rest_is_scrolled(terminal: Terminal) -> None:
    assert terminal.screen.rows[:4] == ["wrong: plc is down", "", "80 wide", "line 1"]
    assert terminal.screen.colours("wrong: plc is down") == {"31"}
    assert "1-21 of 61" in terminal.screen.rows[23]
    terminal.press("j\x1b[B")
    terminal.wait_for("3-23 of 61")
    assert terminal.screen.rows[:3] == ["wrong: plc is down", "", "line 2"]
    terminal.press("\x1b[6~")
    terminal.wait_for("23-43 of 61")
    terminal.press("G")
    terminal.wait_for("line 60")
    terminal.press("k\x1bOA")
    assert "39-59 of 61" in terminal.wait_for("39-")
    terminal.press("\x1b[H")
    terminal.wait_for("80 wide")


def test_more_wrong_than_there_is_room_for_is_scrolled_too(terminal: Terminal, seen: Path) -> None:
    seen.write_text("\n".join([*(f"wrong: unit {number}" for number in range(40)), *LINES]))
    terminal.wait_for("1-23 of 102")
    terminal.press(" ")
    terminal.wait_for("wrong: unit 39")


def test_what_a_key_asks_for_stands_above_more_wrong_than_there_is_room_for(terminal: Terminal, seen: Path) -> None:
    seen.write_text("\n".join([*(f"wrong: unit {number}" for number in range(40)), *LINES, "part: line 7"]))
    terminal.wait_for("1-23 of 102")
    terminal.press("?")
    terminal.wait_for("see only the part with this number")
    terminal.press("\x1b")
    terminal.wait_for("1-23 of 102")
    terminal.press("\r")
    assert terminal.wait_for("  1  line 7").splitlines()[0].strip() == "1  line 7"
    terminal.press("\r")
    assert terminal.wait_for("only line 7").splitlines()[:4] == ["80 wide", "line 7", "", "wrong: unit 0"]
    terminal.press("G")
    terminal.wait_for("wrong: unit 39")


def test_a_wide_row_is_seen_sideways_and_whole_characters_are_cut(terminal: Terminal, seen: Path) -> None:
    seen.write_text("0123456" + 40 * "宽" + "end")
    terminal.wait_for("宽")
    assert terminal.screen.rows[1] == "0123456" + 36 * "宽" + ">"
    terminal.press("l")
    terminal.wait_for("<宽")
    terminal.press("\x1b[C")
    terminal.wait_for("end")
    terminal.press("hh")
    terminal.wait_for("0123")


def test_a_part_is_chosen_by_its_number_or_in_a_list(terminal: Terminal, seen: Path) -> None:
    seen.write_text("\n".join([*LINES, *(f"part: line {number}" for number in range(10, 40))]))
    terminal.wait_for("enter choose")
    terminal.press("3")
    assert terminal.wait_for("only line 12").splitlines()[:3] == ["80 wide", "line 12", ""]
    terminal.press("\x1b")
    terminal.wait_for("line 20")
    terminal.press("\r")
    terminal.wait_for("  3  line 12")
    assert terminal.screen.colours("line 12") == {"7"}
    terminal.press("G")
    terminal.wait_for(" 30  line 39")
    terminal.press("k\r")
    terminal.wait_for("only line 38")
    seen.write_text("\n".join([*LINES, "part: line 10"]))
    terminal.wait_for("line 20")
    assert "only" not in terminal.screen.text


def test_the_keys_are_explained(terminal: Terminal) -> None:
    terminal.press("?")
    terminal.wait_for("see only the part with this number")
    terminal.press("\x1b")
    terminal.wait_for("line 1")


def test_another_size_is_another_screen_at_once(seen: Path) -> None:
    with Terminal(["-c", PROGRAM, str(seen), "1000"]) as terminal:
        terminal.wait_for("q end")
        terminal.resize(60, 10)
        assert "1-7 of 61" in terminal.wait_for("60 wide")
        assert terminal.screen.rows[0] == "wrong: plc is down"
        terminal.resize(20, 2)
        terminal.wait_for("wrong: plc is down")


def test_a_gateway_that_has_gone_is_told_and_looked_for_again(terminal: Terminal, seen: Path) -> None:
    text = seen.read_text()
    seen.unlink()
    assert "wrong: plc is down" in terminal.wait_for("no running gateway found; it is tried again")
    seen.write_text(text.replace("plc is", "all are"))
    assert "no running" not in terminal.wait_for("wrong: all are down")


@pytest.mark.parametrize(
    ("end", "code"),
    [
        (lambda terminal: terminal.press("q"), 0),
        (lambda terminal: terminal.press("\x03"), -signal.SIGINT),
        (lambda terminal: terminal.end(), 143),
        (lambda terminal: terminal.end(signal.SIGHUP), 129),
        (lambda terminal: terminal.press("\x1c"), 131),
    ],
    ids=["q", "Ctrl-C", "SIGTERM", "SIGHUP", "Ctrl-\\"],
)
def test_the_terminal_is_as_before_afterwards(terminal: Terminal, end, code) -> None:
    assert not terminal.is_as_before
    end(terminal)
    assert terminal.wait_for_end() == code
    assert terminal.is_as_before


def test_it_is_as_before_after_a_defect_too(terminal: Terminal, seen: Path) -> None:
    seen.write_text("defect")
    assert terminal.wait_for_end() == 1
    assert terminal.is_as_before
    assert "RuntimeError: a defect" in terminal.screen.text


def test_control_characters_are_escaped_and_no_colour_is_anybody_elses(terminal: Terminal, seen: Path) -> None:
    seen.write_text("a\x1b[31mb\x1b[2Jc")
    assert r"a\x1b[31mb\x1b[2Jc" in terminal.wait_for("2Jc")


def test_without_a_gateway_at_the_first_look_there_is_no_screen(tmp_path: Path) -> None:
    with Terminal(["-c", PROGRAM, str(tmp_path / "none"), "1"]) as terminal:
        assert terminal.wait_for_end() == 1
        assert "DaemonError: no running gateway found" in terminal.screen.text


def test_a_terminal_without_codes_gets_screen_after_screen(seen: Path) -> None:
    seen.write_text("wrong: plc is down\nfine")
    with Terminal(["-c", PROGRAM, str(seen), "0.05"], TERM="dumb") as terminal:
        terminal.wait_for("wrong: plc is down\n80 wide\nfine\n\nwrong: plc is down\n80 wide\nfine")
        assert terminal.screen.colours("wrong") == {""}
