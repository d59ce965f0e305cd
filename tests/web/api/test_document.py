"""The document of the API: made of the table of operations, and served as it was made."""

import json
import subprocess
import sys
from dataclasses import dataclass, field

from deploy.api_document import as_text, document
from deploy.api_schemas import schemas_of
from gateway.operator.operations.answers.values import IF_KNOWN
from gateway.operator.operations.table import OPERATIONS
from gateway.version import __version__
from gateway.web.api.api import DOCUMENT
from kit.browser import web_bench


def test_it_is_current():
    assert DOCUMENT.read_text(encoding="utf-8") == as_text(document()), "not current: uvx nox -s gen"


def test_it_can_be_made_as_it_says():
    made = subprocess.run([sys.executable, "-m", "deploy.api_document"], capture_output=True, check=True, text=True)
    assert made.stdout == as_text(document())


def test_it_names_nothing_that_it_does_not_have():
    made = document()
    named = {part.partition('"')[0] for part in json.dumps(made).split("#/components/schemas/")[1:]}
    assert named <= set(made["components"]["schemas"])


def test_it_has_every_operation_with_a_path():
    told = {(f"/api/v1{each.path}", each.method.lower()) for each in OPERATIONS if each.path is not None}
    assert told <= {(path, method) for path, ways in document()["paths"].items() for method in ways}


async def test_it_is_served_with_the_version_and_the_cookie(tmp_path):
    async with web_bench("[[image]]\nunit = 200\nholding = 1\n", tmp_path) as bench:
        told = (await bench.browser().get("/api/v1/openapi.json")).json
    assert told["info"].pop("version") == __version__
    assert told["components"]["securitySchemes"]["session"].pop("name") == "mbgw"
    made = document()
    del made["info"]["version"], made["components"]["securitySchemes"]["session"]["name"]
    assert told == made


@dataclass(frozen=True, slots=True)
class Thing:
    """A thing."""

    number: int
    share: float | None
    name: str = "it"
    maker: str | None = field(default=None, metadata=IF_KNOWN)


def test_a_field_that_is_told_only_if_known_may_be_missing_and_is_never_null():
    reference, made = schemas_of(Thing)
    assert reference == {"$ref": "#/components/schemas/Thing"}
    assert made["Thing"] == {
        "type": "object",
        "description": "A thing.",
        "properties": {
            "number": {"type": "integer"},
            "share": {"anyOf": [{"type": "number"}, {"type": "null"}]},
            "name": {"type": "string"},
            "maker": {"type": "string"},
        },
        "required": ["number", "share", "name"],
        "additionalProperties": False,
    }
