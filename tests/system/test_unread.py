"""What has come while a gateway could not read, on real ports: it came before whatever the gateway sends next.

The gateway is stopped for a moment, as a busy machine stops it. When it goes on, the system has got a request for it
and, behind that, bytes from the line.
"""

import signal
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol, Self

import pytest

from gateway.modbus import mbap
from gateway.modbus.rtu import encode
from kit.process import PATIENCE, GatewayProcess
from kit.pty import VirtualPort

READ = bytes.fromhex("03 0010 0001")
STRAY, ANSWER, OTHER_ANSWER = (bytes.fromhex(f"03 02 {value}") for value in ("EEEE", "5555", "7777"))
ROUNDS = 5

LINE = """
[[listen]]
bind = "{scheme}://127.0.0.1:0"

[[line]]
name = "hall-a"
port = "{port}"
baud = 9600
format = "8N1"
devices = [{{ unit = 1, timeout = "5 s" }}]
"""
PANEL = """
[[line]]
name = "panel"
port = "{port}"
baud = 9600
format = "8N1"
role = "server"
serves = [1]
answer_within = "10 s"
"""


class Devices(Protocol):
    """The devices' end of a line."""

    def write(self, data: bytes) -> None: ...

    def read(self, size: int) -> bytes: ...


class DeviceServer:
    """One connection of the gateway's, accepted when it is needed."""

    def __init__(self) -> None:
        self._door = socket.create_server(("127.0.0.1", 0))
        self._door.settimeout(PATIENCE)
        self.port = f"rtu+tcp://127.0.0.1:{self._door.getsockname()[1]}"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._line.close()
        self._door.close()

    def accept(self) -> None:
        self._line, _ = self._door.accept()
        self._line.settimeout(PATIENCE)

    def write(self, data: bytes) -> None:
        self._line.sendall(data)

    def read(self, size: int) -> bytes:
        return self._line.recv(size, socket.MSG_WAITALL)


def line_at(port: str, scheme: str = "tcp") -> str:
    """A config: clients that speak `scheme`, and a line at `port`."""
    return LINE.format(port=port, scheme=scheme)


@contextmanager
def stopped(gateway: GatewayProcess) -> Iterator[None]:
    """The gateway stands still; what is sent to it meanwhile waits for it with the system."""
    gateway.signal(signal.SIGSTOP)
    until(lambda: Path(f"/proc/{gateway.pid}/stat").read_text().rpartition(") ")[2].startswith("T"))
    try:
        yield
    finally:
        gateway.signal(signal.SIGCONT)


def come(line: Devices, data: bytes) -> None:
    """The devices say `data`, and the system has it for the gateway, which stands still; on a connection at once."""
    line.write(data)
    if isinstance(line, VirtualPort):
        until(lambda: line.unread >= len(data))


def until(is_so: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE
    while not is_so():
        assert time.monotonic() < deadline
        time.sleep(0.001)


def wrong_answers(gateway: GatewayProcess, line: Devices) -> list[bytes]:
    """What a client got that was not the answer to its request."""
    answers = []
    with socket.create_connection(("127.0.0.1", gateway.port), timeout=PATIENCE) as client:
        for identifier in range(ROUNDS):
            time.sleep(0.05)
            with stopped(gateway):
                client.sendall(mbap.encode(identifier, 1, READ))
                come(line, encode(1, STRAY))
            assert line.read(len(encode(1, READ))) == encode(1, READ)
            time.sleep(0.05)
            line.write(encode(1, ANSWER))
            answers.append(client.recv(300)[7:])
    return [answer for answer in answers if answer != ANSWER]


def test_what_stood_unread_on_a_serial_port_is_no_answer(tmp_path: Path) -> None:
    with VirtualPort(tmp_path / "line") as line, GatewayProcess(tmp_path, line_at(line.path)) as gateway:
        assert wrong_answers(gateway, line) == []


def test_what_stood_unread_on_a_connection_to_a_device_server_is_no_answer(tmp_path: Path) -> None:
    with DeviceServer() as server, GatewayProcess(tmp_path, line_at(server.port)) as gateway:
        server.accept()
        assert wrong_answers(gateway, server) == []


@pytest.mark.parametrize("asked_again", [READ, bytes.fromhex("03 0063 0001")])
def test_no_answer_goes_out_on_a_server_line_behind_the_next_request(tmp_path: Path, asked_again: bytes) -> None:
    with VirtualPort(tmp_path / "line") as line, VirtualPort(tmp_path / "panel") as panel:
        config = line_at(line.path) + PANEL.format(port=panel.path)
        with GatewayProcess(tmp_path, config) as gateway:
            for _ in range(ROUNDS):
                panel.write(encode(1, READ))
                assert line.read(len(encode(1, READ))) == encode(1, READ)
                with stopped(gateway):
                    come(line, encode(1, ANSWER))
                    come(panel, encode(1, asked_again))
                assert line.read(len(encode(1, asked_again))) == encode(1, asked_again)
                line.write(encode(1, OTHER_ANSWER))
                assert panel.read(len(encode(1, OTHER_ANSWER))) == encode(1, OTHER_ANSWER)
                time.sleep(0.05)


@pytest.mark.parametrize("asked_again", [READ, bytes.fromhex("03 0063 0001")])
def test_no_answer_goes_to_an_rtu_client_behind_its_next_request(tmp_path: Path, asked_again: bytes) -> None:
    with (
        VirtualPort(tmp_path / "line") as line,
        GatewayProcess(tmp_path, line_at(line.path, "rtu+tcp")) as gateway,
        socket.create_connection(("127.0.0.1", gateway.port), timeout=PATIENCE) as client,
    ):
        resent = 0
        for _ in range(ROUNDS):
            client.sendall(encode(1, READ))
            assert line.read(len(encode(1, READ))) == encode(1, READ)
            time.sleep(0.5)  # requests within 50 ms of one another were sent together, if the machine is quick
            with stopped(gateway):
                come(line, encode(1, ANSWER))
                client.sendall(encode(1, asked_again))
            heard = line.read(len(encode(1, asked_again)), timeout=5.0)
            if not heard:  # the gateway stood still before, too: then it answers neither of them
                resent += 1
                client.sendall(encode(1, asked_again))
                heard = line.read(len(encode(1, asked_again)))
            assert heard == encode(1, asked_again)
            line.write(encode(1, OTHER_ANSWER))
            assert client.recv(300) == encode(1, OTHER_ANSWER)
            time.sleep(0.05)
        assert resent < ROUNDS
