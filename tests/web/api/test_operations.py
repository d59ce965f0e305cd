"""An operation is added in one place: it is at the control socket, over HTTP, and in the document."""

from dataclasses import dataclass, replace

import pytest

from deploy.api_document import document
from gateway.control.server import carry_out
from gateway.errors import DoesNotFit, Malformed
from gateway.operator.operations.operation import Asker
from gateway.operator.operator import Operator
from gateway.operator.values.requests import AT_CONTROL
from kit.browser import web_bench
from kit.operations import REPEAT

IMAGE = '[[image]]\nunit = 200\nname = "shift"\nholding = 10\n'


@pytest.fixture
async def bench(tmp_path):
    async with web_bench(IMAGE, tmp_path, operations=(REPEAT,)) as bench:
        yield bench


async def asked(bench, **details):
    asker = Asker(AT_CONTROL, lambda: True)
    operator = Operator(bench.running, None)
    (answer,) = [each async for each in carry_out({"verb": "repeat", **details}, operator, asker, {"repeat": REPEAT})]
    return answer


async def test_it_is_at_the_control_socket(bench):
    assert await asked(bench, word="well", times=3) == {"words": ("well",) * 3, "client": "control"}
    with pytest.raises(Malformed, match='"times" must be a whole number from 1 to 9'):
        await asked(bench, word="well", times="three")
    with pytest.raises(DoesNotFit):
        await asked(bench, word="hush")


async def test_it_is_there_over_http(bench):
    page = await bench.browser().get("/api/v1/words/well?times=3")
    assert page.json == {"words": ["well"] * 3, "client": "web@127.0.0.1"}
    assert (await bench.browser().get("/api/v1/words/12")).json["words"] == ["12", "12"]
    assert (await bench.browser("10.0.0.9").get("/api/v1/words/well")).status == 401


async def test_a_short_answer_is_written_without_a_thread(bench, monkeypatch):
    monkeypatch.setattr("gateway.operator.operations.writing.ThreadPerCall", None)
    assert (await bench.browser().get("/api/v1/words/well")).json["words"] == ["well", "well"]


@pytest.mark.parametrize(
    ("path", "status", "problem"),
    [
        ("well?times=10", 400, '"times" must be a whole number from 1 to 9'),
        ("well?times=three", 400, '"times" must be a whole number from 1 to 9'),
        ("well?often=3", 400, "often: there is only times"),
        ("well?word=no", 400, "word: there is only times"),
        ("hush", 422, "hush is not said aloud"),
    ],
)
async def test_what_cannot_be_answered_is_a_problem(bench, path, status, problem):
    page = await bench.browser().get(f"/api/v1/words/{path}")
    assert (page.status, page.problem) == (status, problem)


@dataclass(frozen=True, slots=True)
class Repeated:
    """Another type with the name of one that there is."""

    words: int


def test_two_types_of_one_name_make_no_document():
    other = replace(REPEAT, name="other", path="/other/{word}", result_at=f"{__name__}:Repeated")
    with pytest.raises(ValueError, match="two types have the name Repeated"):
        document([REPEAT, other])


def test_it_is_in_the_document():
    made = document([REPEAT])
    told = made["paths"]["/api/v1/words/{word}"]["get"]
    assert told["summary"] == "Say a word again"
    assert [(each["name"], each["in"], each["required"], each["schema"]) for each in told["parameters"]] == [
        ("word", "path", True, {"type": "string"}),
        ("times", "query", False, {"type": "integer", "minimum": 1, "maximum": 9, "default": 2}),
    ]
    assert set(told["responses"]) == {"200", "400", "401", "403", "422", "429"}
    answer = told["responses"]["200"]["content"]["application/json"]["schema"]
    assert answer == {"$ref": "#/components/schemas/Repeated"}
    assert made["components"]["schemas"]["Repeated"]["required"] == ["words", "client"]
