"""`status`, `reload` and SIGHUP on a gateway that runs."""

import json
import signal
import socket
import stat
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from gateway.operator.operations.table import BY_NAME
from gateway.version import __version__
from kit.device import SimulatedDevice, SimulatedLine
from kit.free_port import free_port
from kit.process import PATIENCE, GatewayProcess, command
from kit.pty import VirtualPort
from kit.serial_line import SerialDevices

READ = bytes.fromhex("0001 0000 0006 01 03 0000 0001")
RIGHT = bytes.fromhex("0001 0000 0005 01 03 02 0000")


@pytest.fixture
def config(tmp_path: Path) -> Iterator[str]:
    """A gateway with one line and its device, and a control socket beside its config."""
    devices = SimulatedLine("rtu", SimulatedDevice(1))
    with VirtualPort(tmp_path / "hall-a") as port, SerialDevices({port: devices}):
        yield f"""
[[listen]]
name = "scada"
bind = "tcp://127.0.0.1:0"

[[line]]
name = "hall-a"
port = "{tmp_path / "hall-a"}"
devices = [{{ unit = 1, timeout = "20 s" }}]

[control]
socket = "{tmp_path / "control.sock"}"
"""


def connected(gateway: GatewayProcess) -> socket.socket:
    return socket.create_connection(("127.0.0.1", gateway.port), timeout=PATIENCE)


def asked(client: socket.socket) -> bytes:
    client.sendall(READ)
    return client.recv(260)


def test_the_log_says_where_the_control_socket_is_once_it_is_ready(tmp_path: Path, config: str) -> None:
    with GatewayProcess(tmp_path, config) as gateway:
        (ready,) = (event for event in gateway.log if event["event"] == "ready")
        assert ready["control"] == str(tmp_path / "control.sock")


def test_status_shows_lines_units_and_listeners(tmp_path: Path, config: str) -> None:
    with GatewayProcess(tmp_path, config) as gateway, connected(gateway) as client:
        assert asked(client) == RIGHT
        socket_file = tmp_path / "control.sock"
        assert stat.S_IMODE(socket_file.stat().st_mode) == 0o660
        shown = command("status", "--control", str(socket_file))
        assert shown.returncode == 0
        assert f"tcp://127.0.0.1:{gateway.port}" in shown.stdout
        line, *_users = [row.split() for row in shown.stdout.splitlines() if row.startswith("  hall-a")]
        assert (line[1][-6:], line[2:5]) == ("hall-a", ["19200", "8E1", "up"])
        status = json.loads(command("status", "--json", "--control", str(socket_file)).stdout)
        assert status["units"][0]["counts"]["ok"] == 1
        assert status["listeners"][0]["clients"] == 1
        assert gateway.stop() == 0
        assert not socket_file.exists()


def test_no_daemon_is_a_problem_that_says_what_to_do(tmp_path: Path) -> None:
    nobody = command("status", "--control", str(tmp_path / "control.sock"))
    assert nobody.returncode == 1
    assert "no running gateway found" in nobody.stderr


def test_what_a_killed_gateway_has_left_is_no_obstacle_and_another_gateway_is_told(tmp_path: Path, config: str) -> None:
    with GatewayProcess(tmp_path, config) as gateway:
        gateway.signal(signal.SIGKILL)
        gateway.wait()
    assert (tmp_path / "control.sock").exists()
    (tmp_path / "second").mkdir()
    with GatewayProcess(tmp_path, config):
        assert command("status", "--control", str(tmp_path / "control.sock")).returncode == 0
        with GatewayProcess(tmp_path / "second", config) as second:
            event = next(event for event in second.log if event["event"] == "control_closed")
            assert event["reason"] == "another modbus-gateway answers there"
        assert command("status", "--control", str(tmp_path / "control.sock")).returncode == 0


def test_reload_says_what_it_changed_and_touches_nothing_else(tmp_path: Path, config: str) -> None:
    with GatewayProcess(tmp_path, config) as gateway, connected(gateway) as client:
        assert asked(client) == RIGHT
        gateway.config.write_text(gateway.config.read_text() + "[[image]]\nunit = 200\nholding = 10\n")
        reloaded = command("reload", "--control", str(tmp_path / "control.sock"))
        assert (reloaded.returncode, reloaded.stdout) == (0, "new: image image-200\n")
        client.sendall(bytes.fromhex("0001 0000 0006 C8 03 0000 0001"))
        assert client.recv(260) == bytes.fromhex("0001 0000 0005 C8 03 02 0000")
        assert asked(client) == RIGHT
        assert gateway.stop() == 0
        assert [event["event"] for event in gateway.log].count("line_up") == 1


def test_a_profile_beside_the_config_takes_effect_with_a_reload(tmp_path: Path, config: str) -> None:
    file = tmp_path / "profiles" / "meter.toml"
    file.parent.mkdir()
    file.write_text("[profile.meter]\nfunctions = [4]\n")
    text = config + '[[image]]\nunit = 200\nholding = 10\nprofile = "meter"\n'
    read = bytes.fromhex("0001 0000 0006 C8 03 0000 0001")
    with GatewayProcess(tmp_path, text) as gateway, connected(gateway) as client:
        client.sendall(read)
        assert client.recv(260) == bytes.fromhex("0001 0000 0003 C8 83 01")
        file.write_text("[profile.meter]\nfunctions = [3]\n")
        assert command("reload", "--control", str(tmp_path / "control.sock")).stdout == "changed: image image-200\n"
        client.sendall(read)
        assert client.recv(260) == bytes.fromhex("0001 0000 0005 C8 03 02 0000")
        file.write_text("[profile.meter]\nfunctions = 3\n")
        rejected = command("reload", "--control", str(tmp_path / "control.sock"))
        assert rejected.returncode == 1
        assert f"{file}:2:13: error: profile.meter.functions: must be a list" in rejected.stdout
        assert gateway.wait_for("config_rejected")["reason"]
        client.sendall(read)
        assert client.recv(260) == bytes.fromhex("0001 0000 0005 C8 03 02 0000")


def test_a_broken_file_under_load_fails_no_transaction(tmp_path: Path, config: str) -> None:
    with GatewayProcess(tmp_path, config) as gateway:
        stop, answers = threading.Event(), []

        def poll() -> None:
            with connected(gateway) as client:
                while not stop.is_set():
                    answers.append(asked(client))
                    stop.wait(0.01)

        polling = threading.Thread(target=poll)
        polling.start()
        good = gateway.config.read_text()
        for broken in ("[[line]\n", "x = 1\n", good + good, good.replace("127.0.0.1:0", "192.0.2.1:0")):
            gateway.config.write_text(broken)
            gateway.signal(signal.SIGHUP)
            assert gateway.wait_for("config_rejected")["reason"]
        rejected = command("reload", "--control", str(tmp_path / "control.sock"))
        assert rejected.returncode == 1
        assert "192.0.2.1" in rejected.stdout
        gateway.config.write_text(good)
        assert (
            command("reload", "--control", str(tmp_path / "control.sock")).stdout
            == f"nothing has changed in {gateway.config}\n"
        )
        deadline = time.monotonic() + PATIENCE
        while len(answers) <= 10 and polling.is_alive() and time.monotonic() < deadline:
            time.sleep(0.05)
        stop.set()
        polling.join()
        assert len(answers) > 10
        assert set(answers) == {RIGHT}


def test_a_listener_that_changes_keeps_its_address(tmp_path: Path, config: str) -> None:
    config = config.replace("127.0.0.1:0", f"127.0.0.1:{free_port()}")
    with GatewayProcess(tmp_path, config) as gateway, connected(gateway) as client:
        assert asked(client) == RIGHT
        gateway.config.write_text(gateway.config.read_text().replace('name = "scada"', 'name = "scada"\nclients = 3'))
        assert command("reload", "--control", str(tmp_path / "control.sock")).stdout == "changed: listen scada\n"
        assert client.recv(260) == b""
        with connected(gateway) as again:
            assert asked(again) == RIGHT


VERBS = f'"verb" must be one of {", ".join(BY_NAME)}'


@pytest.mark.parametrize(
    ("line", "answer"),
    [
        (b"hello\n", "this is not JSON"),
        (b"[]\n", VERBS),
        (b'{"verb": ["status"]}\n', VERBS),
    ],
)
def test_nonsense_gets_an_answer(tmp_path: Path, config: str, line: bytes, answer: str) -> None:
    with GatewayProcess(tmp_path, config) as gateway, socket.socket(socket.AF_UNIX) as client:
        client.settimeout(PATIENCE)
        client.connect(str(tmp_path / "control.sock"))
        client.sendall(line)
        refusal = {"version": __version__, "ok": False, "error": answer}
        with client.makefile() as answers:
            assert json.loads(answers.readline()) == refusal
        with suppress(ConnectionError):  # it closes without having read all of it
            client.sendall(b"x" * 100_000)
            assert client.recv(100) == b""
        assert gateway.stop() == 0
        assert not gateway.rest


def test_commands_that_ask_the_daemon_load_nothing_that_takes_long() -> None:
    verbs = ("status", "reload", "read", "write", "trace", "bench", "doctor", "scan")
    script = f"import sys; {'; '.join(f'import gateway.cli.verbs.{verb}' for verb in verbs)}; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout.split()
    assert not {"asyncio", "gateway.config.load", "pydantic", "pymodbus", "structlog"} & set(loaded)
