"""`scan` as a process: through a daemon beside its clients, and on a port without one."""

import asyncio
import json
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from threading import Event, Thread

import pytest
from pymodbus.client import ModbusTcpClient

from gateway.simulator.generic import Generic
from gateway.simulator.line import SimulatedLine
from kit.process import COMMAND, PATIENCE, GatewayProcess, command, simulated

CONFIG = """
[[listen]]
bind = "tcp://127.0.0.1:0"

[[line]]
name = "hall"
port = "{port}"
late_window = "1 s"
max_wait = "30 s"
devices = [
  {{ unit = 1, as = 41, profile = "weigher", timeout = "3 s" }},
  {{ unit = 6, profile = "v80", timeout = "3 s" }},
]

[control]
socket = "{control}"
"""
#: How long a unit may take to answer: on a busy machine a simulated one is late.
PATIENT = "2s"


@pytest.fixture
def port(tmp_path: Path) -> Iterator[Path]:
    path = tmp_path / "hall"
    with simulated(path, "weigher:1,3", "v80:6"):
        yield path


def found(*words: str) -> dict[int, str]:
    """The units and their profiles."""
    done = command("scan", *words, "--json")
    assert done.returncode == 0, done.stderr
    return {row["unit"]: row["profile"] for row in json.loads(done.stdout)["found"]}


class Asking(Thread):
    """A client that asks unit 6 as fast as it can. `answered` and `failed` count."""

    def __init__(self, port: int) -> None:
        super().__init__(name="client")
        self.answered = self.failed = 0
        self._port = port
        self._end = Event()

    def __enter__(self):
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        self.join()

    def run(self) -> None:
        client = ModbusTcpClient("127.0.0.1", port=self._port, timeout=PATIENCE)
        client.connect()
        while not self._end.is_set():
            if client.read_holding_registers(0, count=2, device_id=6).isError():
                self.failed += 1
            else:
                self.answered += 1
        client.close()


def test_through_the_daemon_beside_clients_at_full_rate(tmp_path: Path, port: Path) -> None:
    control = str(tmp_path / "control.sock")
    with GatewayProcess(tmp_path, CONFIG.format(port=port, control=control)) as gateway:
        at = ("--timeout", PATIENT, "--control", control)
        assert found("hall", "1-3", *at) == {3: "weigher"}
        with Asking(gateway.port) as first, Asking(gateway.port) as second:
            assert found("hall", "3-5", *at) == {3: "weigher"}
        assert first.answered > 0 < second.answered
        assert first.failed + second.failed == 0  # who goes first is in tests/lines/test_idle.py
        assert not {"request_timeout", "unit_resting", "bad_frame"} & {event["event"] for event in gateway.log}
        assert command("read", "41", "--control", control).returncode == 0


def test_it_ends_when_its_command_is_ended(tmp_path: Path, port: Path) -> None:
    control = str(tmp_path / "control.sock")
    with GatewayProcess(tmp_path, CONFIG.format(port=port, control=control)):
        assert command("read", "41", "--control", control).returncode == 0  # in use: nobody else can begin below
        other = ("scan", "hall", "20", "--all-speeds", "--control", control)
        scan = subprocess.Popen([*COMMAND, "scan", "hall", "--control", control], stdout=subprocess.PIPE)
        while "goes on already" not in command(*other).stderr:
            assert scan.poll() is None
        scan.send_signal(signal.SIGINT)
        assert scan.wait(PATIENCE) == 130
        scan.stdout.close()
        end = time.monotonic() + PATIENCE
        while "goes on already" in command(*other).stderr:
            assert time.monotonic() < end


def test_on_a_port_without_a_daemon(port: Path) -> None:
    at = ("--port", str(port), "--timeout", PATIENT)
    assert found("1-4,6", *at) == {1: "weigher", 3: "weigher", 6: "v80"}
    assert found("3,6", *at) == {3: "weigher", 6: "v80"}  # a v80 is asked soon after a response of another device
    shown = command("scan", "3-4", *at)
    assert shown.stdout.splitlines()[0].split() == ["UNIT", "RESULT", "ANSWER", "PROFILE"]
    assert shown.stdout.splitlines()[-1] == "1 of 2 units did not answer."
    assert "did not answer" not in command("scan", "3", *at).stdout
    nobody = command("scan", "20", *at)
    assert nobody.stdout.splitlines()[0] == "1 of 1 unit did not answer."
    assert nobody.stdout.endswith("--all-speeds tries other rates.\n")
    assert (nobody.returncode, "\x1b" in nobody.stdout) == (1, False)
    missing = command("scan", "--port", "/dev/not-here")
    assert (missing.returncode, missing.stdout) == (1, "")
    assert "/dev/not-here" in missing.stderr
    assert command("scan").returncode == command("scan", "300", *at).returncode == 2


def test_a_kind_of_a_config_is_recognised_with_its_models(tmp_path: Path) -> None:
    path, config = tmp_path / "hall", tmp_path / "gateway.toml"
    config.write_text(
        f'[[line]]\nport = "{path}"\ndevices = [{{ unit = 1, profile = "inverter" }}]\n'
        "[profile.inverter]\nidentity = { sunspec = [1, 802] }\n"
        'points = [{ name = "current", holding = 40072, unit = "A" }]\n'
    )
    with simulated(path, "inverter:3", "--config", str(config)):
        at = ("--port", str(path), "--timeout", PATIENT, "--config", str(config))
        shown = command("scan", "3", *at)
        assert shown.stdout.splitlines()[1].endswith("ms  inverter; SunSpec: 1 at 40002, 802 at 40070"), shown.stderr
        (row,) = json.loads(command("scan", "3", *at, "--json").stdout)["found"]
        assert row["models"] == [{"model": 1, "address": 40002}, {"model": 802, "address": 40070}]


def test_all_speeds_on_a_port(tmp_path: Path) -> None:
    path = tmp_path / "hall"
    with simulated(path, "weigher:3", "--baud", "14400"):
        done = command("scan", "3", "--all-speeds", "--timeout", "1s", "--port", str(path))
        assert done.stdout.splitlines()[1].split()[::5] == ["3", "14400"], done.stderr


async def test_two_devices_on_one_address_without_a_daemon(tmp_path: Path) -> None:
    async with SimulatedLine(tmp_path / "hall", [Generic(9), Generic(9), Generic(10)]):
        words = [*COMMAND, "scan", "9-10", "--port", str(tmp_path / "hall"), "--timeout", PATIENT, "--json"]
        scan = await asyncio.create_subprocess_exec(*words, stdout=asyncio.subprocess.PIPE)
        said, _ = await scan.communicate()
        assert scan.returncode == 1
        rows = {row["unit"]: row["result"] for row in json.loads(said)["found"]}
        assert rows == {9: "garbled", 10: "answers"}
