"""The examples for fleets: what is copied from them works."""

import tomllib
from pathlib import Path

import pytest
from ruamel.yaml import YAML

from gateway.config.load import parse

ANSIBLE = Path(__file__).resolve().parents[2] / "deploy" / "ansible"
CONFIGS = sorted((ANSIBLE / "configs").iterdir())


@pytest.mark.parametrize("file", CONFIGS, ids=lambda file: file.stem)
def test_a_config_of_the_fleet_can_be_used(file):
    loaded = parse(file.read_text(encoding="utf-8"), file.name)
    assert [str(one) for one in loaded.problems if one.severity == "error"] == []


def test_each_host_has_a_config_for_the_site_of_its_name():
    hosts = YAML(typ="safe").load((ANSIBLE / "hosts.yml").read_text(encoding="utf-8"))["gateways"]["hosts"]
    sites = {file.stem: tomllib.loads(file.read_text(encoding="utf-8"))["site"] for file in CONFIGS}
    assert sites == {host: host for host in hosts}
