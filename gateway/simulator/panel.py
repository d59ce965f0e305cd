"""A simulated HMI that polls: the client on a server line of the gateway.

async with Panel("/tmp/panel", mode="ascii") as panel:
    async for request, response in panel.poll([Frame(41, bytes.fromhex("03 0000 0002"))]):
        print(request, response)
"""

import asyncio
from collections.abc import AsyncIterator, Sequence
from pathlib import Path
from typing import Final, Self

from gateway.config.values.port import DEFAULT_FORMATS
from gateway.modbus.frame import Frame
from gateway.modbus.pdu import parse_request
from gateway.modbus.scan import Expected, Scanner
from gateway.modbus.scan_ascii import AsciiScanner
from gateway.modbus.scan_rtu import RtuScanner
from gateway.simulator.device import Mode
from gateway.simulator.pace import Transmission
from gateway.simulator.port import VirtualPort
from gateway.timing.characters import CharacterFormat, LineTiming

#: How long a panel waits for a response, and between two requests, in seconds.
PATIENCE: Final = 1.0
PAUSE: Final = 0.050


class Panel:
    """A client behind a serial port at `path`, which exists inside the context. It sends one request at a time.

    Its requests take as long as on a real line.
    """

    def __init__(self, path: Path | str, *, mode: Mode = "rtu", format_: CharacterFormat | None = None) -> None:
        self.path = Path(path)
        self._mode = mode
        self._format = format_ or DEFAULT_FORMATS[mode]

    async def __aenter__(self) -> Self:
        self._loop = asyncio.get_running_loop()
        self._port = VirtualPort(self.path)
        return self

    async def __aexit__(self, *_: object) -> None:
        self._loop.remove_reader(self._port)
        self._port.close()

    async def poll(self, requests: Sequence[Frame]) -> AsyncIterator[tuple[Frame, Frame | None]]:
        """Send `requests` in turn, again and again; yield each with its response, None if there was none."""
        while True:
            for request in requests:
                yield request, await self.ask(request)
                await asyncio.sleep(PAUSE)

    async def ask(self, request: Frame, patience: float = PATIENCE) -> Frame | None:
        """Send `request`; return its response, or None if none arrived within `patience` seconds."""
        timing = LineTiming(self._mode, self._port.baud, self._format)
        scanner: Scanner = RtuScanner(timing.t35) if self._mode == "rtu" else AsciiScanner()
        expected = Expected(request.unit, parse_request(request.pdu))
        self._port.read()  # the rest of a late response
        adu = scanner.encode(*request)
        scanner.expect(expected, adu, echoes=False)
        await self._send(adu, timing)
        try:
            async with asyncio.timeout(patience):
                return await self._response(scanner, expected)
        except TimeoutError:
            return None

    async def _send(self, adu: bytes, timing: LineTiming) -> None:
        sent = Transmission(adu, self._loop.time(), timing)
        while not sent.is_over:
            await asyncio.sleep(sent.next_arrival() - self._loop.time())
            self._port.write(sent.take(self._loop.time()))

    async def _response(self, scanner: Scanner, expected: Expected) -> Frame:
        arrived = asyncio.Event()
        self._loop.add_reader(self._port, arrived.set)
        try:
            while True:
                await arrived.wait()
                arrived.clear()
                for token in scanner.received(self._port.read(), self._loop.time()):
                    if token.frame.unit == expected.answers_from and expected.asked.accepts(token.frame.pdu):
                        return token.frame
        finally:
            self._loop.remove_reader(self._port)
