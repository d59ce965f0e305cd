"""`forget`: what it prints of the daemon's answer."""

import json

import pytest

from gateway.cli.main import FINE, PROBLEM_FOUND, main
from kit.control import FakeConversation, telling

FORGOTTEN = {"line": "hall-a", "device": "silo-1", "unit": 1, "was_at": [5], "baud": 9600, "was_baud": 9600}


@pytest.fixture
def daemon(monkeypatch: pytest.MonkeyPatch) -> FakeConversation:
    """A gateway that tells FORGOTTEN."""
    daemon = telling({"forgotten": FORGOTTEN})
    monkeypatch.setattr("gateway.cli.verbs.forget.Conversation", daemon)
    return daemon


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
def test_what_is_printed(monkeypatch, capsys, changes, text) -> None:
    daemon = telling({"forgotten": FORGOTTEN | changes})
    monkeypatch.setattr("gateway.cli.verbs.forget.Conversation", daemon)
    assert main(["forget", "silo-1"]) == FINE
    assert daemon.questions == [{"verb": "forget", "device": "silo-1"}]
    printed = capsys.readouterr()
    assert printed.out.splitlines() == text
    assert printed.err == "through /run/gw.sock\n"


def test_a_device_can_be_named_by_its_number(daemon, capsys) -> None:
    assert main(["forget", "41", "--json"]) == FINE
    assert daemon.questions == [{"verb": "forget", "device": 41}]
    assert json.loads(capsys.readouterr().out)["forgotten"] == FORGOTTEN


def test_without_a_gateway_it_fails(tmp_path, capsys) -> None:
    assert main(["forget", "silo-1", "--control", str(tmp_path / "none.sock")]) == PROBLEM_FOUND
    assert "none.sock" in capsys.readouterr().err
