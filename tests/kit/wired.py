"""A driver on a line in memory, on which devices talk at the line's rate."""

import asyncio
from dataclasses import replace
from typing import Self

from gateway.devices.device import Device
from gateway.lines.driver import LineDriver
from gateway.lines.line import Line
from gateway.timing.characters import LineTiming
from kit.asker import Asker
from kit.line_bench import SETTINGS, TIMING, Bench
from kit.memory import MemoryLine

#: A read of ten registers.
READ_TEN = "03 00 10 00 0A"


class Wired:
    """A driver on a line in memory, on which devices talk at the line's rate. Unless it `looks_away`, it sees each."""

    def __init__(self, timing: LineTiming = TIMING, *, virtual: bool = True, looks_away: bool = True) -> None:
        self.timing = timing
        self.virtual = virtual
        self.looks_away = looks_away
        self.loop = asyncio.get_running_loop()
        self.events: list[object] = []
        self.memory = MemoryLine(latency=0.005)
        settings = replace(SETTINGS, timing=timing)
        self.driver = LineDriver(Line(settings, self.events.append), self.loop, self.events.append, [].append)
        self.user = User(self.driver)
        self.client = Asker()
        self.device = Device(Bench().device().settings, self.driver)

    async def __aenter__(self) -> Self:
        port = await self.memory.open_port(self.user)
        port.is_virtual = self.virtual
        if not self.looks_away:
            port.pause = lambda: False  # type: ignore[method-assign]
        self.driver.port_up(port)
        await asyncio.sleep(1.0)
        return self

    async def __aexit__(self, *_: object) -> None:
        self.driver.close()

    async def asks(self, pdu: str = READ_TEN) -> None:
        """Ask; return when a device has the request."""
        now = self.loop.time()
        self.device.submit(self.client.ask(pdu, now=now), now)
        await asyncio.sleep(self.timing.frame(len(bytes.fromhex(pdu))) + 4 * self.timing.character)

    async def says(self, data: bytes) -> None:
        for byte in data:
            await asyncio.sleep(self.timing.character * 0.9999)  # no two clocks are the same
            self.memory.deliver(bytes((byte,)))


class User:
    """The driver as its port sees it; the reconnector is not here. `wakes` counts how often bytes woke it."""

    def __init__(self, driver: LineDriver) -> None:
        self.driver = driver
        self.lost = driver.port_down
        self.damaged = False
        self.wakes = 0

    def received(self, data: bytes) -> None:
        self.wakes += 1
        self.driver.received(data, damaged=self.damaged)
