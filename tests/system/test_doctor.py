"""`doctor` as a process, before a gateway and simulated devices as processes: each broken set-up is named."""

import json
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from kit.process import PATIENCE, GatewayProcess, command
from system.test_simulate import Simulation

CONFIG = """
[[listen]]
bind = "tcp://127.0.0.1:0"

[[line]]
name = "hall"
port = "{port}"
baud = 9600
late_window = "1 s"
devices = [
  {{ unit = 1, as = 41, name = "silo-1", profile = "weigher", timeout = "{timeout}" }},
  {{ unit = 6, as = 46, name = "press", profile = "v80", timeout = "{timeout}" }},
]

[control]
socket = "{control}"
"""

#: A device that is looked for has 250 ms to answer. On a busy machine a simulated one may need more once in a while.
ATTEMPTS = 8

HOLD = """
import os, sys, time
descriptor = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)
print("open", flush=True)
time.sleep(600)
"""


class Hall:
    """The gateway and its line, with devices that are simulated with these words."""

    def __init__(self, folder: Path, *words: str, timeout: str = "20 s") -> None:
        self.port = folder / "hall"
        self.control = folder / "control.sock"
        self.devices = Simulation(self.port, "weigher:1", "v80:6", *words)
        self.gateway = GatewayProcess(folder, CONFIG.format(port=self.port, control=self.control, timeout=timeout))

    def __enter__(self):
        self.devices.__enter__()
        self.gateway.__enter__()
        return self

    def __exit__(self, *exception: object) -> None:
        self.gateway.__exit__(*exception)
        self.devices.__exit__(*exception)

    def doctor(self, *words: str):
        """The exit status, and the findings by level as `about: what -> remedy`."""
        done = command("doctor", "--json", "--control", str(self.control), *words)
        rows: dict[str, list[str]] = {"ok": [], "note": [], "fix": []}
        for each in json.loads(done.stdout)["findings"]:
            rows[each["level"]].append(f"{each['about']}: {each['what']} -> {each['remedy']}")
        return done.returncode, rows


def test_a_healthy_set_up_has_nothing_to_fix(tmp_path):
    with Hall(tmp_path) as hall:
        for _ in range(ATTEMPTS):
            status, rows = hall.doctor()
            if status == 0:
                break
        assert (status, rows["fix"]) == (0, [])
        assert [row.partition(":")[0] for row in rows["ok"]] == ["port of hall", "hall"]
        again = hall.doctor("hall", "--passive")
        assert (again[0], again[1]["fix"], again[1]["note"]) == (0, [], [])


@pytest.mark.parametrize(
    ("fault", "named"),
    [
        ("wrong-rate", "nobody answers at 9600 8E1, but at 19200 8E1 -> gateway.toml:8: baud = 19200"),
        ("wrong-parity", "nobody answers at 9600 8E1, nor at 9 other rates"),
        ("swapped-address", "does not answer at address 1, but a device that is not configured answers at 2"),
        ("duplicate-address", "two devices may have the address 1"),
        ("echo", "the adapter returns what is sent"),
        ("second-client", "another client sends requests on this line"),
        ("slow", "the slowest after 1."),
    ],
)
def test_a_broken_set_up_is_named(tmp_path, fault, named):
    for _ in range(ATTEMPTS):  # each with a gateway of its own, which has counted nothing yet
        with Hall(tmp_path, "--fault", fault, timeout="200 ms") as hall:
            status, rows = hall.doctor()
        assert status == 1 or fault == "second-client"  # which may ask too little in the 3 s in which doctor listens
        if any(named in row for row in rows["fix"]):
            return
    pytest.fail(f"{rows}")


def test_an_adapter_that_another_program_has_taken_is_named(tmp_path):
    with Hall(tmp_path) as hall:
        holding = [sys.executable, "-c", HOLD, str(hall.port.resolve())]
        with subprocess.Popen(holding, stdout=subprocess.PIPE) as holder:
            holder.stdout.readline()
            try:
                status, rows = hall.doctor("--passive")
            finally:
                holder.kill()
        assert status == 1
        (row,) = rows["fix"]
        assert (
            f"{Path(sys.executable).name} -c (pid {holder.pid}) has {hall.port} open, too -> ps -fp {holder.pid} shows"
            in row
        )


def test_a_client_whose_time_out_is_too_short_is_named(tmp_path):
    with Hall(tmp_path, "--slow", "2 s") as hall:
        for transaction in range(3):
            with socket.create_connection(("127.0.0.1", hall.gateway.port), timeout=PATIENCE) as client:
                client.sendall(transaction.to_bytes(2, "big") + bytes.fromhex("0000 0006 2E 03 0000 0001"))
                time.sleep(0.2)
            hall.gateway.wait_for("client_closed")
        _, rows = hall.doctor("--passive")
        named = [row for row in rows["fix"] if "client 127.0.0.1" in row]
        assert len(named) == 1
        assert "closed its connection 3 times before its response came" in named[0]
        assert "set the time-out of this client above" in named[0]


def test_a_client_that_leaves_with_its_responses_is_not_named(tmp_path):
    with Hall(tmp_path) as hall:
        for transaction in range(4):
            with socket.create_connection(("127.0.0.1", hall.gateway.port), timeout=PATIENCE) as client:
                client.sendall(transaction.to_bytes(2, "big") + bytes.fromhex("0000 0006 2E 03 0000 0001"))
                assert client.recv(100)
            hall.gateway.wait_for("client_closed")
        status, rows = hall.doctor("--passive")
        assert (status, rows["fix"]) == (0, [])
        assert not any("client" in row for row in rows["note"])


def test_without_a_gateway_the_port_is_looked_at(tmp_path):
    with Simulation(tmp_path / "hall", "weigher:1"):
        config = tmp_path / "gateway.toml"
        config.write_text(f'[[line]]\nname = "hall"\nport = "{tmp_path / "hall"}"\nbaud = 9600\n')
        done = command("doctor", "--config", str(config))
        assert done.returncode == 0, done.stdout
        assert "ok    port of hall" in done.stdout
    assert command("doctor", "--config", str(config)).returncode == 1
