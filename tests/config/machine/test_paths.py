"""Paths in a config count from its folder, whatever the working directory is."""

from gateway.config.load import load, parse
from gateway.config.resolve import resolve

TEXT = """
[[listen]]
bind = "tls://127.0.0.1:8802"
certificate = "tls/server.crt"
key = { credential = "server.key" }
clients_ca = "tls/ca.crt"
crl = "../crl.pem"

[[upstream]]
to = "tls://10.0.0.7"
units = [{ as = 7, unit = 1 }]
certificate = "client.crt"
key = "client.key"
ca = "/etc/ssl/ca.crt"

[[image]]
unit = 1
name = "key"
profile = "weigher"
holding = 1000

[web]
bind = "https://127.0.0.1:8502"
certificate = "web.crt"
key = "web.key"
users = "users"
token = { file = "token" }

[mqtt]
broker = "mqtts://10.0.0.8"
user = "gw"
publish = [{ device = "key", every = "1 s" }]
password = { file = "mqtt.password" }
ca = "mqtt.crt"

[fleet]
servers = ["tls://10.0.0.9"]
user = "east"
password = { file = "fleet.password" }
ca = "fleet.crt"

[control]
socket = "run/control.sock"
"""
SITE = 'site = "east"\n'
RELATIVE = {
    *("tls/server.crt", "tls/ca.crt", "../crl.pem", "client.crt", "client.key", "web.crt", "web.key", "users", "token"),
    *("mqtt.password", "mqtt.crt", "fleet.password", "fleet.crt", "run/control.sock"),
}


def test_every_path_counts_from_the_folder_of_the_file(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    loaded = parse(SITE + TEXT, "/srv/plant/gateway.toml")
    plan = resolve(loaded.config)
    listen, upstream = (one.settings for one in plan.secured)
    web, mqtt, fleet = plan.web, plan.mqtt, plan.fleet
    found = [listen.certificate, listen.clients_ca, listen.crl, upstream.certificate, upstream.key, upstream.ca]
    found += [web.tls.certificate, web.tls.key, mqtt.password, mqtt.tls.ca, fleet.password, fleet.tls.ca]
    names = {*(each.name for each in found), web.users, web.token, plan.control}
    assert names == {f"/srv/plant/{path}" for path in RELATIVE} | {"/etc/ssl/ca.crt"}
    assert listen.key.name == "server.key"


def test_a_file_named_by_a_relative_path_stands_where_it_was_read(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    loaded = parse('[[image]]\nunit = 1\nholding = 1\n[control]\nsocket = "c"\n', "plant/gateway.toml")
    assert resolve(loaded.config).control == str(tmp_path / "plant" / "c")


def test_a_link_to_the_file_counts_from_where_the_link_stands(tmp_path):
    (tmp_path / "etc").mkdir()
    (tmp_path / "real.toml").write_text('[[image]]\nunit = 1\nholding = 1\n[control]\nsocket = "../c"\n')
    (tmp_path / "etc" / "gateway.toml").symlink_to(tmp_path / "real.toml")
    assert resolve(load(tmp_path / "etc" / "gateway.toml").config).control == f"{tmp_path}/etc/../c"
