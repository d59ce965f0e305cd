"""`[web]`: health, readiness and metrics of a gateway that runs, and who may read them."""

import json
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import pytest

from gateway.web.front.connections import MOST_CONNECTIONS
from kit.device import SimulatedDevice, SimulatedLine
from kit.free_port import free_port
from kit.process import PATIENCE, GatewayProcess, command
from kit.pty import VirtualPort
from kit.serial_line import SerialDevices

CONFIG = """
[[listen]]
name = "scada"
bind = "tcp://127.0.0.1:0"

[[line]]
name = "hall-a"
port = "{folder}/hall-a"
devices = [{{ unit = 1, timeout = "20 s" }}]

[web]
bind = "http://127.0.0.1:0"
"""
READ = bytes.fromhex("0001 0000 0006 01 03 0000 0001")


class Answer(NamedTuple):
    status: int
    headers: Mapping[str, str]
    text: str


class Web(GatewayProcess):
    """A gateway with `[web]`."""

    def __enter__(self):
        super().__enter__()
        (self.address,) = (event["address"] for event in self.log if event["event"] == "web_up")
        return self

    def get(self, path: str, method: str = "GET", **headers: str) -> Answer:
        request = Request(self.address + path, headers=headers, method=method)
        try:
            with urlopen(request, timeout=PATIENCE) as response:
                return Answer(response.status, response.headers, response.read().decode())
        except HTTPError as error:
            return Answer(error.code, error.headers, error.read().decode())

    def problem(self, path: str, **more: str) -> dict[str, Any]:
        answer = self.get(path, **more)
        assert answer.headers["Content-Type"].startswith("application/problem+json")
        problem = json.loads(answer.text)
        assert problem["status"] == answer.status
        return problem


@pytest.fixture
def config(tmp_path: Path) -> str:
    return CONFIG.format(folder=tmp_path)


@pytest.fixture(scope="module")
def idle(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Web]:
    """One whose line is down, for tests that only ask."""
    folder = tmp_path_factory.mktemp("idle")
    with Web(folder, f'site = "plant-2"\n{CONFIG.format(folder=folder)}hosts = ["gw.plant.local"]\n') as gateway:
        yield gateway


def test_metrics_count_what_clients_ask(tmp_path, config):
    devices = SimulatedLine("rtu", SimulatedDevice(1))
    with VirtualPort(tmp_path / "hall-a") as port, SerialDevices({port: devices}), Web(tmp_path, config) as gateway:
        with socket.create_connection(("127.0.0.1", gateway.port), timeout=PATIENCE) as client:
            client.sendall(READ)
            client.recv(260)
        answer = gateway.get("/metrics")
        assert answer.headers["Content-Type"].startswith("text/plain; version=0.0.4")
        assert 'modbus_gateway_requests_total{function="3",line="hall-a",result="ok",unit="1"} 1.0' in answer.text
        assert gateway.get("/healthz").text == "ok\n"
        assert gateway.get("/readyz").text == "ready\n"
        assert gateway.stop() == 0


def test_who_starts_it_and_who_asks_for_its_status_is_told_where_the_page_is(idle):
    (ready,) = (event for event in idle.log if event["event"] == "ready")
    assert ready["page"] == idle.address
    assert f"\nplant-2   {idle.address}\n" in command("status", "--control", ready["control"]).stdout


def test_the_name_of_the_plant_is_on_each_page(idle):
    page = idle.get("/traffic").text
    assert "Traffic · plant-2</title>" in page
    assert '<a class="brand" href="/">plant-2</a>' in page


def test_a_gateway_of_which_no_line_can_answer_is_healthy_and_not_ready(idle):
    assert idle.get("/healthz").status == 200
    problem = idle.problem("/readyz")
    assert (problem["status"], problem["detail"]) == (503, "no line is up, and there is no image")


def test_an_image_can_always_answer(tmp_path, config):
    with Web(tmp_path, f"{config}\n[[image]]\nunit = 200\nholding = 1\n") as gateway:
        assert gateway.get("/readyz").status == 200


def test_errors_are_problem_details(idle):
    assert idle.problem("/nothing")["status"] == 404
    assert idle.problem("/metrics", method="DELETE")["status"] == 405
    assert idle.get("/metrics", method="DELETE").headers["Allow"] == "GET,HEAD"


@pytest.mark.parametrize(
    ("host", "status"),
    [
        ("evil.example", 421),
        ("evil.example:80", 421),
        ("gw.plant.local:8502", 200),
        ("GW.plant.local", 200),
        ("localhost:1", 200),
        ("127.0.0.1", 200),
        ("[::1]:8502", 200),
        ("[::", 421),
        ("", 421),
    ],
)
def test_only_names_that_are_its_own_are_answered(idle, host, status):
    assert idle.get("/metrics", Host=host).status == status


def test_a_token_guards_the_metrics_and_not_the_health(tmp_path, config):
    token = tmp_path / "metrics.token"
    token.write_text("s3cret\n")
    token.chmod(0o600)
    with Web(tmp_path, f'{config}token = {{ file = "{token}" }}\n') as gateway:
        assert gateway.get("/healthz").status == 200
        assert gateway.get("/readyz").status == 503
        refused = gateway.get("/metrics")
        assert (refused.status, refused.headers["WWW-Authenticate"]) == (401, "Bearer")
        for wrong in ("Bearer s3cre", "Bearer s3crets", "Basic s3cret", "Bearer", "Bearer \xe9"):
            assert gateway.get("/metrics", Authorization=wrong).status == 401
        assert gateway.get("/metrics", Authorization="Bearer s3cret").status == 200


@pytest.mark.parametrize(("content", "mode"), [(None, 0), ("", 0o600), ("\n", 0o600), ("s3cret", 0o644)])
def test_without_the_token_nobody_is_let_in_and_the_lines_work(tmp_path, config, content, mode):
    token = tmp_path / "metrics.token"
    if content is not None:
        token.write_text(content)
        token.chmod(mode)
    with GatewayProcess(tmp_path, f'{config}token = {{ file = "{token}" }}\n') as gateway:
        (closed,) = (event for event in gateway.log if event["event"] == "web_closed")
        assert str(token) in closed["reason"]


def test_an_address_in_use_is_told_and_the_lines_work(tmp_path, config):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with GatewayProcess(tmp_path, config.replace("http://127.0.0.1:0", f"http://127.0.0.1:{port}")) as gateway:
            (closed,) = (event for event in gateway.log if event["event"] == "web_closed")
            assert "in use" in closed["reason"]
            told = command("doctor", "--json", "--passive", "--control", str(tmp_path / "control.sock"))
            (row,) = (each for each in json.loads(told.stdout)["findings"] if each["about"] == "web")
            assert row["what"] == f"http://127.0.0.1:{port} cannot be used: {closed['reason']}"
            assert gateway.stop() == 0


def test_of_a_listener_and_the_page_at_one_address_the_listener_gets_it(tmp_path, config):
    """What is seen only when names are looked up: to the system 0x7f.1 is 127.0.0.1, to `check` it is a name."""
    port = free_port()
    text = config.replace("tcp://127.0.0.1:0", f"tcp://0x7f.1:{port}")
    with GatewayProcess(tmp_path, text.replace("http://127.0.0.1:0", f"http://127.0.0.1:{port}")) as gateway:
        (closed,) = (event for event in gateway.log if event["event"] == "web_closed")
        assert closed["reason"] == "a [[listen]] has this address"
        with socket.create_connection(("127.0.0.1", gateway.port), timeout=PATIENCE) as client:
            client.sendall(READ)
            assert client.recv(16)
        assert gateway.stop() == 0


def test_connections_have_a_bound_and_those_that_idle_do_not_delay_the_end(tmp_path, config):
    with Web(tmp_path, config) as gateway:
        address = ("127.0.0.1", int(gateway.address.rpartition(":")[2]))
        held = [socket.create_connection(address, timeout=PATIENCE) for _ in range(MOST_CONNECTIONS)]
        for each in held:
            each.sendall(b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n")
            assert each.recv(4096).startswith(b"HTTP/1.1 200")
        with socket.create_connection(address, timeout=PATIENCE) as one_more:
            one_more.sendall(b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n")
            assert one_more.recv(4096).startswith(b"HTTP/1.1 200")
        assert held[0].recv(1) == b""
        assert gateway.stop() == 0
        for each in held:
            each.close()


def test_what_is_no_http_is_closed_and_not_logged(tmp_path, config):
    with Web(tmp_path, config) as gateway:
        address = ("127.0.0.1", int(gateway.address.rpartition(":")[2]))
        for data in (READ, b"GET\r\n\r\n", b"\x16\x03\x01"):
            with socket.create_connection(address, timeout=PATIENCE) as client:
                client.sendall(data + b"\r\n\r\n")
                assert client.recv(4096).startswith(b"HTTP/1.")
                client.shutdown(socket.SHUT_WR)
                while client.recv(4096):
                    pass
        assert gateway.get("/healthz").status == 200
        assert gateway.stop() == 0
        assert gateway.rest == []


def test_a_reload_that_was_rejected_shows(tmp_path, config):
    with Web(tmp_path, config) as gateway:
        assert "config_last_reload_successful 1.0" in gateway.get("/metrics").text
        good = gateway.config.read_text()
        gateway.config.write_text("line = 3\n")
        gateway.signal(signal.SIGHUP)
        gateway.wait_for("config_rejected")
        assert "config_last_reload_successful 0.0" in gateway.get("/metrics").text
        gateway.config.write_text(good)
        gateway.signal(signal.SIGHUP)
        gateway.wait_for("config_applied")
        assert "config_last_reload_successful 1.0" in gateway.get("/metrics").text


def test_neither_library_is_loaded_without_the_table():
    loaded = "import sys, gateway.service.daemon; sys.exit(bool({'aiohttp', 'prometheus_client'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", loaded], check=False).returncode == 0
