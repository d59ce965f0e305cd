"""How far a long command is, as its terminal shows it."""

import io

import pytest

from gateway.cli.kit.progress import progress
from gateway.cli.main import FINE, main
from gateway.cli.verbs import bench
from kit.control import telling

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
