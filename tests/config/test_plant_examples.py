"""The examples for brokers, historians and Home Assistant: what is pasted from them works."""

import json
import re
import subprocess
import tomllib
from pathlib import Path

import pytest
from ruamel.yaml import YAML

from gateway.config.load import parse
from gateway.plant.discovery import Discovery
from gateway.plant.topics import Topics

DEPLOY = Path(__file__).resolve().parents[2] / "deploy"
PAGE = DEPLOY.parent / "docs" / "plant.md"
COMPOSE = DEPLOY / "compose"
ADD_ON = DEPLOY / "homeassistant"


def examples(language):
    return re.findall(rf"^```{language}\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


def errors(text):
    """What `check` would refuse."""
    return [str(one) for one in parse(text, "gateway.toml").problems if one.severity == "error"]


def yaml(file):
    return YAML(typ="safe").load(file.read_text(encoding="utf-8"))


CONFIGS = [each for each in examples("toml") if "[mqtt]" in each]
LINES = [each for each in examples("toml") if "[" not in each]


def with_lines(config, lines):
    """A config whose last table, `[mqtt]`, has these lines, and no others with their keys."""
    keys = tuple(tomllib.loads(lines))
    rest = [each for each in config.splitlines() if not (each.startswith(keys) and each.partition(" ")[0] in keys)]
    return "\n".join([*rest, lines])


def test_the_page_has_a_config_for_each_use():
    assert [sum(key in each for each in CONFIGS) for key in ("[mqtt]", "home_assistant")] == [2, 1]
    assert [sum(key in each for each in LINES) for key in ("mqtts://", "sparkplug")] == [1, 1]


@pytest.mark.parametrize("lines", LINES, ids=range(len(LINES)))
def test_lines_on_the_page_can_be_added_to_its_first_config(lines):
    assert errors(with_lines(CONFIGS[0], lines)) == []


@pytest.mark.parametrize("text", CONFIGS, ids=range(len(CONFIGS)))
def test_a_config_on_the_page_can_be_pasted(text):
    assert errors(text) == []


def test_the_flow_on_the_page_is_whole():
    (text,) = examples("json")
    nodes = json.loads(text)
    known = {node["id"] for node in nodes}
    assert len(known) == len(nodes)
    for node in nodes:
        assert {target for wire in node.get("wires", []) for target in wire} <= known
        assert node.get("broker", "127.0.0.1") in {*known, "127.0.0.1"}
        assert node.get("retain", "false") == "false"


def test_telegraf_on_the_page_is_that_of_the_compose_file():
    (page,) = (tomllib.loads(each) for each in examples("toml") if "mqtt_consumer" in each)
    theirs = tomllib.loads((COMPOSE / "telegraf.conf").read_text(encoding="utf-8"))
    of_page, of_file = (each["inputs"]["mqtt_consumer"][0] for each in (page, theirs))
    assert {**of_file, **of_page, "servers": []} == {**of_file, "servers": []}


def test_the_config_of_the_compose_file_can_be_used():
    assert errors((COMPOSE / "gateway.toml").read_text(encoding="utf-8")) == []


def test_the_compose_file_mounts_what_there_is():
    for service in yaml(COMPOSE / "compose.yaml")["services"].values():
        for mount in service.get("volumes", []):
            source = mount.split(":")[0]
            assert not source.startswith(".") or (COMPOSE / source).is_file()


def test_the_compose_file_opens_ports_on_this_machine_only():
    services = yaml(COMPOSE / "compose.yaml")["services"].values()
    assert all(port.startswith("127.0.0.1:") for service in services for port in service.get("ports", []))


def test_the_parts_of_the_compose_file_find_one_another():
    services = yaml(COMPOSE / "compose.yaml")["services"]
    config = tomllib.loads((COMPOSE / "gateway.toml").read_text(encoding="utf-8"))
    influx = services["influxdb"]["environment"]
    output = tomllib.loads((COMPOSE / "telegraf.conf").read_text(encoding="utf-8"))["outputs"]["influxdb_v2"][0]
    (source,) = yaml(COMPOSE / "grafana" / "datasources.yaml")["datasources"]
    assert config["mqtt"]["broker"] == "mqtt://mosquitto:1883"
    assert config["mqtt"]["user"] == config["site"]
    assert config["mqtt"]["password"]["file"] in services["gateway"]["command"][0]
    assert config["line"][0]["port"] in services["gateway"]["command"][0]
    assert output["organization"] == source["jsonData"]["organization"] == influx["DOCKER_INFLUXDB_INIT_ORG"]
    assert output["bucket"] == source["jsonData"]["defaultBucket"] == influx["DOCKER_INFLUXDB_INIT_BUCKET"]
    dashboard = json.loads((COMPOSE / "grafana" / "plant.json").read_text(encoding="utf-8"))
    assert {panel["datasource"]["uid"] for panel in dashboard["panels"]} == {source["uid"]}
    assert yaml(COMPOSE / "grafana" / "dashboards.yaml")["providers"][0]["options"]["path"] in "".join(
        services["grafana"]["volumes"]
    )


def test_the_add_on_has_what_home_assistant_asks_of_one():
    config = yaml(ADD_ON / "config.yaml")
    assert {"name", "version", "slug", "description", "arch"} <= set(config)
    assert set(config["arch"]) <= {"amd64", "aarch64"}
    assert re.fullmatch(r"[a-z0-9_]+", config["slug"])
    assert set(config["ports"]) == set(config["ports_description"])
    assert set(yaml(ADD_ON / "translations" / "en.yaml")["network"]) == set(config["ports"])
    assert (ADD_ON / "DOCS.md").is_file()
    assert "FROM" in (ADD_ON / "Dockerfile").read_text(encoding="utf-8")


def test_the_first_config_of_the_add_on_can_be_used_with_and_without_its_marks():
    text = (ADD_ON / "gateway.toml").read_text(encoding="utf-8")
    assert errors(text) == []
    whole = re.sub(r"^#(?! \S)", "", text, flags=re.MULTILINE)
    assert "\n[mqtt]\n" in whole
    assert errors(whole) == []


@pytest.mark.parametrize("file", ["mosquitto/mosquitto.conf", "compose/mosquitto.conf"])
def test_nobody_may_use_the_broker_without_a_password(file):
    lines = (DEPLOY / file).read_text(encoding="utf-8").splitlines()
    assert "allow_anonymous false" in lines
    assert any(line.startswith("password_file ") for line in lines)
    assert any(line.startswith("acl_file ") for line in lines)


def test_telegraf_may_only_read():
    rights = (DEPLOY / "mosquitto" / "acl").read_text(encoding="utf-8").partition("user telegraf\n")[2]
    assert rights.partition("\n\n")[0] == "topic read modbus/#"


def test_each_right_at_the_broker_is_one_users():
    """What a `pattern` grants, every user has: also one that only reads."""
    rights = (DEPLOY / "mosquitto" / "acl").read_text(encoding="utf-8").splitlines()
    assert {line.split(" ")[0] for line in rights if line} == {"#", "user", "topic"}
    assert next(line for line in rights if not line.startswith("#") and line).startswith("user ")


def test_a_site_that_has_another_name_in_home_assistant_may_announce_its_devices():
    rights = (DEPLOY / "mosquitto" / "acl").read_text(encoding="utf-8")
    folder = Discovery(Topics("werk.1"), "homeassistant").folder
    assert f"user werk.1\n#   topic write homeassistant{folder}#\n" in rights


@pytest.mark.parametrize("service", ["gateway", "mosquitto"])
def test_commands_in_the_compose_file_are_commands(service):
    (script,) = yaml(COMPOSE / "compose.yaml")["services"][service]["command"]
    subprocess.run(["sh", "-n", "-c", script.replace("$$", "$")], check=True)


def test_the_compose_file_has_no_passwords_of_its_own_and_tells_which_to_make():
    text = (COMPOSE / "compose.yaml").read_text(encoding="utf-8")
    assert not re.findall(r"(?<!\$)\$\{\w+:?-", text), "a password that everybody knows"
    wanted = set(re.findall(r"\$\{(\w+):\?", text))
    made = set(re.findall(r"for name in (.+); do", text)[0].split())
    assert wanted == made
