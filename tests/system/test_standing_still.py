"""A gateway that stood still, as a paused machine does, sends no client the answer to a request that it has given up.

The clients here do not count. The value of each register is its address, so an answer tells what it is the answer to.
"""

import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from http.client import HTTPConnection
from itertools import count
from pathlib import Path

import pytest

from gateway.modbus import ascii as ascii_framing
from gateway.modbus import mbap, rtu
from kit.pki import OPERATOR, client_context, listener
from kit.process import PATIENCE, GatewayProcess
from kit.pty import VirtualPort
from system.test_unread import DeviceServer

ROUNDS = 5
IMAGE, REMOTE = 200, 1

LISTENERS = {
    "tcp": '[[listen]]\nbind = "tcp://127.0.0.1:0"\n',
    "rtu+tcp": '[[listen]]\nbind = "rtu+tcp://127.0.0.1:0"\n',
    "ascii+tcp": '[[listen]]\nbind = "ascii+tcp://127.0.0.1:0"\n',
}
UNITS = """
[[line]]
name = "hall-a"
port = "{port}"
baud = 9600
format = "8N1"
devices = [{{ unit = 1, timeout = "60 s" }}]

[[image]]
unit = 200
holding = 100
initial.holding = [{{ at = 0, values = {values} }}]
"""
PANEL = """
[[listen]]
bind = "tcp://127.0.0.1:0"

[[line]]
name = "panel"
port = "{port}"
baud = 9600
format = "8N1"
role = "server"
serves = [200]
answer_within = "500 ms"

[[image]]
unit = 200
holding = 100
"""


def adu(scheme: str, unit: int, pdu: bytes) -> bytes:
    """As clients send it that have one identifier for all requests, or none."""
    if scheme in ("tcp", "tls"):
        return mbap.encode(1, unit, pdu)
    return (rtu if scheme == "rtu+tcp" else ascii_framing).encode(unit, pdu)


def asking(address: int) -> bytes:
    return bytes((3, 0, address, 0, 1))


def answering(address: int) -> bytes:
    return bytes((3, 2, 0, address))


@contextmanager
def running(folder: Path, scheme: str, port: str, more: str = "") -> Iterator[GatewayProcess]:
    listen = listener() if scheme == "tls" else LISTENERS[scheme]
    with GatewayProcess(folder, listen + UNITS.format(port=port, values=list(range(100))) + more) as gateway:
        yield gateway


def connected(gateway: GatewayProcess, scheme: str) -> socket.socket:
    client = socket.create_connection(("127.0.0.1", gateway.port), timeout=PATIENCE)
    client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return client_context(OPERATOR).wrap_socket(client, server_hostname="localhost") if scheme == "tls" else client


@contextmanager
def stopped(gateway: GatewayProcess) -> Iterator[None]:
    """The gateway stands still: what is sent to it waits for it with the system."""
    gateway.signal(signal.SIGSTOP)
    while Path(f"/proc/{gateway.pid}/stat").read_text().rpartition(")")[2].split()[0] != "T":
        time.sleep(0.001)
    try:
        yield
    finally:
        time.sleep(0.01)
        gateway.signal(signal.SIGCONT)


@pytest.mark.parametrize("connects", ["once", "anew"])
@pytest.mark.parametrize("scheme", ["tcp", "tls"])
def test_no_answer_goes_to_a_client_behind_its_next_request(tmp_path: Path, scheme: str, connects: str) -> None:
    heard = []
    with DeviceServer() as server, running(tmp_path, scheme, server.port) as gateway:
        server.accept()
        client = connected(gateway, scheme)
        for given_up in range(0, 2 * ROUNDS, 2):
            if connects == "anew":
                client.close()
                client = connected(gateway, scheme)
            client.sendall(adu(scheme, REMOTE, asking(given_up)))
            assert server.read(8) == rtu.encode(REMOTE, asking(given_up))
            with stopped(gateway):
                server.write(rtu.encode(REMOTE, answering(given_up)))
                client.sendall(adu(scheme, REMOTE, asking(given_up + 1)))
            assert server.read(8) == rtu.encode(REMOTE, asking(given_up + 1))
            server.write(rtu.encode(REMOTE, answering(given_up + 1)))
            heard.append(client.recv(99)[7:] == answering(given_up + 1))
        client.close()
    assert heard == ROUNDS * [True]


@pytest.mark.parametrize("scheme", ["tcp", "rtu+tcp", "ascii+tcp"])
def test_of_requests_that_one_stand_still_has_gathered_the_earlier_one_is_not_answered(
    tmp_path: Path, scheme: str
) -> None:
    heard = []
    with DeviceServer() as server, running(tmp_path, scheme, server.port) as gateway:
        server.accept()
        for _ in range(ROUNDS):
            with connected(gateway, scheme) as client:
                client.sendall(adu(scheme, IMAGE, asking(0)))
                assert client.recv(99) == adu(scheme, IMAGE, answering(0))
                with stopped(gateway):
                    client.sendall(adu(scheme, IMAGE, asking(1)))
                    time.sleep(0.3)  # its time-out
                    client.sendall(adu(scheme, IMAGE, asking(2)))
                asked, answer = first_answer(client, lambda address: adu(scheme, IMAGE, asking(address)), 2)
                heard.append(answer == adu(scheme, IMAGE, answering(asked)))
    assert heard == ROUNDS * [True]


@pytest.mark.parametrize("scheme", ["rtu+tcp", "ascii+tcp"])
def test_nor_is_it_when_an_answer_to_a_still_earlier_one_has_come_and_the_loop_has_much_to_do(
    tmp_path: Path, scheme: str
) -> None:
    heard = []
    with (
        DeviceServer() as server,
        running(tmp_path, scheme, server.port, '[web]\nbind = "http://127.0.0.1:0"\n') as gateway,
        asking_the_page(gateway, 3),
    ):
        server.accept()
        for _ in range(ROUNDS):
            with connected(gateway, scheme) as client:
                client.sendall(adu(scheme, REMOTE, asking(0)))
                assert server.read(8) == rtu.encode(REMOTE, asking(0))
                with stopped(gateway):
                    server.write(rtu.encode(REMOTE, answering(0)))
                    client.sendall(adu(scheme, IMAGE, asking(1)))
                    time.sleep(0.3)  # its time-out
                    client.sendall(adu(scheme, IMAGE, asking(2)))
                asked, answer = first_answer(client, lambda address: adu(scheme, IMAGE, asking(address)), 2)
                heard.append(answer == adu(scheme, IMAGE, answering(asked)))
    assert heard == ROUNDS * [True]


@contextmanager
def asking_the_page(gateway: GatewayProcess, clients: int) -> Iterator[None]:
    """So many clients of the page give the loop something to do beside Modbus."""
    port = next(int(each["address"].rpartition(":")[2]) for each in gateway.log if each["event"] == "web_up")
    is_over = threading.Event()

    def ask() -> None:
        page = HTTPConnection("127.0.0.1", port, timeout=PATIENCE)
        while not is_over.is_set():
            page.request("GET", "/healthz")
            page.getresponse().read()
        page.close()

    with ThreadPoolExecutor(clients) as pool:
        asked = [pool.submit(ask) for _ in range(clients)]
        try:
            yield
        finally:
            is_over.set()
    for each in asked:
        each.result()


def test_a_client_on_a_server_line_that_has_given_up_gets_no_answer(tmp_path: Path) -> None:
    """It may not have asked again yet, and take the answer for that to its next request."""
    with VirtualPort(tmp_path / "panel") as panel, GatewayProcess(tmp_path, PANEL.format(port=panel.path)) as gateway:
        gateway.first("line_up")
        for given_up in range(2):
            with stopped(gateway):
                panel.write(rtu.encode(IMAGE, asking(given_up)))
                time.sleep(0.6)  # its time-out
            while logged(gateway, "answer_withheld") <= given_up:
                assert panel.read(1, timeout=0.05) == b""


def logged(gateway: GatewayProcess, event: str) -> int:
    return sum(each["event"] == event for each in gateway.log)


def first_answer(client: socket.socket, request: Callable[[int], bytes], asked: int) -> tuple[int, bytes]:
    """Ask on, with a time-out that grows, until there is an answer; the address that was asked last, and the answer."""
    for attempt in count(1):
        client.settimeout(attempt)
        try:
            return asked, client.recv(99)
        except TimeoutError:
            asked += 1
            client.sendall(request(asked))
    raise AssertionError
