"""`ask`: every operation on the command line, also one that is added in one place."""

import json
from dataclasses import dataclass
from typing import Annotated

import pytest

from gateway.cli.main import FINE, PROBLEM_FOUND, WRONG_USAGE, main
from gateway.cli.verbs import ask
from gateway.operator.operations.operation import Operation
from gateway.operator.operations.parameters import Within
from gateway.operator.operations.table import BY_NAME, OPERATIONS
from kit.control import FakeConversation, telling
from kit.operations import Told


@pytest.fixture
def daemon(monkeypatch: pytest.MonkeyPatch) -> FakeConversation:
    """A gateway that tells something in two answers, or in the first of them."""
    daemon = telling({"status": "fine", "new": 1}, {"status": "done"})
    monkeypatch.setattr(ask, "Conversation", daemon)
    return daemon


@dataclass(frozen=True, slots=True)
class Example:
    """The `who` that is meant."""

    who: Annotated[str, "a name"]
    count: Annotated[int, Within(1, 9), "1 to 9"] = 5
    share: float | None = None
    exact: bool = False


@pytest.fixture
def example(monkeypatch: pytest.MonkeyPatch) -> None:
    """An operation in the table that no command knows."""
    operation = Operation("example", Example, "kit.operations:Told", "reading", "Tell an example", by="kit.none:tell")
    monkeypatch.setitem(BY_NAME, "example", operation)


def test_all_operations_are_listed_with_what_they_must_be_told(capsys):
    assert main(["ask"]) == FINE
    parts = capsys.readouterr().out.split("\n\n")
    assert [part.split("\n")[0] for part in parts] == [each.name for each in OPERATIONS]
    assert "\n  right: reading; HTTP: GET /api/v1/status" in parts[0]
    (scan,) = (part for part in parts if part.startswith("scan\n"))
    assert scan.split("\n")[2:5] == [
        "  right: operator; several answers",
        "    line        the name of a line",
        '    units       units such as "1-32" (optional)',
    ]


@pytest.mark.usefixtures("example")
def test_an_operation_that_is_added_to_the_table_is_on_the_command_line(daemon, capsys):
    assert main(["ask"]) == FINE
    assert "\nexample\n  Tell an example\n" in capsys.readouterr().out
    assert main(["ask", "example", "who=silo-1", "--control", "x.sock", "share=0.5"]) == FINE
    assert daemon.questions == [{"verb": "example", "who": "silo-1", "count": 5, "share": 0.5, "exact": False}]
    said = capsys.readouterr()
    assert (json.loads(said.out), said.err) == ({"status": "fine", "new": 1}, "")
    assert Told("fine")


@pytest.mark.usefixtures("example")
@pytest.mark.parametrize(
    ("words", "asked"),
    [
        (["who=17"], {"who": "17"}),
        (["who=true", "count=3", "exact=true"], {"who": "true", "count": 3, "exact": True}),
        (['who="a b"', "share=1"], {"who": "a b", "share": 1}),
        (["who=a=b"], {"who": "a=b"}),
        (["who=[["], {"who": "[["}),
        (["who="], {"who": ""}),
    ],
)
def test_a_value_is_json_where_it_may_be_such_a_value_and_else_text(daemon, words, asked):
    assert main(["ask", "example", *words]) == FINE
    assert daemon.questions == [{"verb": "example", "count": 5, "exact": False, **asked}]


LISTED = "the parameters of example: who (a name), count (1 to 9, optional), share (a number or null, optional), exact "


@pytest.mark.usefixtures("example")
@pytest.mark.parametrize(
    ("words", "wrong", "remedy"),
    [
        (["exampel"], 'there is no operation "exampel"', 'did you mean "example"?'),
        (["example"], '"who" must be a name', LISTED),
        (["example", "who=a", "count=10"], '"count" must be 1 to 9', LISTED),
        (["example", "who=a", "count=few"], '"count" must be 1 to 9', LISTED),
        (["example", "who=a", "new=1"], 'example has no parameter "new"', LISTED),
        (["example", "silo"], '"silo" is not KEY=VALUE', LISTED),
        (["example", "who=a", "who=b"], '"who" is there twice', LISTED),
        (["reload", "now=1"], 'reload has no parameter "now"', "modbus-gateway ask reload"),
    ],
)
def test_what_cannot_be_meant_is_refused_with_the_parameters(daemon, capsys, words, wrong, remedy):
    assert main(["ask", *words]) == WRONG_USAGE
    said = capsys.readouterr().err
    assert said.startswith(f"modbus-gateway: error: {wrong}\n  help: {remedy}")
    assert daemon.questions == []


def test_the_result_is_printed_without_what_the_socket_adds(daemon, monkeypatch, capsys):
    monkeypatch.setattr(ask, "Conversation", telling({"times": {"unit": 1}}))
    assert main(["ask", "times", "unit=1"]) == FINE
    assert json.loads(capsys.readouterr().out) == {"unit": 1}


def test_of_several_answers_each_has_a_line(daemon, capsys):
    assert main(["ask", "scan", "line=hall", "units=1-3"]) == FINE
    said = capsys.readouterr()
    assert [json.loads(line) for line in said.out.splitlines()] == [{"status": "fine", "new": 1}, {"status": "done"}]
    assert said.err == "through /run/gw.sock\n"


def test_a_result_that_is_not_ok_is_a_problem(monkeypatch, capsys):
    monkeypatch.setattr(ask, "Conversation", telling({"ok": False, "problems": ["no"]}))
    assert main(["ask", "reload"]) == PROBLEM_FOUND
    assert json.loads(capsys.readouterr().out) == {"ok": False, "problems": ["no"]}
