"""`calibrate` as a process, on a simulated Mint controller that responds as its table says."""

import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pymodbus.client import ModbusTcpClient

from kit.process import PATIENCE, GatewayProcess, command, simulated

CONFIG = """
[[listen]]
bind = "tcp://127.0.0.1:0"

[[line]]
name = "motion"
port = "{port}"
mode = "ascii"
devices = [{{ unit = 2, name = "axis-1", timeout = "20 s" }}]

[control]
socket = "{control}"
"""
#: Milliseconds for 99 registers, and what they take on the wire.
TABLE, WIRE = 420, 220
#: A busy machine adds its own to some measurements; what is wrong adds it to each.
ATTEMPTS = 8


@contextmanager
def reading(port: int) -> Iterator[None]:
    """A client that reads one register and 99 of them, in turns."""
    end = threading.Event()

    def read() -> None:
        client = ModbusTcpClient("127.0.0.1", port=port, timeout=PATIENCE)
        client.connect()
        while not end.is_set():
            for count in (1, 99):
                client.read_holding_registers(1, count=count, device_id=2)
        client.close()

    thread = threading.Thread(target=read, name="client")
    thread.start()
    try:
        yield
    finally:
        end.set()
        thread.join()


def finds_the_time(*words: str) -> bool:
    """Whether the time for 99 registers is measured as it is: without what they take on the wire."""
    times = (time_of_99(*words) for _ in range(ATTEMPTS))
    return any(0.9 * TABLE < time < TABLE + 0.8 * WIRE for time in times)


def time_of_99(*words: str) -> float:
    """Milliseconds for 99 registers; 0 if a busy machine got too few responses to tell."""
    done = command("calibrate", "axis-1", "--json", *words)
    assert done.returncode == 0, done.stderr
    times = [row["time_ms"] for row in json.loads(done.stdout)["timing"] if (row["fc"], row["items"]) == (3, 99)]
    return times[0] if times else 0.0


def test_a_mint_controller_actively_and_passively(tmp_path: Path) -> None:
    control, port = str(tmp_path / "control.sock"), tmp_path / "motion"
    at = ("--control", control)
    with simulated(port, "mint:2"), GatewayProcess(tmp_path, CONFIG.format(port=port, control=control)) as gateway:
        assert finds_the_time("--active", "--for", "5s", *at)
        with reading(gateway.port):
            assert finds_the_time("--for", "5s", *at)
        shown = command("calibrate", "axis-1", *at)
        assert "FUNCTION  ITEMS  RESPONSES" in shown.stdout
        assert "timing = [" in shown.stdout
