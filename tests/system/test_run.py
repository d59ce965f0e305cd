"""`run` as a process: it starts, is ready, serves, stops, and says what is wrong in one line."""

import signal
import socket
from pathlib import Path

import pytest

from kit.device import SimulatedDevice, SimulatedLine
from kit.process import PATIENCE, GatewayProcess, command
from kit.pty import VirtualPort
from kit.serial_line import SerialDevices

CONFIG = """
[[listen]]
bind = "tcp://127.0.0.1:0"

[[line]]
name = "hall-a"
port = "{port}"
"""
READ = bytes.fromhex("0001 0000 0006 01 03 0000 0001")


@pytest.fixture
def config(tmp_path: Path) -> str:
    return CONFIG.format(port=tmp_path / "hall-a")


def ask(gateway: GatewayProcess) -> bytes:
    with socket.create_connection(("127.0.0.1", gateway.port), timeout=PATIENCE) as client:
        client.sendall(READ)
        return client.recv(260)


def test_it_is_ready_serves_and_ends_with_status_0(tmp_path: Path, config: str) -> None:
    devices = SimulatedLine("rtu", SimulatedDevice(1))
    with (
        VirtualPort(tmp_path / "hall-a") as port,
        SerialDevices({port: devices}),
        GatewayProcess(tmp_path, config) as gateway,
    ):
        assert ask(gateway).hex() == "000100000005010302" + "0000"
        assert gateway.stop() == 0
    events = [event["event"] for event in gateway.log]
    assert gateway.log[0]["units"] == 247
    assert events[:4] == ["config_loaded", "line_up", "listener_up", "ready"]
    assert events[-2:] == ["stopping", "stopped"]
    assert gateway.rest == []


def test_an_absent_port_is_answered_0a_and_used_when_it_comes(tmp_path: Path, config: str) -> None:
    with GatewayProcess(tmp_path, config) as gateway:
        assert ask(gateway).hex() == "00010000000301" + "830a"
        with VirtualPort(tmp_path / "hall-a") as port, SerialDevices({port: SimulatedLine("rtu", SimulatedDevice(1))}):
            gateway.wait_for("line_up")
            assert ask(gateway).hex() == "000100000005010302" + "0000"


def test_a_request_under_way_is_answered_before_the_end(tmp_path: Path, config: str) -> None:
    slow = SimulatedDevice(1, delay=0.5)
    with (
        VirtualPort(tmp_path / "hall-a") as port,
        SerialDevices({port: SimulatedLine("rtu", slow)}),
        GatewayProcess(tmp_path, config) as gateway,
        socket.create_connection(("127.0.0.1", gateway.port), timeout=PATIENCE) as client,
    ):
        client.sendall(READ)
        while not slow.heard:
            pass
        gateway.signal(signal.SIGTERM)
        assert client.recv(260).hex() == "000100000005010302" + "0000"
        assert client.recv(1) == b""
        assert gateway.wait() == 0


def test_a_second_signal_does_not_wait_for_requests(tmp_path: Path, config: str) -> None:
    silent = SimulatedDevice(1)
    silent.silent = True
    patient = config + 'timeout = "60 s"\n'
    with (
        VirtualPort(tmp_path / "hall-a") as port,
        SerialDevices({port: SimulatedLine("rtu", silent)}),
        GatewayProcess(tmp_path, patient) as gateway,
        socket.create_connection(("127.0.0.1", gateway.port), timeout=PATIENCE) as client,
    ):
        client.sendall(READ)
        while not silent.heard:
            pass
        gateway.signal(signal.SIGINT)
        gateway.wait_for("stopping")
        gateway.signal(signal.SIGINT)
        assert gateway.wait() == 0
    assert gateway.rest == []


def test_an_address_in_use_is_said_in_one_line(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        address = f"127.0.0.1:{taken.getsockname()[1]}"
        file = tmp_path / "gateway.toml"
        file.write_text(f'[[listen]]\nbind = "tcp://{address}"\n[[line]]\nport = "/dev/hall-a"\n')
        done = command("run", str(file))
    assert done.returncode == 1
    reason = "another program has this port, perhaps another modbus-gateway"
    said = f"modbus-gateway: error: {file.name}:1: cannot listen on tcp://{address}: {reason}"
    assert done.stderr.splitlines()[-1] == said
    assert "Traceback" not in done.stderr


def test_a_config_with_errors_is_not_run(tmp_path: Path) -> None:
    file = tmp_path / "gateway.toml"
    file.write_text('[[line]]\nport = "/dev/hall-a"\nbuad = 9600\n')
    done = command("run", str(file))
    assert done.returncode == 1
    assert f"{file}:3:1: error: line[0].buad" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_signal_to_reload_does_not_end_it(tmp_path: Path, config: str) -> None:
    with GatewayProcess(tmp_path, config) as gateway:
        gateway.signal(signal.SIGHUP)
        assert "reload is not built yet" in gateway.wait_for("config_rejected")["reason"]
        assert gateway.stop() == 0
