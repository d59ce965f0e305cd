"""What `scan` prints of a running gateway's answer."""

import pytest

from gateway.cli.main import main
from gateway.cli.verbs import scan


class FakeDaemon:
    answer = None

    def __init__(self, _):
        pass

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def wait_for(self, _):
        pass

    def ask(self, verb, **_):
        assert verb == "scan"
        return self.answer


@pytest.fixture
def daemon(monkeypatch):
    monkeypatch.setattr(scan, "Conversation", FakeDaemon)
    monkeypatch.setattr(FakeDaemon, "answer", {"found": [], "asked": 17})
    return FakeDaemon


def test_units_that_were_not_asked_are_named_and_wiring_is_no_question_where_units_answer(daemon, capsys, monkeypatch):
    monkeypatch.setattr(daemon, "answer", {"found": [], "asked": 17, "known": "2-3, 9", "is_answered": True})
    assert main(["scan", "hall", "1-20"]) == 1
    assert capsys.readouterr().out == (
        "17 of 17 units did not answer.\n\nIn the config or in use, so not asked: 2-3, 9.\n"
    )


def test_wiring_is_a_question_where_nobody_answers(daemon, capsys):
    assert main(["scan", "hall", "1-20"]) == 1
    assert "17 of 17 units did not answer.\n\nIf no unit of this line answers: are wiring" in capsys.readouterr().out
