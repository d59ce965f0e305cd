"""`trace`: what is said when there is no story, and which records are asked for."""

from gateway.cli.main import FINE, PROBLEM_FOUND, main
from gateway.cli.verbs import trace
from kit.control import telling


def test_that_nothing_has_failed_is_said(monkeypatch, capsys):
    monkeypatch.setattr(trace, "Conversation", telling({"stories": [], "unit": None, "clients_that_failed": []}))
    assert main(["trace", "--why", "silo"]) == PROBLEM_FOUND
    said = "no failed request of or to silo is in memory; no other request has failed either\n"
    assert capsys.readouterr().err == said


def test_a_count_is_of_the_next_requests_and_not_of_old_ones(monkeypatch, capsys):
    """The gateway has one record on each page."""
    fact = {"kind": "port", "time": 0.0, "line": "hall", "reason": ""}
    page = {"facts": [fact], "next": 1, "missed": 0, "is_all": False, "reaches_back_s": 1.0}
    daemon = telling(page)
    monkeypatch.setattr(trace, "Conversation", daemon)
    assert main(["trace", "-n", "2"]) == FINE
    _of_lines, *asked = [(each.get("after"), each.get("since")) for each in daemon.questions]
    assert asked == [(None, 0.0), (1, None)]
    assert len(capsys.readouterr().out.splitlines()) == 2
