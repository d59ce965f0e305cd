"""Paths in a config count from its folder, whatever the working directory is."""

import pytest

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
    loaded = parse(SITE + TEXT, "/srv/plant/gateway.toml", exists=lambda _: True)
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


def test_what_only_the_working_directory_has_is_told_with_both_paths(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    loaded = parse(SITE + TEXT, "/srv/plant/gateway.toml", exists=lambda path: not path.startswith("/srv"))
    assert loaded.config is not None
    told = {one.what.split()[3].removesuffix(":"): one for one in loaded.problems if "count from" in one.what}
    assert told.keys() == {f"/srv/plant/{path}" for path in RELATIVE}
    assert str(told["/srv/plant/token"]) == (
        "/srv/plant/gateway.toml:28:18: warning: web.token.file: there is no /srv/plant/token: paths count from the "
        f"folder of the config now, and no longer to {tmp_path}/token\n"
        f'  help: write "{tmp_path}/token", or move the file'
    )


@pytest.mark.parametrize("has", ["both", "neither", "the folder of the config"])
def test_otherwise_nothing_is_told(has, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    exists = {"both": True, "neither": False, "the folder of the config": None}[has]

    def look(path: str) -> bool:
        return path.startswith("/srv") if exists is None else exists

    problems = parse(SITE + TEXT, "/srv/plant/gateway.toml", exists=look).problems
    assert not [one for one in problems if "count from" in one.what]


def test_a_working_directory_that_is_gone_has_no_files(monkeypatch, tmp_path):
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    assert [one for one in parse(SITE + TEXT, "/srv/gateway.toml").problems if "count from" in one.what] == []


def test_keys_that_only_look_like_paths_are_none(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "here").touch()
    text = '[[image]]\nunit = 1\nname = "here"\nholding = 1\n[profile.key]\ntitle = "here"\n'
    assert parse(text, "/srv/plant/gateway.toml").problems == ()
    (problem,) = parse('file = "here"\n' + text, "/srv/plant/gateway.toml").problems
    assert problem.what == "unknown key"
