"""Clients that ask again at once, whatever they are answered, beside one that asks now and then."""

import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from socket import create_connection

from gateway.modbus.mbap import encode
from kit import flood
from kit.device import SimulatedDevice, SimulatedLine
from kit.process import PATIENCE, GatewayProcess
from kit.pty import VirtualPort
from kit.serial_line import SerialDevices

CONFIG = """
[[listen]]
bind    = "tcp://127.0.0.1:0"
clients = 100

[[line]]
name    = "hall-a"
port    = "{port}"
baud    = 38400
max_wait = "60 s"
devices = [{{ unit = 1, timeout = "20 s" }}]
"""

#: Other work on the machine may take its time from one of them; without the hold each had a sixteenth left at most.
ATTEMPTS = 6


def test_clients_that_are_refused_and_ask_again_leave_the_line_its_time(tmp_path: Path) -> None:
    """Promises P6 and P18. Without a moment between a refusal and the next request the line has no time left."""
    device = SimulatedDevice(1, delay=0.0, items=flood.REGISTERS)
    device.holding[:100] = [42] * 100
    with (
        VirtualPort(tmp_path / "hall-a") as port,
        SerialDevices({port: SimulatedLine("rtu", device)}),
        GatewayProcess(tmp_path, CONFIG.format(port=port.path), level="info") as gateway,
    ):
        assert any(keeps_its_time(gateway, device) for _ in range(ATTEMPTS))
        assert gateway.first("queue_full")["client"].startswith(flood.HOST)
        with flooded(gateway, connections=60):
            assert {polled(gateway, address) for address in range(4)} == {"0302002a"}


def keeps_its_time(gateway: GatewayProcess, device: SimulatedDevice) -> bool:
    """Whether there is more than an eighth of the transactions; on a quiet machine there are 0.8 and more."""
    with flooded(gateway, connections=3):
        undisturbed = transactions(device, seconds=1.0)
    with flooded(gateway, connections=60):
        return transactions(device, seconds=1.5) > undisturbed / 8


@contextmanager
def flooded(gateway: GatewayProcess, connections: int) -> Iterator[None]:
    """In its context so many connections keep sixteen requests each under way."""
    words = [sys.executable, flood.__file__, str(gateway.port), str(connections), "16", "1"]
    with subprocess.Popen(words, stdout=subprocess.PIPE) as process:
        try:
            assert process.stdout.readline()
            time.sleep(0.5)
            yield
        finally:
            process.kill()


def transactions(device: SimulatedDevice, seconds: float) -> float:
    """How many a second there are on the line."""
    before, begin = len(device.heard), time.monotonic()
    time.sleep(seconds)
    return (len(device.heard) - before) / (time.monotonic() - begin)


def polled(gateway: GatewayProcess, address: int) -> str:
    """The answer to a client that comes, asks once and goes."""
    with create_connection(("127.0.0.1", gateway.port), PATIENCE, ("127.0.0.7", 0)) as client:
        client.sendall(encode(1, 1, bytes((3, 0, address, 0, 1))))
        return client.recv(260)[7:].hex()
