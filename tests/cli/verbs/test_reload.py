"""`reload`: what it prints of the daemon's answer."""

import json

import pytest

from gateway.cli.main import FINE, PROBLEM_FOUND, main
from kit.control import telling

NOTHING = {"problems": [], "added": [], "removed": [], "changed": [], "restart": [], "warnings": [], "defect": ""}


@pytest.mark.parametrize(
    ("answer", "status", "text"),
    [
        ({"ok": True}, FINE, ["nothing has changed"]),
        ({"ok": True, "file": "/home/eng/my.toml"}, FINE, ["nothing has changed in /home/eng/my.toml"]),
        (
            {"ok": True, "added": ["line a"], "removed": ["line b", "line c"], "warnings": ["x"]},
            FINE,
            ["new: line a", "gone: line b, line c", "x"],
        ),
        (
            {"ok": False, "problems": ["p"]},
            PROBLEM_FOUND,
            ["p", "the file was rejected; the running config is unchanged"],
        ),
        (
            {"ok": False, "added": ["line a"], "defect": "a defect"},
            PROBLEM_FOUND,
            ["new: line a", "a defect; the new config is in use"],
        ),
    ],
)
def test_what_is_printed(monkeypatch, capsys, answer, status, text) -> None:
    monkeypatch.setattr("gateway.cli.verbs.reload.Conversation", telling(NOTHING | answer))
    assert main(["reload"]) == status
    assert capsys.readouterr().out.splitlines() == text


def test_what_a_daemon_of_another_version_does_not_tell_is_left_out(monkeypatch, capsys) -> None:
    monkeypatch.setattr("gateway.cli.verbs.reload.Conversation", telling({"added": ["line a"], "moved": ["line b"]}))
    assert main(["reload"]) == FINE
    assert capsys.readouterr().out.splitlines() == ["new: line a"]


def test_what_a_daemon_of_another_version_tells_in_another_form_is_not_understood(monkeypatch, capsys) -> None:
    monkeypatch.setattr("gateway.cli.verbs.reload.Conversation", telling({**NOTHING, "added": 3}))
    assert main(["reload"]) == PROBLEM_FOUND
    assert "the gateway's answer is not understood ('added' is not a list)" in capsys.readouterr().err


def test_it_says_which_gateway_it_has_reloaded(monkeypatch, capsys) -> None:
    monkeypatch.setattr("gateway.cli.verbs.reload.Conversation", telling({"ok": True, **NOTHING}))
    main(["reload"])
    assert capsys.readouterr().err == "through /run/gw.sock\n"
    main(["reload", "--json"])
    assert json.loads(capsys.readouterr().out)["through"] == "/run/gw.sock"
