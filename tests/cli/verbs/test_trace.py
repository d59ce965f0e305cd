"""`trace`: what is said when there is no story, and which records are asked for."""

from gateway.cli.main import FINE, PROBLEM_FOUND, main
from gateway.cli.verbs import trace


class Daemon:
    """A gateway in which nothing has failed."""

    def __call__(self, control):
        return self

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def ask(self, verb, **_details):
        assert verb == "why"
        return {"stories": []}


def test_that_nothing_has_failed_is_said(monkeypatch, capsys):
    monkeypatch.setattr(trace, "Conversation", Daemon())
    assert main(["trace", "--why", "silo"]) == PROBLEM_FOUND
    said = "no failed request of or to silo is in memory; no other request has failed either\n"
    assert capsys.readouterr().err == said


class Following(Daemon):
    """A gateway that has told its lines, and has one record on each page. `asked` is what was asked for then."""

    def __init__(self):
        self.asked = []

    def ask(self, verb, *, lines=False, **details):
        if lines:
            return {"lines": []}
        self.asked.append(details)
        fact = {"kind": "port", "time": 0.0, "line": "hall", "reason": ""}
        return {"facts": [fact], "next": len(self.asked), "is_all": False}


def test_a_count_is_of_the_next_requests_and_not_of_old_ones(monkeypatch, capsys):
    daemon = Following()
    monkeypatch.setattr(trace, "Conversation", daemon)
    assert main(["trace", "-n", "2"]) == FINE
    assert daemon.asked == [{"since": 0.0}, {"after": 1}]
    assert len(capsys.readouterr().out.splitlines()) == 2
