"""`trace --why`: what is said when there is no story."""

from gateway.cli import trace
from gateway.cli.main import PROBLEM_FOUND, main


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
