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


def test_kinds_and_sunspec_models_are_named(monkeypatch, capsys):
    inverter = {"unit": 5, "result": "answers", "answer_ms": 12.3, "profile": "a, b"}
    inverter["models"] = [{"model": model, "address": 40002 + model} for model in range(1, 15)]
    generic = {"unit": 4, "result": "answers", "answer_ms": 12.3, "profile": "generic"}
    plain = {"unit": 6, "result": "answers", "answer_ms": 12.3, "profile": "", "models": [{"model": 1, "address": 2}]}
    monkeypatch.setattr(scan, "Conversation", telling({"found": [generic, inverter, plain], "asked": 3}))
    assert main(["scan", "hall", "5-6"]) == 0
    told = capsys.readouterr().out
    assert "a, b; SunSpec: 1 at 40003, 2 at 40004," in told
    assert "12 at 40014, 2 more\n" in told
    assert "SunSpec: 1 at 2\n\ngeneric: it does not tell its kind." in told
    assert main(["scan", "hall", "5-6", "--json"]) == 0
    assert '"models": [\n        {\n          "model": 1,\n          "address": 2\n' in capsys.readouterr().out
