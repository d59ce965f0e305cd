"""The script that starts the gateway as an add-on of Home Assistant."""

import importlib.util
import json
import subprocess
import tomllib
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from threading import Thread

import pytest
from ruamel.yaml import YAML

SCRIPT = Path(__file__).resolve().parents[2] / "deploy" / "homeassistant" / "start.py"
BROKER = {"host": "core-mosquitto", "port": 1883, "username": "addons", "password": "secret", "ssl": False}


@pytest.fixture
def start(tmp_path, monkeypatch):
    spec = importlib.util.spec_from_file_location("start", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setattr(module, "CONFIG", tmp_path / "gateway.toml")
    monkeypatch.setattr(module, "PASSWORD", tmp_path / "mqtt.password")
    monkeypatch.setattr(module, "SERVICE", "http://127.0.0.1:1/")
    monkeypatch.setattr(module.os, "execvp", lambda *words: started.append(words))
    module.started = started = []
    return module


@pytest.fixture
def supervisor(start, monkeypatch):
    """Home Assistant's Supervisor, with a broker."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            is_known = self.headers["Authorization"] == "Bearer token"
            self.send_response(200 if is_known else 401)
            self.end_headers()
            self.wfile.write(json.dumps({"result": "ok", "data": BROKER}).encode())

        def log_message(self, *_):
            pass

    monkeypatch.setenv("SUPERVISOR_TOKEN", "token")
    with HTTPServer(("127.0.0.1", 0), Handler) as server:
        monkeypatch.setattr(start, "SERVICE", f"http://127.0.0.1:{server.server_port}/services/mqtt")
        thread = Thread(target=server.serve_forever)
        thread.start()
        yield
        server.shutdown()
        thread.join()


def test_the_first_start_makes_a_config_and_becomes_the_gateway(start):
    start.main()
    assert start.CONFIG.read_text() == (SCRIPT.parent / "gateway.toml").read_text()
    assert start.started == [("modbus-gateway", ["modbus-gateway", "run", str(start.CONFIG)])]


def test_a_later_start_keeps_the_config(start):
    start.CONFIG.write_text("mine")
    start.main()
    assert start.CONFIG.read_text() == "mine"


def test_the_password_of_the_broker_is_written_for_the_gateway_alone(start, supervisor, capsys):
    start.main()
    assert start.PASSWORD.read_text() == "secret"
    assert start.PASSWORD.stat().st_mode & 0o077 == 0
    said = capsys.readouterr().out
    assert "mqtt://core-mosquitto:1883, the user addons" in said
    assert "secret" not in said


@pytest.mark.parametrize("none", [None, ""])
def test_a_broker_without_a_password_has_no_file_for_it(start, supervisor, capsys, monkeypatch, none):
    monkeypatch.setitem(BROKER, "password", none)
    monkeypatch.delitem(BROKER, "username")
    start.PASSWORD.write_text("of the broker before")
    start.main()
    assert not start.PASSWORD.exists()
    assert start.started
    assert "mqtt://core-mosquitto:1883, without a user" in capsys.readouterr().out


def test_what_names_no_host_is_no_broker(start, supervisor, capsys, monkeypatch):
    monkeypatch.delitem(BROKER, "host")
    start.main()
    assert start.started
    assert "names no broker" in capsys.readouterr().out


def test_without_a_broker_the_gateway_starts_all_the_same(start, capsys):
    start.main()
    assert not start.PASSWORD.exists()
    assert start.started
    assert "names no broker" in capsys.readouterr().out


def test_its_repository_names_the_image_of_this_version(tmp_path):
    subprocess.run([SCRIPT.parent / "repository", tmp_path, "7.0.1"], check=True, capture_output=True)
    (branch, *files) = subprocess.run(
        "git branch --show-current && git ls-files",
        shell=True,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    ).stdout.split()
    assert branch == "home-assistant"
    assert {"repository.yaml", "modbus_gateway/config.yaml", "modbus_gateway/DOCS.md"} <= set(files)
    config = YAML(typ="safe").load(tmp_path / "modbus_gateway/config.yaml")
    addresses = tomllib.loads((SCRIPT.parents[1] / "project.toml").read_text(encoding="utf-8"))
    assert (config["version"], config["image"]) == ("7.0.1", f"{addresses['image']}/home-assistant")
