"""The programs of docs/library.md and docs/examples, as they are written: a simulated line, real clients, HTTP."""

import http.client
import json
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from queue import Empty, Queue
from struct import pack, unpack
from typing import Self

import pytest
from pymodbus.client import ModbusTcpClient

from kit.free_port import free_port
from kit.process import PATIENCE, command, simulated
from library.guide import EXAMPLES, files_of_the_guide

METERS = ("carlo-gavazzi-em340:1", "eastron-sdm120:2", "omron-e5cc:3")


class Program:
    """A program in Python, in which a warning is an error. In its context it runs; `stop` is Ctrl-C.

    What it writes to its standard error is in `errors`, a file.
    """

    def __init__(self, file: Path, *words: str | Path) -> None:
        self._whole = [sys.executable, "-W", "error", str(file), *map(str, words)]
        self._folder = file.parent
        self.errors = Path(words[-1] if words else file).with_name("errors.txt")
        self._lines: Queue[str | None] = Queue()

    def __enter__(self) -> Self:
        with self.errors.open("w") as errors:
            self._process = subprocess.Popen(
                self._whole, cwd=self._folder, stdout=subprocess.PIPE, stderr=errors, text=True
            )
        self._reader = threading.Thread(target=self._read)
        self._reader.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.wait()
        self._reader.join()
        assert self._process.stdout
        self._process.stdout.close()

    def line(self) -> str:
        """The next line that it prints."""
        try:
            line = self._lines.get(timeout=PATIENCE)
        except Empty:
            raise AssertionError("it says nothing more") from None
        assert line is not None, self.errors.read_text()
        return line

    def stop(self) -> tuple[int, list[str]]:
        """Its exit code, and the lines of its standard error."""
        self._process.send_signal(signal.SIGINT)
        code = self._process.wait(PATIENCE)
        self._reader.join()
        return code, self.errors.read_text().splitlines()

    def _read(self) -> None:
        assert self._process.stdout
        for line in self._process.stdout:
            self._lines.put(line.rstrip())
        self._lines.put(None)


#: The example of the interface, as it was agreed on; only Clock has values, and stands before it is used.
AGREED = """
import asyncio
from gateway import CustomUnit, Gateway

class Clock(CustomUnit):
    async def read(self, area, address, count): return [7] * count
    async def write(self, area, address, values): ...

async def main():
    async with Gateway.from_toml("plant.toml", units={60: Clock()}) as gateway:
        print(gateway.addresses)
        silo = gateway.unit("silo-1")
        print(await silo.read("weight"))
        registers = await silo.read_holding(0, 10)
        await silo.write("zero", 1)
        async for event in gateway.events():
            ...
asyncio.run(main())
"""
AGREED_CONFIG = """
[[listen]]
bind = "tcp://127.0.0.1:5020"

[[line]]
port    = "/tmp/hall"
baud    = 19200
format  = "8E1"
devices = [{ unit = 1, as = 41, name = "silo-1", points = [
  { name = "weight", holding = 0, unit = "kg" },
  { name = "zero", holding = 20, write = true },
] }]
"""


def moved(text: str, folder: Path, port: int) -> str:
    """An example, with a serial port and a TCP port of this test."""
    return text.replace('"/tmp/', f'"{folder}/').replace(":5020", f":{port}")


@pytest.fixture
def meters(tmp_path: Path) -> Iterator[tuple[Path, int]]:
    """The config of the examples and the TCP port in it, with its meters."""
    port = free_port()
    config = tmp_path / "plant.toml"
    config.write_text(moved((EXAMPLES / "plant.toml").read_text(encoding="utf-8"), tmp_path, port))
    with simulated(tmp_path / "plant", *METERS):
        yield config, port


def test_the_program_of_the_guide_does_what_its_comments_say(tmp_path: Path) -> None:
    port = free_port()
    for name, text in files_of_the_guide().items():
        (tmp_path / name).write_text(moved(text, tmp_path, port))
    with simulated(tmp_path / "hall", "weigher:1"), Program(tmp_path / "plant.py") as program:
        assert program.line() == f"['tcp://127.0.0.1:{port}']"
        weight = float(program.line())
        high, low = json.loads(program.line())
        assert unpack(">f", pack(">2H", high, low))[0] == pytest.approx(weight, rel=0.1)
        high, low = json.loads(program.line())
        with ModbusTcpClient("127.0.0.1", port=port, timeout=PATIENCE) as client:
            later = client.read_holding_registers(0, count=2, device_id=60).registers
            assert 0 <= (later[0] << 16 | later[1]) - (high << 16 | low) < PATIENCE
            assert client.read_holding_registers(1, count=2, device_id=60).exception_code == 2
            assert client.write_register(0, 0, device_id=60).exception_code == 1
        code, errors = program.stop()
    assert (code, errors[-1]) == (-signal.SIGINT, "KeyboardInterrupt")
    assert not [line for line in errors if "rror:" in line or "arning:" in line]


def test_the_program_that_the_interface_has(tmp_path: Path) -> None:
    port = free_port()
    (tmp_path / "plant.toml").write_text(moved(AGREED_CONFIG, tmp_path, port))
    (tmp_path / "program.py").write_text(AGREED)
    with simulated(tmp_path / "hall", "generic:1"), Program(tmp_path / "program.py") as program:
        assert program.line() == f"['tcp://127.0.0.1:{port}']"
        assert re.fullmatch(r"\d+ kg", program.line())
        with ModbusTcpClient("127.0.0.1", port=port, timeout=PATIENCE) as client:
            assert _eventually(lambda: client.read_holding_registers(20, device_id=41).registers == [1])
            assert client.read_input_registers(3, count=2, device_id=60).registers == [7, 7]
            assert not client.write_register(3, 1, device_id=60).isError()
        code, errors = program.stop()
    assert (code, errors[-1]) == (-signal.SIGINT, "KeyboardInterrupt")


def test_a_computed_meter_is_the_sum_of_two(meters: tuple[Path, int]) -> None:
    config, port = meters
    with Program(EXAMPLES / "computed_meter.py", config) as program:
        assert program.line() == f"The house is unit 60 at tcp://127.0.0.1:{port}"
        grid = _read(port, "1", "active-power", "--profile", "carlo-gavazzi-em340")
        roof = _read(port, "2", "active-power", "--profile", "eastron-sdm120")
        assert _read(port, "60", "input", "0", "float32") == pytest.approx(grid + roof, rel=0.2)
        with ModbusTcpClient("127.0.0.1", port=port, timeout=PATIENCE) as client:
            assert client.read_input_registers(0, count=1, device_id=60).exception_code == 2
        assert program.stop() == (0, [])


def test_a_computed_meter_has_no_value_without_one_of_its_sources(tmp_path: Path) -> None:
    port = free_port()
    (tmp_path / "plant.toml").write_text(moved((EXAMPLES / "plant.toml").read_text(encoding="utf-8"), tmp_path, port))
    with (
        simulated(tmp_path / "plant", *METERS[:1]),
        Program(EXAMPLES / "computed_meter.py", tmp_path / "plant.toml") as program,
    ):
        program.line()
        with ModbusTcpClient("127.0.0.1", port=port, timeout=PATIENCE, retries=0) as client:
            answer = client.read_input_registers(0, count=2, device_id=60)
        assert answer.exception_code == 0x0B
        assert program.stop()[0] == 0


class TestInsideAiohttp:
    def test_values_set_points_events_and_errors_over_http(self, meters: tuple[Path, int], tmp_path: Path) -> None:
        config, _ = meters
        web = free_port()
        program = tmp_path / "inside_aiohttp.py"
        program.write_text((EXAMPLES / "inside_aiohttp.py").read_text(encoding="utf-8").replace("8080", str(web)))
        with Program(program, config) as running:
            while "Running on" not in running.line():
                pass
            events = http.client.HTTPConnection("127.0.0.1", web, timeout=PATIENCE)
            events.request("GET", "/events")
            stream = events.getresponse()
            assert stream.headers["Content-Type"] == "text/event-stream"

            status, reading = _http(web, "GET", "/units/grid/active-power")
            assert (status, json.loads(reading)["unit"]) == (200, "W")
            assert _http(web, "PUT", "/units/oven/setpoint", "180") == (204, "")
            assert stream.readline() == b"event: write_audit\n"
            told = json.loads(stream.readline().removeprefix(b"data: "))
            assert told["level"] == "INFO"
            assert told["text"].startswith("embedded wrote to unit 3, address 8451, count 1 ")
            assert json.loads(_http(web, "GET", "/units/oven/setpoint")[1])["value"] == 180

            assert _http(web, "GET", "/units/cellar/active-power")[0] == 404
            assert _http(web, "GET", "/units/grid/colour")[0] == 404
            assert _http(web, "PUT", "/units/oven/setpoint", '"warm"')[0] == 400
            assert _http(web, "PUT", "/units/oven/setpoint", "warm")[0] == 400
            assert _http(web, "PUT", "/units/grid/active-power", "1")[0] == 400
            assert running.stop() == (0, [])
            assert re.findall(rb"^event: (.*)$", stream.read(), re.MULTILINE)[-2:] == [b"stopping", b"stopped"]
            events.close()


def _eventually(holds: Callable[[], bool]) -> bool:
    """Whether it holds within the time that a test has."""
    end = time.monotonic() + PATIENCE
    while not (held := holds()) and time.monotonic() < end:
        time.sleep(0.02)
    return held


def _http(port: int, method: str, path: str, body: str | None = None) -> tuple[int, str]:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=PATIENCE)
    connection.request(method, path, body)
    response = connection.getresponse()
    text = response.read().decode()
    connection.close()
    return response.status, text


def _read(port: int, *words: str) -> float:
    """A value that the gateway's own command reads, as any client."""
    done = command("read", *words, "--tcp", f"127.0.0.1:{port}", "--json")
    assert not done.returncode, done.stderr
    return float(json.loads(done.stdout)["values"][0]["value"])
