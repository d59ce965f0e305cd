"""The schema for editors takes what `check` takes, and marks what is usually wrong."""

import json
import tomllib
from pathlib import Path

import jsonschema_rs
import pytest
from hypothesis import given, settings

from deploy.reference import EXAMPLE, SMALLEST
from gateway.cli.main import main
from gateway.config.documents.json_schema import json_schema
from kit.configs import accepted_configs

ROOT = Path(__file__).parents[3]
SHIPPED = [ROOT / "deploy" / "gateway.toml", *sorted(ROOT.glob("deploy/examples/*.toml"))]
JUDGE = jsonschema_rs.validator_for(json_schema())


def mistakes(text: str) -> list[str]:
    """Where the schema finds something wrong."""
    return ["/".join(map(str, one.instance_path)) for one in JUDGE.iter_errors(tomllib.loads(text))]


def test_it_has_every_table_with_what_it_means():
    tables = json_schema()["definitions"]
    assert {"Listen", "Line", "Device", "PointTable", "Web", "Mqtt", "Fleet"} <= set(tables)
    assert {
        name for name, table in tables.items() if not table["description"] or table["additionalProperties"]
    } == set()


def test_a_default_is_a_value_as_it_is_written_in_a_file():
    whole = json_schema()
    tables = whole.pop("definitions")
    defaults = {}
    for name, table in tables.items():
        for key, schema in table["properties"].items():
            if "default" in schema:
                jsonschema_rs.validate({**schema, "definitions": tables}, schema["default"])
                defaults[name, key] = schema["default"]
    assert defaults["Line", "baud"] == 19200
    assert defaults["Line", "late_window"] == "auto"
    assert defaults["Listen", "idle"] == "10 min"
    assert defaults["PointTable", "write"] is False
    assert defaults["Publish", "points"] == ["*"]
    assert ("Listen", "name") not in defaults


def test_no_value_is_null_for_toml_has_none():
    assert "null" not in json.dumps(json_schema())


def test_check_prints_it(capsys):
    assert main(["check", "--schema"]) == 0
    assert json.loads(capsys.readouterr().out) == json_schema()


@pytest.mark.parametrize("text", [SMALLEST, EXAMPLE, *(file.read_text(encoding="utf-8") for file in SHIPPED)])
def test_examples_have_no_mistakes(text):
    assert mistakes(text) == []


@settings(max_examples=min(50, settings.default.max_examples))
@given(accepted_configs())
def test_what_check_accepts_has_no_mistakes(text):
    assert mistakes(text) == []


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ('[[line]]\nport = "/dev/ttyS1"\nbadu = 9600', "line/0"),
        ('[[line]]\nport = "ttyS1"', "line/0/port"),
        ('[[line]]\nport = "/dev/ttyS1"\nbaud = "9600"', "line/0/baud"),
        ('[[line]]\nport = "/dev/ttyS1"\nformat = "8E"', "line/0/format"),
        ('[[line]]\nport = "/dev/ttyS1"\ntimeout = 250', "line/0/timeout"),
        ('[[line]]\nport = "/dev/ttyS1"\ntimeout = "250 m"', "line/0/timeout"),
        ('[[line]]\nport = "/dev/ttyS1"\nmode = "tcp"', "line/0/mode"),
        ("[[line]]\nbaud = 9600", "line/0"),
        ('[[listen]]\nbind = "127.0.0.1:502"', "listen/0/bind"),
        ('[[line]]\nport = "/dev/ttyS1"\ndevices = [{ unit = "one" }]', "line/0/devices/0/unit"),
        ('[[access]]\nallow = ["reed"]', "access/0/allow/0"),
        ("[profile.a]\nfunctions = [300]", "profile/a/functions/0"),
        ('[log]\nlevel = "loud"', "log/level"),
        ('[[mqtt.publish]]\ndevice = "*"\nevery = "1 s"\non_change = -1', "mqtt/publish/0/on_change"),
    ],
)
def test_a_usual_mistake_is_marked_where_it_is(text, place):
    assert place in mistakes(text)
