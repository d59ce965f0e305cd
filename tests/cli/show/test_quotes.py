"""Problems of a config, with the line that is wrong and a caret below the place."""

from pathlib import Path

import pytest

from gateway.cli.kit.paint import badness, plain
from gateway.cli.show.quotes import Quotes
from gateway.config.problem import Problem

PROBLEM = Problem("error", ("line", 0, "baud"), "is wrong", "write another", file="g.toml")


def told(line: str, column: int, width: int = 80, number: int = 1) -> str:
    """What is said of a problem in this column of the line, in a file with this one at the end."""
    text = (number - 1) * "\n" + line + "\n"
    return plain(Quotes("g.toml", text, width).told(PROBLEM.located("g.toml", number, column)))


def test_the_line_and_a_caret_stand_between_the_problem_and_its_help() -> None:
    assert told('baud = "fast"', 8, number=12) == (
        'g.toml:12:8: error: line[0].baud: is wrong\n   12 | baud = "fast"\n      |        ^'.replace(
            "      |", "      |"
        )
        + "\n  help: write another"
    )


@pytest.mark.parametrize(
    ("line", "column", "shown", "caret"),
    [
        ("\t\tbaud = 1", 10, "        baud = 1", "               ^"),
        ('name = "宽宽", x', 13, 'name = "宽宽", x', "              ^"),
        ('name = "\x1b[31m", x', 15, r'name = "\x1b[31m", x', "                 ^"),
        ("e\u0301 = 1", 6, "e\u0301 = 1", "    ^"),
        ("baud = ", 8, "baud =", "       ^"),
    ],
    ids=["tabs", "wide", "control", "accent", "end"],
)
def test_the_caret_stands_below_its_place(line: str, column: int, shown: str, caret: str) -> None:
    rows = told(line, column, number=2).splitlines()
    assert rows[1:3] == [f"    2 | {shown}", f"      | {caret}"]


@pytest.mark.parametrize("column", [1, 20, 100, 250, 400])
@pytest.mark.parametrize("filling", ["x", "宽"])
def test_a_long_line_is_cut_around_the_place(column: int, filling: str) -> None:
    line = (column - 1) * filling + "!" + (400 - column) * filling
    _, quoted, below, _ = told(line, column, number=2).splitlines()
    width = {"x": 1, "宽": 2}[filling]
    assert len(quoted) <= 80 + 1
    cells = [each for each in quoted for _ in range(width if each == filling else 1)]
    assert len(cells) <= 79
    assert cells[below.index("^")] == "!"
    assert ("…" in quoted[:9]) == (column * width > 60)


def test_what_has_no_place_in_the_file_has_no_line() -> None:
    assert told("[[listen]]", 1) == "g.toml:1:1: error: line[0].baud: is wrong\n  help: write another"
    assert "[[line]]" in told("[[line]]", 1)
    assert told("anything", 3, number=0) == "g.toml: error: line[0].baud: is wrong\n  help: write another"


def test_a_line_with_a_secret_is_not_shown() -> None:
    assert "hunter2" not in told('password = "hunter2"', 12, number=3)


def test_a_problem_in_another_file_has_the_line_of_that_file(tmp_path: Path) -> None:
    other = tmp_path / "scale.toml"
    other.write_text("[profile.scale]\nbroken = 1\n")
    quotes = Quotes("g.toml", "[[line]]\n", 80)
    assert "    2 | broken = 1" in plain(quotes.told(PROBLEM.located(str(other), 2, 1)))
    assert "|" not in plain(quotes.told(PROBLEM.located(str(tmp_path / "none"), 2, 1)))


def test_errors_are_red_and_warnings_yellow() -> None:
    quotes = Quotes("g.toml", "baud = 1", 80)
    assert badness(quotes.told(PROBLEM)) == 2
    assert badness(quotes.told(Problem("warning", ("baud",), "is doubtful", file="g.toml"))) == 1
