"""The config of the hub out of a list of sites: who may ask whom, and what of an earlier one stays."""

import re

import pytest

from gateway.config.reading.hub_file import parse_hub_file
from gateway.fleet.hub.config import hub_config
from gateway.fleet.hub.known import Login, logins_in
from gateway.fleet.hub.leaf import leaf_config

KEYS = {site: Login("U" + site[0].upper() * 55) for site in ("control", "office", "east", "north")}
KEYS["west"] = Login("U" + "W" * 55, "secret")


def config(text: str) -> str:
    hub = parse_hub_file(text, "fleet.toml").hub
    assert hub is not None
    return hub_config(hub, KEYS, "fleet.toml")


def account(text: str, site: str) -> str:
    return text.partition(f'\n  "{site}": {{\n')[2].partition("\n  }\n")[0]


def takes(text: str, site: str) -> dict[str, set[str]]:
    """What a site takes from others: subjects, by account."""
    found: dict[str, set[str]] = {}
    for other, subject in re.findall(r'stream: \{ account: "([^"]+)", subject: "([^"]+)"', account(text, site)):
        found.setdefault(other, set()).add(subject)
    return found


def test_control_asks_all_and_the_others_ask_nobody():
    text = config('control = "control"\nsites = ["east", "north"]')
    assert takes(text, "east") == {"control": {"mbgw.east.unit.*.from.control"}}
    assert takes(text, "north") == {"control": {"mbgw.north.unit.*.from.control"}}
    assert takes(text, "control") == {
        "east": {"mbgw.control.answer.east.>", "mbgw.east.clock"},
        "north": {"mbgw.control.answer.north.>", "mbgw.north.clock"},
    }


def test_a_site_asks_another_if_the_list_says_so():
    text = config('control = "control"\nsites = ["east", "north"]\nasks = { east = ["north"] }')
    assert takes(text, "north")["east"] == {"mbgw.north.unit.*.from.east"}
    assert takes(text, "east")["north"] == {"mbgw.east.answer.north.>", "mbgw.north.clock"}


def test_several_control_sites_ask_one_another_too():
    text = config('control = ["control", "office"]\nsites = ["east"]')
    assert takes(text, "office").keys() == {"control", "east"}
    assert takes(text, "control").keys() == {"office", "east"}
    assert takes(text, "east").keys() == {"control", "office"}


def test_only_control_makes_buckets():
    text = config('control = "control"\nsites = ["east"]\nleases = ["east.hall"]')
    assert "CREATE" in account(text, "control")
    assert "CREATE" not in account(text, "east")
    exported = [line for line in account(text, "mbgw.buckets").splitlines() if "CREATE" in line]
    assert len(exported) == 2
    assert all('accounts: ["control"]' in line for line in exported)


def test_a_site_writes_its_status_and_the_leases_that_are_named():
    text = config('control = "control"\nsites = ["east", "north"]\nleases = ["east.hall", "east.yard"]')
    assert set(re.findall(r'"\$KV\.([^"]+)"', account(text, "east"))) == {
        "mbgw-status.east",
        "mbgw-lease.east.hall",
        "mbgw-lease.east.yard",
    }
    assert "lease" not in account(text, "north")


def test_without_a_certificate_it_listens_on_this_machine_only():
    sites = 'control = "control"\nsites = ["east"]\n'
    assert 'listen: "127.0.0.1:4222"' in config(sites)
    with_tls = config(f'{sites}certificate = "/etc/nats/server.crt"\nkey = "/etc/nats/server.key"')
    assert 'listen: "0.0.0.0:4222"' in with_tls
    assert 'tls { cert_file: "/etc/nats/server.crt", key_file: "/etc/nats/server.key" }' in with_tls
    assert 'listen: "10.0.0.1:4333"' in config(f'{sites}listen = "10.0.0.1:4333"')


def test_a_site_with_a_leaf_node_logs_in_at_the_hub_by_that_alone():
    hub = parse_hub_file(
        'control = "control"\nsites = ["west"]\nleases = ["west.hall"]\nleaf_nodes = ["west"]\naddress = "hub:4333"', ""
    ).hub
    assert hub is not None
    at_hub, leaf = account(hub_config(hub, KEYS, ""), "west"), leaf_config(hub, "west", KEYS["west"])
    assert 'password: "secret", allowed_connection_types: ["LEAFNODE"]' in at_hub
    assert "lease" not in at_hub
    assert "nats-leaf://west:secret@hub:7422" in leaf
    assert KEYS["west"].key in leaf
    assert '"$KV.mbgw-lease.west.hall"' in leaf


@pytest.mark.parametrize("leaf", ["", 'leaf_nodes = ["west"]\naddress = "hub"'])
def test_the_keys_of_a_config_are_read_back(leaf):
    text = config(f'control = "control"\nsites = ["east", "west"]\n{leaf}')
    west = KEYS["west"] if leaf else Login(KEYS["west"].key)
    assert logins_in(text) == {"control": KEYS["control"], "east": KEYS["east"], "west": west}
