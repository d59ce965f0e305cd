"""`trace --why`: what is said when there is no story."""

import pytest

from gateway.cli import trace
from gateway.cli.main import PROBLEM_FOUND, main


class Daemon:
    """A gateway with a line named hall on which nothing has failed."""

    def __call__(self, control):
        return self

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def ask(self, verb, **_details):
        return {"stories": []} if verb == "why" else {"lines": [{"name": "hall", "mode": "rtu"}]}


@pytest.mark.parametrize(
    ("who", "said"),
    [
        ("hall", "hall is a line; --why takes a client or a unit\n"),
        ("silo", "no failed request of or to silo is in memory; no other request has failed either\n"),
    ],
)
def test_a_line_is_neither_a_client_nor_a_unit(monkeypatch, capsys, who, said):
    monkeypatch.setattr(trace, "Conversation", Daemon())
    assert main(["trace", "--why", who]) == PROBLEM_FOUND
    assert capsys.readouterr().err == said
