"""`reload`: what it prints of the daemon's answer."""

import pytest

from gateway.cli.main import FINE, PROBLEM_FOUND, main

NOTHING = {"problems": [], "added": [], "removed": [], "changed": [], "restart": [], "warnings": [], "defect": ""}


@pytest.mark.parametrize(
    ("answer", "status", "text"),
    [
        ({"ok": True}, FINE, ["nothing has changed"]),
        (
            {"ok": True, "added": ["line a"], "removed": ["line b", "line c"], "warnings": ["x"]},
            FINE,
            ["new: line a", "gone: line b, line c", "x"],
        ),
        ({"ok": False, "problems": ["p"]}, PROBLEM_FOUND, ["p", "the file was rejected; the config in force stays"]),
        (
            {"ok": False, "added": ["line a"], "defect": "a defect"},
            PROBLEM_FOUND,
            ["new: line a", "a defect; the new config is in force"],
        ),
    ],
)
def test_what_is_printed(monkeypatch, capsys, answer, status, text) -> None:
    monkeypatch.setattr("gateway.cli.reload.ask", lambda verb, control: NOTHING | answer)
    assert main(["reload"]) == status
    assert capsys.readouterr().out.splitlines() == text
