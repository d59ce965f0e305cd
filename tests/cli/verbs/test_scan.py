"""What `scan` prints of a running gateway's answer."""

from gateway.cli.main import main
from gateway.cli.verbs import scan
from kit.control import telling


def scanned(monkeypatch, capsys, answer):
    """What is printed of an answer without units."""
    monkeypatch.setattr(scan, "Conversation", telling({"found": [], **answer}))
    assert main(["scan", "hall", "1-20"]) == 1
    return capsys.readouterr().out


def test_units_that_were_not_asked_are_named_and_wiring_is_no_question_where_units_answer(monkeypatch, capsys):
    assert scanned(monkeypatch, capsys, {"asked": 17, "known": "2-3, 9", "is_answered": True}) == (
        "17 of 17 units did not answer.\n\nIn the config or in use, so not asked: 2-3, 9.\n"
    )


def test_wiring_is_a_question_where_nobody_answers(monkeypatch, capsys):
    said = scanned(monkeypatch, capsys, {"asked": 17})
    assert "17 of 17 units did not answer.\n\nIf no unit of this line answers: are wiring" in said
