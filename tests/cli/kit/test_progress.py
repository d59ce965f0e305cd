"""How far a long command is, as its terminal shows it."""

import io
import re
import sys
import time

import pytest

from gateway.cli.kit.progress import progress, working
from gateway.cli.main import FINE, main
from gateway.cli.verbs import bench
from kit.control import telling
from kit.process import PATIENCE

RESULT = {
    "line": "hall",
    "reads": [
        {
            "unit": 41,
            "name": "silo",
            "area": "holding",
            "address": 0,
            "items": 10,
            "line_time_ms": 30.0,
            "answer_time_known": True,
        }
    ],
    "seconds": 2.0,
    "answered": 60,
    "exceptions": 0,
    "failed": 0,
    "others": 0,
    "busy_share": 1.0,
    "last_failure": "",
    "left_out": [],
    "expected_per_second": 30.0,
    "measured_per_second": 30.0,
}


#: It is told twice how far a measurement is, then its result.
STEPS = [*({"progress": {"elapsed_s": at, "reads": 30 * at}} for at in (1, 2)), {"bench": RESULT}]


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_a_line_is_written_again_and_again_and_taken_away(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    monkeypatch.setattr("gateway.cli.kit.progress._EVERY", 0.0)
    with progress() as line:
        line.show("1 of 10")
        line.show("2")
    assert terminal.getvalue() == "\r1 of 10\r2      \r \r"


def test_bench_shows_on_a_terminal_how_far_it_is(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(bench, "Conversation", telling(*STEPS))
    monkeypatch.setattr("gateway.cli.kit.progress._EVERY", 0.0)
    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    assert main(["bench", "hall", "--for", "2s"]) == FINE
    assert terminal.getvalue().startswith("\r1 of 2 s, 30 reads\r2 of 2 s, 60 reads\r")
    assert "60 reads in 2 s: 60 answered" in capsys.readouterr().out


def test_what_is_no_terminal_gets_no_progress(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(bench, "Conversation", telling(*STEPS))
    assert main(["bench", "hall"]) == FINE
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("is_terminal", [True, False])
def test_who_waits_for_long_is_told_for_what_and_how_long(monkeypatch: pytest.MonkeyPatch, is_terminal: bool) -> None:
    terminal = Terminal() if is_terminal else io.StringIO()
    monkeypatch.setattr("sys.stderr", terminal)
    monkeypatch.setattr("gateway.cli.kit.progress._PATIENCE", 0.05)
    with working("checking gateway.toml"):
        end = time.monotonic() + PATIENCE
        while is_terminal and not terminal.getvalue() and time.monotonic() < end:
            time.sleep(0.01)
    text = terminal.getvalue()
    assert re.match(r"\rchecking gateway\.toml \.\.\. \d+ s", text) if is_terminal else text == ""
    assert text.endswith(" \r") if is_terminal else True


def test_short_work_is_not_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stderr", Terminal())
    monkeypatch.setattr("gateway.cli.kit.progress._PATIENCE", PATIENCE)
    with working("checking gateway.toml"):
        pass
    assert sys.stderr.getvalue() == ""
