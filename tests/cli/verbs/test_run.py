"""`run` as a process, as far as its own output is concerned."""

import fcntl
import json
import os
import signal
import socket
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from kit.free_port import free_port
from kit.process import COMMAND, PATIENCE


@pytest.fixture(name="free_port")
def port() -> int:
    return free_port()


def own(folder: Path) -> dict[str, str]:
    """The environment of a gateway that shares neither its state nor its control socket with others."""
    return {**os.environ, "STATE_DIRECTORY": str(folder), "RUNTIME_DIRECTORY": str(folder)}


def can_connect(port: int) -> bool:
    try:
        socket.create_connection(("127.0.0.1", port), timeout=PATIENCE).close()
    except OSError:
        return False
    return True


def until(is_so: Callable[[], bool], otherwise: str) -> None:
    end = time.monotonic() + PATIENCE
    while not is_so():
        assert time.monotonic() < end, otherwise
        time.sleep(0.05)


def exchange(port: int) -> bytes:
    with socket.create_connection(("127.0.0.1", port), timeout=PATIENCE) as client:
        client.sendall(bytes.fromhex("0001 0000 0006 C8 03 0000 0001"))
        return client.recv(260)


def test_a_log_that_nobody_reads_stops_neither_the_gateway_nor_its_end(tmp_path: Path, free_port: int) -> None:
    config = tmp_path / "gateway.toml"
    config.write_text(
        f'[[listen]]\nbind = "tcp://127.0.0.1:{free_port}"\n[[image]]\nunit = 200\nholding = 1\n'
        '[log]\nlevel = "debug"\nformat = "json"\n'
    )
    with subprocess.Popen([*COMMAND, "run", str(config)], stderr=subprocess.PIPE, env=own(tmp_path)) as process:
        try:
            assert process.stderr is not None
            # Room for a page of log, and enough clients to fill it many times.
            fcntl.fcntl(process.stderr, fcntl.F_SETPIPE_SZ, 4096)
            while b'"ready"' not in process.stderr.readline():
                pass
            for turn in range(200):
                assert exchange(free_port).hex() == "000100000005c8030200" + "00", turn
            process.send_signal(signal.SIGTERM)
            assert process.wait(PATIENCE) == 0
        finally:
            process.kill()


def test_it_reads_its_config_again_though_nobody_can_hear_of_it(tmp_path: Path, free_port: int) -> None:
    config, text = tmp_path / "gateway.toml", f'[[listen]]\nbind = "tcp://127.0.0.1:{free_port}"\n'
    config.write_text(f"{text}[[image]]\nunit = 7\nholding = 1\n")
    without_stderr = ["sh", "-c", 'exec "$@" 2>&-', "sh", *COMMAND]
    with subprocess.Popen([*without_stderr, "run", str(config)], env=own(tmp_path)) as process:
        try:
            until(lambda: can_connect(free_port), "it does not start")
            config.write_text(f"{text}[[image]]\nunit = 200\nholding = 1\n")
            process.send_signal(signal.SIGHUP)
            until(lambda: exchange(free_port)[7] == 3, "unit 200 does not answer")
        finally:
            process.kill()


def test_it_says_at_the_start_that_a_device_is_asked_elsewhere_than_the_config_says(
    tmp_path: Path, free_port: int
) -> None:
    config = tmp_path / "gateway.toml"
    config.write_text(
        f'[[listen]]\nbind = "tcp://127.0.0.1:{free_port}"\n[log]\nformat = "json"\n'
        f'[[line]]\nport = "{tmp_path}/hall"\ndevices = [{{ unit = 1, name = "silo-1", profile = "weigher" }}]\n'
    )
    (tmp_path / "addresses.json").write_text(f'{{"{tmp_path}/hall silo-1": {{"configured": 1, "now": 5}}}}')
    with subprocess.Popen([*COMMAND, "run", str(config)], stderr=subprocess.PIPE, env=own(tmp_path)) as process:
        try:
            assert process.stderr is not None
            told: dict[str, object] = {}
            while told.get("event") not in {"address_remembered", "ready"}:
                told = json.loads(process.stderr.readline())
            assert (told.get("device"), told.get("unit"), told.get("configured")) == ("silo-1", 5, 1)
            assert "if it is at 1 again: modbus-gateway forget silo-1" in str(told["advice"])
        finally:
            process.kill()
