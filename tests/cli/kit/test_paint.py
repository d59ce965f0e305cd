"""Colour on a terminal, and where there is none; the width of text in cells."""

import io
import sys

import pytest

from gateway.cli.kit.cells import cut, padded, width_of, wrapped
from gateway.cli.kit.columns import Table, align, narrow
from gateway.cli.kit.paint import badness, dim, escaped, for_terminal, plain, red, yellow
from gateway.cli.kit.terminal import no_control_characters
from gateway.cli.main import PROBLEM_FOUND, WRONG_USAGE, main


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def printed(monkeypatch: pytest.MonkeyPatch, stream: io.StringIO, colour: str, **environment: str) -> str:
    """What a stream gets of a painted word."""
    monkeypatch.setattr(sys, "stdout", stream)
    with no_control_characters(colour, {"TERM": "xterm"} | environment):
        sys.stdout.write(red("down") + "\x1b[5m\n")
    return stream.getvalue()


COLOURED = "\x1b[31mdown\x1b[0m\\x1b[5m\n"
PLAIN = "down\\x1b[5m\n"


@pytest.mark.parametrize(
    ("stream", "colour", "environment", "shown"),
    [
        (Terminal, "auto", {}, COLOURED),
        (Terminal, "auto", {"NO_COLOR": "1"}, PLAIN),
        (Terminal, "auto", {"NO_COLOR": ""}, COLOURED),
        (Terminal, "auto", {"TERM": "dumb"}, PLAIN),
        (Terminal, "auto", {"TERM": ""}, PLAIN),
        (Terminal, "never", {}, PLAIN),
        (Terminal, "always", {"NO_COLOR": "1"}, COLOURED),
        (io.StringIO, "auto", {}, PLAIN),
        (io.StringIO, "always", {}, COLOURED),
    ],
)
def test_there_is_colour_on_a_terminal_only_and_where_it_is_welcome(
    monkeypatch: pytest.MonkeyPatch, stream, colour, environment, shown
) -> None:
    assert printed(monkeypatch, stream(), colour, **environment) == shown


def test_an_error_is_red_on_request(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["status", "--control", "/none", "--color", "always"]) == PROBLEM_FOUND
    assert capsys.readouterr().err.startswith("modbus-gateway: \x1b[31merror\x1b[0m: no running gateway found")
    assert main(["status", "--control", "/none"]) == PROBLEM_FOUND
    assert capsys.readouterr().err.startswith("modbus-gateway: error: no running gateway found")
    with pytest.raises(SystemExit) as end:
        main(["status", "--color", "green"])
    assert end.value.code == WRONG_USAGE


def test_nobody_elses_text_is_paint() -> None:
    forged = "\x1b[31mdown\x1b[0m\x1b123456m"
    assert plain(forged) == forged
    assert for_terminal(forged, has_colour=True) == r"\x1b[31mdown\x1b[0m\x1b123456m"
    assert escaped(red("a\x07")) == red(r"a\x07")


def test_width_is_that_of_what_is_seen() -> None:
    assert [width_of(text) for text in ("abc", red("abc"), "宽", "e\u0301", "")] == [3, 3, 2, 1, 0]
    assert padded(red("ab"), 4) == red("ab") + "  "
    assert plain(cut(f"1{red('宽')}2e\u03013", 4)) == "1宽2"
    assert plain(cut("1宽2", 2)) == "1 "
    assert cut("1宽2", 2, 2) == " 2"
    assert cut("e\u0301x", 1) == "e\u0301"
    assert badness(cut(red("abc"), 1, 1)) == 2


@pytest.mark.parametrize("width", [10, 11, 20, 80])
def test_text_is_broken_into_lines_that_are_not_too_long(width: int) -> None:
    text = f"{red('line')}: /dev/serial/by-id/usb-{12 * '宽'} is not there, is the adapter plugged in?"
    lines = wrapped(text, width, "  ", "    ")
    assert max(map(width_of, lines)) <= width
    assert "".join("".join(plain(line).split()) for line in lines) == "".join(plain(text).split())
    assert all(line.startswith("    ") for line in lines[1:])


def test_columns_are_aligned_whatever_is_painted_or_wide() -> None:
    rows = [("A", "B"), (red("down"), "x"), ("宽宽宽", "y")]
    assert plain(align(rows)).splitlines() == ["A       B", "down    x", "宽宽宽  y"]
    [_, [long, _]] = narrow([("A", "B"), (20 * "宽", "y")], [0], 15)
    assert width_of(long) <= 12
    assert "\u2026" in long


def test_rows_in_red_and_yellow_stand_above_the_others() -> None:
    paints = {"a": str, "b": yellow, "c": dim, "d": red, "e": red}
    table = Table[str, str]("T", lambda whole: whole, {"N": lambda name: name, "STATE": lambda name: paints[name]("s")})
    assert plain(table.show("abcde", 80)).split()[3::2] == ["d", "e", "b", "a", "c"]
