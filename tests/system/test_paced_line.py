"""A line on a pseudo-terminal whose device speaks byte by byte, as on a real line: in real time."""

import asyncio
import time
from collections.abc import Callable
from contextlib import asynccontextmanager, suppress
from functools import partial
from threading import Event, Thread

import pytest

from gateway.devices.device import Device
from gateway.lines.driver import LineDriver
from gateway.lines.line import Line
from gateway.lines.settings import LineSettings
from gateway.modbus.rtu import encode
from gateway.ports.opener import open_serial
from gateway.ports.port import SerialSettings
from gateway.ports.reconnector import Reconnector
from gateway.timing.characters import CharacterFormat, LineTiming
from kit.asker import Asker
from kit.line_bench import Bench
from kit.process import PATIENCE
from kit.pty import VirtualPort

READ_TEN = "03 00 10 00 0A"
TEN = encode(1, bytes.fromhex("03 14") + bytes(range(20)))
READ_MUCH = "03 00 10 00 7D"
MUCH = encode(1, bytes.fromhex("03 FA") + bytes(range(250)))
EXCEPTION = encode(1, bytes.fromhex("83 02"))
REQUEST_SIZE = 8
BROKEN = TEN[:11]


class SlowDevice(Thread):
    """Answers each request with `says`, a byte in each character time. `gaps` are the silences before the next ones."""

    def __init__(self, port: VirtualPort, timing: LineTiming, says: bytes) -> None:
        super().__init__(name="device")
        self.says = says
        self.end = Event()
        self.gaps: list[float] = []
        self._port = port
        self._timing = timing
        self._pause = (REQUEST_SIZE + 3.5) * timing.character

    def run(self) -> None:
        spoke_at = None
        with suppress(OSError, ValueError):  # the port is pulled out of our hands
            while not self.end.is_set():
                if len(self._port.read(REQUEST_SIZE, 0.01)) < REQUEST_SIZE:
                    continue
                if spoke_at is not None:
                    self.gaps.append(time.monotonic() - spoke_at)
                spoke_at = self._speak()

    def _speak(self) -> float:
        """When the last byte was written, or a little before."""
        time.sleep(self._pause)
        for byte in self.says:
            time.sleep(self._timing.character)
            spoke_at = time.monotonic()
            self._port.write(bytes((byte,)))
        return spoke_at


class PacedLine:
    """A line with one device, and one client that asks it."""

    def __init__(self, port: VirtualPort, baud: int, says: bytes, limit: float) -> None:
        timing = LineTiming("rtu", baud, CharacterFormat.parse("8N1"))
        self.far_end = SlowDevice(port, timing, says)
        self.wakes = 0
        loop = asyncio.get_running_loop()
        settings = LineSettings("hall-a", timing, turnaround=0.1)
        self.driver = LineDriver(Line(settings, [].append), loop, [].append, [].append)
        self.device = Device(Bench().device(timeout=limit).settings, self.driver)
        self.client = Asker()
        where = SerialSettings(str(port.path), baud, timing.format)
        self.reconnector = Reconnector("hall-a", str(port.path), partial(open_serial, where), self, [].append)
        self.port_up = self.driver.port_up
        self.port_down = self.driver.port_down

    def received(self, data: bytes) -> None:
        self.wakes += 1
        self.driver.received(data)

    async def asks(self, pdu: str = READ_TEN) -> str:
        count = len(self.client.answers)
        loop = asyncio.get_running_loop()
        self.device.submit(self.client.ask(pdu, now=loop.time()), loop.time())
        await until(lambda: len(self.client.answers) > count)
        return self.client.answers[-1]


async def until(condition: Callable[[], bool]) -> None:
    async with asyncio.timeout(PATIENCE):
        while not condition():  # noqa: ASYNC110 - what is waited for happens at the far end
            await asyncio.sleep(0.001)


@asynccontextmanager
async def paced(port: VirtualPort, baud: int = 9600, says: bytes = TEN, limit: float = 5.0):
    line = PacedLine(port, baud, says, limit)
    keeping = asyncio.create_task(line.reconnector.run())
    await asyncio.wait_for(line.reconnector.tried.wait(), PATIENCE)
    line.far_end.start()
    try:
        yield line
    finally:
        keeping.cancel()
        await asyncio.wait([keeping])
        line.driver.close()
        line.far_end.end.set()
        await asyncio.to_thread(line.far_end.join)


@pytest.fixture
def port(tmp_path):
    with VirtualPort(tmp_path / "adapter") as port:
        yield port


@pytest.mark.parametrize("baud", [9600, 19200, 115200])
async def test_the_silence_before_a_request_is_never_shorter_than_t35(port, baud):
    async with paced(port, baud) as line:
        for _ in range(20):
            assert (await line.asks()).startswith("03 14")
        assert len(line.far_end.gaps) == 19
        assert min(line.far_end.gaps) >= line.driver.line.settings.timing.t35


async def test_a_long_answer_wakes_the_line_a_few_times(port):
    """A device on a busy machine speaks later than the line expects it, and wakes it more often, but not each time."""
    wakes = []
    async with paced(port) as line:
        for _ in range(20):
            before = line.wakes
            await line.asks()
            wakes.append(line.wakes - before)
    assert min(wakes) < len(TEN) / 4


async def test_an_exception_is_answered_though_a_long_answer_was_awaited(port):
    async with paced(port, says=EXCEPTION) as line:
        assert await line.asks() == "83 02"


async def test_when_fewer_bytes_come_the_request_fails_and_the_line_goes_on(port):
    async with paced(port, says=BROKEN, limit=2.0) as line:
        assert await line.asks() == "83 0B"
        line.far_end.says = TEN
        async with asyncio.timeout(PATIENCE):
            while not (await line.asks()).startswith("03 14"):  # noqa: ASYNC110 - until the late window is over
                await asyncio.sleep(0.1)


async def test_a_port_that_is_pulled_out_while_nobody_looks_fails_the_request_in_time(port):
    async with paced(port, baud=75, says=MUCH) as line:
        asking = asyncio.create_task(line.asks(READ_MUCH))
        await until(lambda: line.wakes > 2)  # the head has come: the rest takes 33 s
        port.unplug()
        pulled_at = time.monotonic()
        assert await asking == "83 0B"
        assert time.monotonic() - pulled_at < 15
