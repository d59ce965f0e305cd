"""The examples for fleets: what is copied from them works."""

import re
import tomllib
from pathlib import Path

import pytest
from ruamel.yaml import YAML

from gateway.config.load import parse
from gateway.config.reading.hub_file import parse_hub_file
from gateway.config.schema.hub import Hub
from gateway.fleet.hub.config import hub_config, sites_of
from gateway.fleet.hub.known import Login

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "fleet.md").read_text(encoding="utf-8")
ANSIBLE = ROOT / "deploy" / "ansible"
ON_PAGE = re.findall(r"^```toml\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
#: The list of sites, which is no config.
(SITES,) = (text for text in ON_PAGE if text.startswith("control"))
CONFIGS = sorted((ANSIBLE / "configs").iterdir())


@pytest.mark.parametrize("file", CONFIGS, ids=lambda file: file.stem)
def test_a_config_of_the_fleet_can_be_used(file):
    loaded = parse(file.read_text(encoding="utf-8"), file.name)
    assert [str(one) for one in loaded.problems if one.severity == "error"] == []


@pytest.mark.parametrize("text", ON_PAGE, ids=range(len(ON_PAGE)))
def test_a_config_on_the_page_can_be_pasted(text):
    if text == SITES:
        return
    assert [str(one) for one in parse(text, "gateway.toml").problems if one.severity == "error"] == []


def hub() -> Hub:
    read = parse_hub_file(SITES, "fleet.toml")
    assert read.hub is not None, read.problems
    return read.hub


def test_the_list_of_sites_on_the_page_has_all_keys():
    assert {*hub().model_fields_set} == {*Hub.model_fields}


def test_the_table_of_rights_has_what_the_hub_gives_a_site():
    ours = ("mbgw.", "_INBOX", "$KV")
    logins = {site: Login("U" * 56, "secret") for site in sites_of(hub())}
    account = hub_config(hub(), logins, "fleet.toml").partition('\n  "plant-1": {')[2]
    rights = account.partition("permissions: {")[2].partition("}")[0]
    given = {each.replace("plant-1", "X") for each in re.findall(r'"([^"]+)"', rights) if each.startswith(ours)}
    table = PAGE.partition("| a site X may |")[2].partition("\n\n")[0]
    told = {each for each in re.findall(r"`([^`]+)`", table) if each.startswith(ours)}
    assert told == given != set()


def test_each_host_has_a_config_for_the_site_of_its_name():
    hosts = YAML(typ="safe").load((ANSIBLE / "hosts.yml").read_text(encoding="utf-8"))["gateways"]["hosts"]
    sites = {file.stem: tomllib.loads(file.read_text(encoding="utf-8"))["site"] for file in CONFIGS}
    assert sites == {host: host for host in hosts}
