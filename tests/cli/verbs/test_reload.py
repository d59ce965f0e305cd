"""`reload`: what it prints of the daemon's answer."""

import json
from pathlib import Path

import pytest

from gateway.cli.main import FINE, PROBLEM_FOUND, main

NOTHING = {"problems": [], "added": [], "removed": [], "changed": [], "restart": [], "warnings": [], "defect": ""}


class FakeGateway:
    """Stands in for `Conversation`: it gives this answer."""

    gateway = Path("/run/gw.sock")

    def __init__(self, answer):
        self._answer = answer

    def __call__(self, gateway):
        return self

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def ask(self, verb):
        return self._answer


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
    monkeypatch.setattr("gateway.cli.verbs.reload.Conversation", FakeGateway(NOTHING | answer))
    assert main(["reload"]) == status
    assert capsys.readouterr().out.splitlines() == text


@pytest.mark.parametrize(
    ("answer", "status", "text"),
    [
        (
            {"ok": True, "added": ["line a"], "moved": ["line b"]},  # an older or a newer daemon's
            FINE,
            ["new: line a", "gone: unknown", "changed: unknown", "takes effect after a restart: unknown"],
        ),
        ({"ok": True, **NOTHING, "added": 3}, FINE, ["new: unknown"]),
        ({"problems": ["p"]}, PROBLEM_FOUND, ["p", "the file was rejected; the running config is unchanged"]),
    ],
)
def test_what_a_daemon_of_another_version_does_not_tell_is_unknown(monkeypatch, capsys, answer, status, text) -> None:
    monkeypatch.setattr("gateway.cli.verbs.reload.Conversation", FakeGateway(answer))
    assert main(["reload"]) == status
    assert capsys.readouterr().out.splitlines() == text


def test_it_says_which_gateway_it_has_reloaded(monkeypatch, capsys) -> None:
    monkeypatch.setattr("gateway.cli.verbs.reload.Conversation", FakeGateway({"ok": True, **NOTHING}))
    main(["reload"])
    assert capsys.readouterr().err == "through /run/gw.sock\n"
    main(["reload", "--json"])
    assert json.loads(capsys.readouterr().out)["through"] == "/run/gw.sock"
