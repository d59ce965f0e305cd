"""`run` as a process: it starts, is ready, serves, stops, and says what is wrong in one line."""

import json
import os
import resource
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from io import RawIOBase
from pathlib import Path

import pytest

from kit.device import SimulatedDevice, SimulatedLine
from kit.process import COMMAND, PATIENCE, GatewayProcess, command, started_anew
from kit.pty import VirtualPort
from kit.serial_line import SerialDevices

CONFIG = """
[[listen]]
bind = "tcp://127.0.0.1:0"

[[line]]
name = "hall-a"
port = "{port}"
timeout = "20 s"
"""
#: What a gateway without [web] does not use once it has its plan.
NOT_NEEDED = {
    *(
        "pydantic",
        "pydantic_core",
        "tomllib",
        "gateway.config.schema.config",
        "gateway.config.load",
        "gateway.config.check",
    ),
    *(
        "gateway.config.resolve",
        "gateway.config.reading.wording",
    ),
    *("gateway.web.front.opening", "aiohttp", "jinja2", "prometheus_client", "structlog", "pymodbus", "statistics"),
}
READ = bytes.fromhex("0001 0000 0006 01 03 0000 0001")


@pytest.fixture
def _as_an_operator_does() -> Iterator[None]:
    with started_anew():
        yield


#: Tests of what comes before the command and after it; others begin at the command.
as_an_operator_does = pytest.mark.usefixtures("_as_an_operator_does")


@pytest.fixture
def config(tmp_path: Path) -> str:
    return CONFIG.format(port=tmp_path / "hall-a")


def ask(gateway: GatewayProcess) -> bytes:
    with socket.create_connection(("127.0.0.1", gateway.port), timeout=PATIENCE) as client:
        client.sendall(READ)
        return client.recv(260)


def until(condition: Callable[[], object]) -> None:
    """Wait for something that should come."""
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.005)


def processor_time(gateway: GatewayProcess) -> float:
    """Seconds of processor time that the gateway has used."""
    fields = Path(f"/proc/{gateway.pid}/stat").read_text().rsplit(") ", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@as_an_operator_does
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


@as_an_operator_does
def test_nothing_is_loaded_that_is_not_needed_once_there_is_a_plan(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("PYTHONPROFILEIMPORTTIME", "1")  # each import is a line on standard error
    with GatewayProcess(
        tmp_path, '[[listen]]\nbind = "tcp://127.0.0.1:0"\n[[image]]\nunit = 1\nholding = 8\n'
    ) as gateway:
        assert len(ask(gateway)) == 11
        gateway.signal(signal.SIGHUP)
        gateway.wait_for("config_applied")
        assert gateway.stop() == 0
    loaded = {line.rpartition("|")[2].strip() for line in gateway.rest}
    assert {"asyncio", "gateway.service.daemon"} <= loaded
    assert loaded & NOT_NEEDED == set()


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
        until(lambda: slow.heard)
        gateway.signal(signal.SIGTERM)
        assert client.recv(260).hex() == "000100000005010302" + "0000"
        assert client.recv(1) == b""
        assert gateway.wait() == 0


@as_an_operator_does
def test_a_second_signal_does_not_wait_for_requests(tmp_path: Path, config: str) -> None:
    silent = SimulatedDevice(1)
    silent.silent = True
    patient = config.replace("20 s", "60 s")
    with (
        VirtualPort(tmp_path / "hall-a") as port,
        SerialDevices({port: SimulatedLine("rtu", silent)}),
        GatewayProcess(tmp_path, patient) as gateway,
        socket.create_connection(("127.0.0.1", gateway.port), timeout=PATIENCE) as client,
    ):
        client.sendall(READ)
        until(lambda: silent.heard)
        gateway.signal(signal.SIGINT)
        gateway.wait_for("stopping")
        gateway.signal(signal.SIGINT)
        assert gateway.wait() == 0
    assert gateway.rest == []


def test_a_request_that_would_take_longer_than_the_end_is_answered_all_the_same(tmp_path: Path, config: str) -> None:
    """0B for what was sent, 0A for what still waits."""
    silent = SimulatedDevice(1, delay=60.0)
    patient = f'{config.replace("20 s", "1 min")}max_wait = "1 min"\n'
    with (
        VirtualPort(tmp_path / "hall-a") as port,
        SerialDevices({port: SimulatedLine("rtu", silent)}),
        GatewayProcess(tmp_path, patient) as gateway,
        socket.create_connection(("127.0.0.1", gateway.port), timeout=PATIENCE) as client,
    ):
        client.sendall(READ + b"\0\2" + READ[2:])
        until(lambda: silent.heard)
        assert gateway.stop() == 0
        assert client.recv(18, socket.MSG_WAITALL).hex() == "00010000000301" + "830b" + "00020000000301" + "830a"
        assert client.recv(260) == b""


def test_a_client_that_keeps_asking_does_not_hold_up_the_end(tmp_path: Path, config: str) -> None:
    """What it asked before the order is answered, what it asks afterwards is not taken."""
    with (
        VirtualPort(tmp_path / "hall-a") as port,
        SerialDevices({port: SimulatedLine("rtu", SimulatedDevice(1, delay=0.05))}),
        GatewayProcess(tmp_path, config) as gateway,
        socket.create_connection(("127.0.0.1", gateway.port), timeout=PATIENCE) as client,
    ):
        client.sendall(b"".join(map(read, range(4))))
        assert next_answered(client) == 0
        gateway.signal(signal.SIGTERM)
        gateway.wait_for("stopping")
        assert answered_while_asking(client) == {1, 2, 3}
        assert gateway.wait() == 0
    assert gateway.rest == []


def read(transaction: int) -> bytes:
    return transaction.to_bytes(2) + READ[2:]


def next_answered(client: socket.socket) -> int | None:
    """The transaction that is answered next, perhaps by an exception; None when the connection has ended."""
    header = client.recv(6, socket.MSG_WAITALL)
    client.recv(int.from_bytes(header[4:]), socket.MSG_WAITALL)
    return int.from_bytes(header[:2]) if header else None


def answered_while_asking(client: socket.socket) -> set[int]:
    """Ask for more with each response until the gateway closes the connection; the transactions that were answered.

    If the machine stood still meanwhile, by exceptions: the end waits for some seconds at most.
    """
    answered: set[int] = set()
    with suppress(ConnectionError):  # requests that were not taken any more: the system tells it by a reset
        while (transaction := next_answered(client)) is not None:
            answered.add(transaction)
            with suppress(ConnectionError):  # what was answered before is still there
                client.sendall(read(4 + len(answered)))
    return answered


@as_an_operator_does
def test_an_address_in_use_is_said_in_one_line(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        address = f"127.0.0.1:{taken.getsockname()[1]}"
        file = tmp_path / "gateway.toml"
        file.write_text(f'[[listen]]\nbind = "tcp://{address}"\n[[line]]\nport = "/dev/hall-a"\n')
        done = command("run", str(file))
    assert done.returncode == 1
    reason = "another [[listen]] or another program has this port, perhaps another modbus-gateway"
    said = f"modbus-gateway: error: {file.name}:1: cannot listen on tcp://{address}: {reason}"
    assert done.stderr.splitlines()[-1] == said
    assert "Traceback" not in done.stderr


@as_an_operator_does
def test_a_config_with_errors_is_not_run(tmp_path: Path) -> None:
    file = tmp_path / "gateway.toml"
    file.write_text('[[line]]\nport = "/dev/hall-a"\nbuad = 9600\n')
    done = command("run", str(file))
    assert done.returncode == 1
    assert f"{file}:3:1: error: line[0].buad" in done.stderr
    assert "Traceback" not in done.stderr


def test_it_serves_and_ends_although_nothing_reads_its_log(tmp_path: Path) -> None:
    file = tmp_path / "gateway.toml"
    image = '[[listen]]\nbind = "tcp://127.0.0.1:0"\n[[image]]\nunit = 1\nholding = 1\n'
    file.write_text(f'{image}[log]\nformat = "json"\nlevel = "debug"\n')
    own = {**os.environ, "STATE_DIRECTORY": str(tmp_path), "RUNTIME_DIRECTORY": str(tmp_path)}
    log, its_log = os.pipe()
    with (
        os.fdopen(log) as lines,
        os.fdopen(its_log, "wb", buffering=0) as full,
        subprocess.Popen([*COMMAND, "run", file], stderr=full, env=own) as process,
    ):
        try:
            ready = next(event for event in map(json.loads, lines) if event["event"] == "ready")
            fill(full)
            port = int(ready["listeners"][0].rpartition(":")[2])
            for _ in range(5):
                with socket.create_connection(("127.0.0.1", port), timeout=PATIENCE) as client:
                    client.sendall(READ)
                    assert client.recv(260).hex() == "000100000005010302" + "0000"
            process.terminate()
            assert process.wait(PATIENCE) == 0
        finally:
            process.kill()


def fill(pipe: RawIOBase) -> None:
    """Write to a pipe until it is full."""
    os.set_blocking(pipe.fileno(), False)
    for size in (4096, 1):
        while pipe.write(bytes(size)):
            pass
    os.set_blocking(pipe.fileno(), True)


def test_a_signal_to_reload_does_not_end_it(tmp_path: Path, config: str) -> None:
    with GatewayProcess(tmp_path, config) as gateway:
        gateway.signal(signal.SIGHUP)
        assert gateway.wait_for("config_applied")["changed"] == []
        assert gateway.stop() == 0


def test_without_descriptors_it_serves_on_and_accepts_again_when_there_are_some(tmp_path: Path) -> None:
    config = """
    [[listen]]
    bind = "tcp://127.0.0.1:0"
    clients = 1000

    [[image]]
    unit = 1
    holding = 1
    """
    with GatewayProcess(tmp_path, config) as gateway, ExitStack() as crowd:
        old = crowd.enter_context(socket.create_connection(("127.0.0.1", gateway.port), timeout=PATIENCE))
        used = len(list(Path(f"/proc/{gateway.pid}/fd").iterdir()))
        _, hard = resource.prlimit(gateway.pid, resource.RLIMIT_NOFILE)
        resource.prlimit(gateway.pid, resource.RLIMIT_NOFILE, (used + 5, hard))
        spent = processor_time(gateway)
        begun_at = time.monotonic()
        for _ in range(200):
            crowd.enter_context(socket.create_connection(("127.0.0.1", gateway.port), timeout=PATIENCE))
        assert "no file descriptors are left" in gateway.wait_for("client_rejected")["reason"]
        for _ in range(20):
            old.sendall(READ)
            assert old.recv(260).hex() == "000100000005010302" + "0000"
            time.sleep(0.05)
        assert processor_time(gateway) - spent < 0.5 * (time.monotonic() - begun_at)
        resource.prlimit(gateway.pid, resource.RLIMIT_NOFILE, (hard, hard))
        assert ask(gateway).hex() == "000100000005010302" + "0000"
        assert gateway.stop() == 0
    assert gateway.rest == []
    assert not [event for event in gateway.log if "accept" in event["event"] or "traceback" in event]
