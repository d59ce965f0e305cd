"""A gateway that ends while an answer is overdue, and the next one on the same port: nobody is given that answer."""

import socket
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from gateway.modbus.rtu import encode
from kit.device import SimulatedDevice, SimulatedLine
from kit.process import PATIENCE, GatewayProcess
from kit.pty import VirtualPort
from kit.serial_line import SerialDevices

#: When the answer about register 7 comes, and until when it may come, in seconds.
LATE, WINDOW = 2.5, 20.0


@pytest.fixture
def config(tmp_path: Path) -> Iterator[str]:
    """A line whose device answers the first question late. Each register holds its own address."""
    device = SimulatedDevice(1, delay=0.3)
    device.holding = list(range(200))
    device.script.append([(LATE, encode(1, b"\x03\x02\x00\x07"))])
    with VirtualPort(tmp_path / "hall-a") as port, SerialDevices({port: SimulatedLine("rtu", device)}):
        yield f"""
[[listen]]
bind = "tcp://127.0.0.1:0"

[[line]]
name = "hall-a"
port = "{tmp_path / "hall-a"}"
timeout = "500 ms"
late_window = "{WINDOW:g} s"
devices = [{{ unit = 1 }}]
"""


def connected(gateway: GatewayProcess) -> socket.socket:
    return socket.create_connection(("127.0.0.1", gateway.port), timeout=PATIENCE)


def ask(client: socket.socket, register: int) -> None:
    client.sendall(bytes((0, 1, 0, 0, 0, 6, 1, 3, 0, register, 0, 1)))


def answers_about_8(gateway: GatewayProcess, until: float) -> set[str]:
    """All answers to the same question: until this time, and until it is answered."""
    answers = set()
    with connected(gateway) as client:
        while time.monotonic() < until or "03 02 00 08" not in answers:
            ask(client, 8)
            answers.add(client.recv(260)[7:].hex(" "))
            assert time.monotonic() < until + PATIENCE
            time.sleep(0.02)
    return answers


def test_an_answer_that_comes_after_a_restart_is_not_believed(tmp_path: Path, config: str) -> None:
    with GatewayProcess(tmp_path, config) as gateway, connected(gateway) as client:
        asked_at = time.monotonic()
        ask(client, 7)
        assert client.recv(260)[7:] == b"\x83\x0b"
        assert gateway.stop() == 0
    with GatewayProcess(tmp_path, config) as gateway:
        assert answers_about_8(gateway, asked_at + LATE + 1.0) <= {"83 0b", "03 02 00 08"}
