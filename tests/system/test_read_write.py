"""`read` and `write` as processes: through a daemon, on a port without one, and against other Modbus TCP servers."""

import json
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import pytest

from kit.free_port import free_port
from kit.process import COMMAND, PATIENCE, GatewayProcess, command, simulated

CONFIG = """
[[listen]]
bind = "tcp://127.0.0.1:0"

[[line]]
name = "hall"
port = "{port}"
baud = 9600

[[line.devices]]
unit = 1
as = 41
name = "silo-1"
profile = "weigher"
timeout = "20 s"
points = [{{ name = "own", holding = 16 }}]

[[line.devices]]
unit = 6
as = 46
name = "press"
profile = "v80"
timeout = "20 s"

[control]
socket = "{control}"
"""

BEHIND_A_DEVICE_SERVER = """
[[listen]]
bind = "tcp://127.0.0.1:0"

[[line]]
name = "roof"
port = "rtu+tcp://127.0.0.1:{number}"
baud = 9600

[control]
socket = "{control}"
"""

#: A pymodbus server with registers 0-199 of unit 3, each of which holds its address, and a few coils.
PYMODBUS = """
import asyncio, sys, warnings
warnings.simplefilter("ignore")
from pymodbus.datastore import ModbusDeviceContext, ModbusSequentialDataBlock, ModbusServerContext
from pymodbus.server import StartAsyncTcpServer

device = ModbusDeviceContext(
    hr=ModbusSequentialDataBlock(1, list(range(200))), co=ModbusSequentialDataBlock(1, [True, False, True] * 4)
)
context = ModbusServerContext(devices={3: device}, single=False)
asyncio.run(StartAsyncTcpServer(context, address=("127.0.0.1", int(sys.argv[1]))))
"""


@contextmanager
def pymodbus_server() -> Iterator[str]:
    """A server of pymodbus; its address."""
    number = free_port()
    with subprocess.Popen([sys.executable, "-c", PYMODBUS, str(number)]) as process:
        try:
            while True:
                try:
                    socket.create_connection(("127.0.0.1", number), timeout=PATIENCE).close()
                    break
                except ConnectionRefusedError:
                    assert process.poll() is None
                    time.sleep(0.05)
            yield f"127.0.0.1:{number}"
        finally:
            process.kill()


def values(*words: str) -> list[object]:
    """What `read --json` says."""
    done = command("read", *words, "--json")
    assert done.returncode == 0, done.stderr
    return [each["value"] for each in json.loads(done.stdout)["values"]]


@pytest.fixture
def port(tmp_path: Path) -> Iterator[Path]:
    path = tmp_path / "hall"
    with simulated(path, "weigher:1", "v80:6", "--weight", "4999.66"):
        yield path


def test_through_the_daemon(tmp_path: Path, port: Path) -> None:
    control = str(tmp_path / "control.sock")
    at = ("--control", control)
    with GatewayProcess(tmp_path, CONFIG.format(port=port, control=control)) as gateway:
        assert values("silo-1", *at) == [4999.66, 9600, 1, 1]
        assert values("46", "holding", "107-109", *at) == [99, 99, 99]
        written = command("write", "press", "register-40136", "926", "--show", *at)
        assert written.returncode == 0, written.stderr
        assert written.stdout.splitlines()[1].split()[:3] == ["register-40136", "0", "926"]
        audit = gateway.wait_for("write_audit")
        assert (audit["client"], audit["unit"], audit["result"]) == ("control", 46, "ok")
        assert command("write", "silo-1", "zero", "take", *at).returncode == 0
        assert values("silo-1", "weight", *at) == [0]
        refused = command("read", "press", "holding", "5000", *at)
        assert (refused.returncode, refused.stdout) == (1, "")
        assert "exception 02, illegal data address" in refused.stderr
        busy = command("read", "6", "holding", "0", "--port", str(port), "--baud", "9600")
        assert busy.returncode == 1
        assert "leave out --port to go through it" in busy.stderr


def test_points_count_after_a_reload_and_the_line_stays_open(tmp_path: Path, port: Path) -> None:
    control = str(tmp_path / "control.sock")
    at = ("--control", control)
    with GatewayProcess(tmp_path, CONFIG.format(port=port, control=control)) as gateway:
        gateway.config.write_text(gateway.config.read_text().replace('name = "own"', 'name = "number"'))
        assert command("reload", *at).stdout == f"nothing has changed in {gateway.config}\n"
        assert values("silo-1", "number", *at) == [1]
        assert gateway.stop() == 0
        assert [event["event"] for event in gateway.log].count("line_up") == 1


def test_rights_hold_for_the_control_socket_once_a_row_names_it(tmp_path: Path, port: Path) -> None:
    control = str(tmp_path / "control.sock")
    rows = '[[access]]\nlisten = ["control"]\nallow = ["read"]\n'
    with GatewayProcess(tmp_path, CONFIG.format(port=port, control=control) + rows):
        assert values("press", "register-40108", "--control", control) == [99]
        denied = command("write", "press", "register-40136", "1", "--control", control)
        assert denied.returncode == 1
        assert "exception 01, illegal function: [[access]] does not allow it for the control socket" in denied.stderr


def test_on_a_port_without_a_daemon(port: Path) -> None:
    at = ("--port", str(port), "--baud", "9600", "--timeout", "20s")
    assert values("1", "--profile", "weigher", *at) == [4999.66, 9600, 1]
    assert values("6", "holding", "107-109", *at) == [99, 99, 99]
    assert command("write", "1", "zero", "take", "--profile", "weigher", *at).returncode == 0
    assert values("1", "weight", "--profile", "weigher", *at) == [0]
    shown = command("read", "6", "holding", "107-109", "--raw", *at).stdout.splitlines()
    assert shown[:2] == ["> 06 03 00 6B 00 03 75 A0", "< 06 03 06 00 63 00 63 00 63 73 7A"]  # the document's
    silent = command("read", "9", "holding", "0", *at[:4], "--timeout", "300ms")
    assert silent.returncode == 1
    assert "unit 9: no response; the limit is 0.3 s" in silent.stderr
    unknown = command("write", "9", "holding", "0", "1", *at[:4], "--timeout", "300ms")
    assert unknown.stderr.endswith("\n  note: the write may have been carried out\n")


def test_in_ascii_on_a_port(tmp_path: Path) -> None:
    path = tmp_path / "motion"
    with simulated(path, "mint:2"):
        at = ("--port", str(path), "--profile", "mint", "--timeout", "20s")
        written = command("write", "2", "comms-29", "-5", "--raw", *at)
        assert (written.returncode, written.stdout.splitlines()[0]) == (0, "> :0210001D000102FFFBD4")
        assert values("2", "comms-29", "output-3", *at) == [-5, 0]
        assert values("2", "holding", "29", "int16", "--port", str(path), "--mode", "ascii", "--timeout", "20s") == [-5]


def test_against_the_server_of_pymodbus() -> None:
    with pymodbus_server() as address:
        at = ("--tcp", address, "--timeout", "20s")
        assert values("3", "holding", "0-129", *at) == list(range(130))
        assert values("3", "coils", "0-3", *at) == [1, 0, 1, 1]
        assert values("3", "holding", "1", "int32", "--swap", "words", *at) == [0x20001]
        shown = command("write", "3", "holding", "5", "1.5", "-2.5", "float32", "--show", "--json", *at)
        assert [each["value"] for each in json.loads(shown.stdout)["values"]] == [1.5, -2.5]
        assert values("3", "holding", "5-8", *at) == [0x3FC0, 0, 0xC020, 0]
        assert command("write", "3", "coils", "1", "on", *at).returncode == 0
        assert values("3", "coils", "0-3", *at) == [1, 1, 1, 1]
        wrong = command("read", "3", "holding", "300", *at)
        assert (wrong.returncode, wrong.stderr) == (1, "unit 3, holding 300: exception 02, illegal data address\n")


@pytest.mark.needs("mbpoll")
def test_mbpoll_sees_what_was_written_and_the_help_for_it_means_the_same(tmp_path: Path, port: Path) -> None:
    control = str(tmp_path / "control.sock")
    at = ("--control", control)
    with GatewayProcess(tmp_path, CONFIG.format(port=port, control=control)) as gateway:
        assert command("write", "press", "holding", "20", "1.5", "float32", *at).returncode == 0
        theirs = ["-a", "46", "-t", "4:float", "-B", "-r", "21", "-1"]
        seen = subprocess.run(
            ["mbpoll", "-o", "10", "-p", str(gateway.port), *theirs, "127.0.0.1"],
            capture_output=True,
            text=True,
            check=True,
        )
        assert "[21]: \t1.5" in seen.stdout
        told = command("read", *theirs[:-1])
        assert told.returncode == 2
        words = told.stderr.split("help: modbus-gateway read ")[1].split()
        assert values(*words, *at) == [1.5]


def test_a_device_server_of_the_gateway_is_not_asked_beside_it(tmp_path: Path) -> None:
    control = str(tmp_path / "control.sock")
    with socket.create_server(("127.0.0.1", 0)) as server:
        number = server.getsockname()[1]
        with GatewayProcess(tmp_path, BEHIND_A_DEVICE_SERVER.format(number=number, control=control)):
            at = ("--port", f"rtu+tcp://localhost:{number}", "--control", control)
            for words in (["read", "1", "holding", "0"], ["write", "1", "holding", "0", "1"], ["scan", "1"]):
                refused = command(*words, *at)
                assert (refused.returncode, refused.stdout) == (1, "")
                assert f"rtu+tcp://localhost:{number} is the port of line roof of the running gateway" in refused.stderr
                assert "leave out --port to go through it" in refused.stderr


def test_a_device_server_that_somebody_else_uses_says_so() -> None:
    def turn_away(server: socket.socket) -> None:
        server.settimeout(PATIENCE)
        connection, _ = server.accept()
        with connection:
            connection.sendall(b"Port already in use\r\n")

    with socket.create_server(("127.0.0.1", 0)) as server, ThreadPoolExecutor() as pool:
        port = f"rtu+tcp://127.0.0.1:{server.getsockname()[1]}"
        for _ in range(3):  # on a machine that stands still the server may close too late for "at once"
            turning_away = pool.submit(turn_away, server)
            done = command("write", "1", "holding", "0", "1", "--port", port)
            turning_away.result(PATIENCE)
            if "the response is damaged" not in done.stderr:
                break
    assert done.returncode == 1
    assert f"{port} takes the connection and closes it at once: is somebody else connected?" in done.stderr
    assert "may have been carried out" not in done.stderr


def test_a_server_that_closes_without_an_answer_may_want_tls() -> None:
    def close_after_request(server: socket.socket) -> None:
        connection, _ = server.accept()
        with connection:
            connection.recv(100)

    with socket.create_server(("127.0.0.1", 0)) as server, ThreadPoolExecutor() as pool:
        closing = pool.submit(close_after_request, server)
        done = command("read", "1", "holding", "0", "--tcp", f"127.0.0.1:{server.getsockname()[1]}")
        closing.result(PATIENCE)
    assert done.returncode == 1
    assert "is this port one without TLS? No command speaks TLS" in done.stderr


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["--port", "/dev/none-there"], "/dev/none-there does not exist: is the adapter plugged in?"),
        (["--tcp", "127.0.0.1:1"], "127.0.0.1:1 cannot be reached: Connection refused"),
        (["--control", "/nowhere/control.sock"], "no running gateway found"),
    ],
)
def test_what_cannot_be_reached_is_a_problem_in_plain_words(words: list[str], complaint: str) -> None:
    done = command("read", "1", "holding", "0", *words)
    assert (done.returncode, done.stdout) == (1, "")
    assert complaint in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["silo-1", "--tcp", "127.0.0.1"], '"silo-1" is a name, and only a running gateway knows names'),
        (["0", "holding", "0", "--port", "/dev/x"], "0 is not a unit number\n  help: units are 1 to 255"),
        (["256", "holding", "0", "--tcp", "x"], "256 is not a unit number"),
        (
            ["1", "--tcp", "127.0.0.1", "--profile", "mnt"],
            'there is no profile "mnt"\n  help: did you mean "mint"? modbus-gateway profile list shows all',
        ),
        (["1", "holding", "0", "--tcp", "a b"], "write --tcp 10.1.0.5, or --tcp 10.1.0.5:502"),
        (["1", "holding", "0", "--port", "ttyUSB0"], 'did you mean "/dev/ttyUSB0"?'),
        (["1", "holding", "0", "--port", "/dev/x", "--format", "7E1"], "is it --mode ascii?"),
        (["1", "holding", "0", "--port", "/dev/x", "--format", "9E1"], '"9E1" is not a valid character format'),
    ],
)
def test_ways_that_cannot_be_meant_are_answered_with_what_to_type(words: list[str], complaint: str) -> None:
    done = command("read", *words)
    assert (done.returncode, done.stdout) == (2, "")
    assert complaint in done.stderr


def test_ctrl_c_ends_a_reading_that_repeats(port: Path) -> None:
    at = ("--port", str(port), "--baud", "9600", "--timeout", "20s")
    words = ["read", "6", "holding", "107", "-i", "50ms", *at]
    with subprocess.Popen([*COMMAND, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as reading:
        shown = [reading.stdout.readline() for _ in range(3)]
        reading.send_signal(signal.SIGINT)
        _, complaint = reading.communicate(timeout=PATIENCE)
    assert [line.split()[1:] for line in shown] == [
        ["ADDRESS", "REFERENCE", "VALUE", "HEX"],
        ["107", "40108", "99", "0063"],
        ["107", "40108", "99", "0063"],
    ]
    assert (reading.returncode, complaint) == (130, "")
