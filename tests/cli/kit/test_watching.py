"""What `-w` shows on the whole screen of a terminal of 80 columns and 24 rows."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from kit.terminal import Terminal

#: Watches what is in a file; without the file it cannot look.
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

def show(seen, width):
    return "\\n".join([f"{width} wide", *(red(line) if line.startswith("wrong: ") else line for line in seen)])

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
        terminal.wait_for("more lines")
        yield terminal


def test_as_much_is_shown_as_there_is_room_for(terminal: Terminal, seen: Path) -> None:
    assert terminal.screen.rows[:3] == ["80 wide", "wrong: plc is down", "line 1"]
    assert terminal.screen.colours("wrong: plc is down") == {"31"}
    assert terminal.screen.rows[22:] == ["line 21", "39 more lines: a higher window, or without -w, shows them"]
    seen.write_text("\n".join(LINES[:23]))
    terminal.wait_for("line 23")
    assert "more lines" not in terminal.screen.text
    seen.write_text("fine")
    terminal.wait_for("fine")
    assert terminal.screen.rows == ["80 wide", "fine", *[""] * 22]


def test_a_wide_row_is_cut_and_no_character_in_half(terminal: Terminal, seen: Path) -> None:
    seen.write_text("0123456" + 40 * "宽" + "end")
    terminal.wait_for("宽")
    assert terminal.screen.rows[1] == "0123456" + 36 * "宽"


def test_another_size_is_another_screen(terminal: Terminal) -> None:
    terminal.resize(60, 10)
    assert "53 more lines" in terminal.wait_for("60 wide")
    terminal.resize(20, 1)
    terminal.wait_for("62 more lines")


def test_a_gateway_that_has_gone_is_told_and_looked_for_again(terminal: Terminal, seen: Path) -> None:
    text = seen.read_text()
    seen.unlink()
    assert "wrong: plc is down" in terminal.wait_for("no running gateway found; it is tried again")
    seen.write_text(text.replace("plc is", "all are"))
    assert "no running" not in terminal.wait_for("wrong: all are down")


def test_control_characters_are_escaped_and_no_colour_is_anybody_elses(terminal: Terminal, seen: Path) -> None:
    seen.write_text("a\x1b[31mb\x1b[2Jc")
    assert r"a\x1b[31mb\x1b[2Jc" in terminal.wait_for("2Jc")


def test_without_a_gateway_at_the_first_look_there_is_no_screen(tmp_path: Path) -> None:
    with Terminal(["-c", PROGRAM, str(tmp_path / "none"), "1"]) as terminal:
        assert terminal.wait_for_end() == 1
        assert "DaemonError: no running gateway found" in terminal.screen.text


def test_a_terminal_without_codes_gets_text_after_text(seen: Path) -> None:
    seen.write_text("wrong: plc is down\nfine")
    with Terminal(["-c", PROGRAM, str(seen), "0.05"], TERM="dumb") as terminal:
        terminal.wait_for("80 wide\nwrong: plc is down\nfine\n\n80 wide\nwrong: plc is down\nfine")
        assert terminal.screen.colours("wrong") == {""}
