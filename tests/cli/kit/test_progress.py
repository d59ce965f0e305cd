"""How far a long command is, as its terminal shows it."""

import io
from pathlib import Path
from typing import Self

import pytest

from gateway.cli.kit.progress import progress
from gateway.cli.main import FINE, main
from gateway.cli.verbs import bench

RESULT = {
    "line": "hall",
    "reads": [{"unit": 41, "name": "silo", "area": "holding", "address": 0, "items": 10, "line_time_ms": 30.0}],
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


class FakeGateway:
    """Stands in for `Conversation`: it tells twice how far a measurement is, then its result."""

    def __init__(self) -> None:
        self._steps = [{"progress": {"elapsed_s": at, "reads": 30 * at}} for at in (1, 2)] + [{"bench": RESULT}]

    def __call__(self, _gateway: Path) -> "FakeGateway":
        return self

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def wait_for(self, seconds: float) -> None:
        assert seconds > 2

    def ask(self, verb: str, **details: object) -> dict[str, object]:
        assert (verb, details["progress"]) == ("bench", True)
        return self.next_answer()

    def next_answer(self) -> dict[str, object]:
        return self._steps.pop(0)


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
    monkeypatch.setattr(bench, "Conversation", FakeGateway())
    monkeypatch.setattr("gateway.cli.kit.progress._EVERY", 0.0)
    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    assert main(["bench", "hall", "--for", "2s"]) == FINE
    assert terminal.getvalue().startswith("\r1 of 2 s, 30 reads\r2 of 2 s, 60 reads\r")
    assert "60 reads in 2 s: 60 answered" in capsys.readouterr().out


def test_what_is_no_terminal_gets_no_progress(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(bench, "Conversation", FakeGateway())
    assert main(["bench", "hall", "--for", "2s"]) == FINE
    assert capsys.readouterr().err == ""
