"""`forget`: what it prints of the daemon's answer."""

import json
from pathlib import Path

import pytest

from gateway.cli.kit.daemon import Conversation
from gateway.cli.main import FINE, PROBLEM_FOUND, main

FORGOTTEN = {"line": "hall-a", "device": "silo-1", "unit": 1, "was_at": [5], "baud": 9600, "was_baud": 9600}


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> dict[str, object]:
    """What the daemon is asked, and what it answers: `answer`."""
    asked: dict[str, object] = {}

    def ask(daemon: Conversation, verb: str, **details: object) -> dict[str, object]:
        asked.update(details, verb=verb)
        return {"ok": True, **asked["answer"]}

    def begin(daemon: Conversation, meant: object) -> None:
        daemon.gateway = Path("/run/x/control.sock")

    monkeypatch.setattr(Conversation, "__init__", begin)
    monkeypatch.setattr(Conversation, "__exit__", lambda *_: None)
    monkeypatch.setattr(Conversation, "ask", ask)
    return asked


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({}, ["silo-1 is asked at 1 on hall-a, no longer at 5"]),
        ({"was_at": [1, 5]}, ["silo-1 is asked at 1 on hall-a, no longer at 1 or 5"]),
        ({"was_at": []}, ["silo-1 is asked at 1 on hall-a; it was not asked before"]),
        ({"was_at": [1]}, ["no other address was remembered of silo-1: it is asked at 1"]),
        (
            {"was_at": [1], "was_baud": 19200},
            [
                "no other address was remembered of silo-1: it is asked at 1",
                "hall-a has 9600 baud again, no longer 19200",
            ],
        ),
    ],
)
def test_what_is_printed(asked, capsys, changes, text) -> None:
    asked["answer"] = {"forgotten": FORGOTTEN | changes}
    assert main(["forget", "silo-1"]) == FINE
    assert (asked["verb"], asked["device"]) == ("forget", "silo-1")
    printed = capsys.readouterr()
    assert printed.out.splitlines() == text
    assert printed.err == "through /run/x/control.sock\n"


def test_a_device_can_be_named_by_its_number(asked, capsys) -> None:
    asked["answer"] = {"forgotten": FORGOTTEN}
    assert main(["forget", "41", "--json"]) == FINE
    assert asked["device"] == 41
    assert json.loads(capsys.readouterr().out)["forgotten"] == FORGOTTEN


def test_without_a_gateway_it_fails(tmp_path, capsys) -> None:
    assert main(["forget", "silo-1", "--control", str(tmp_path / "none.sock")]) == PROBLEM_FOUND
    assert "none.sock" in capsys.readouterr().err
