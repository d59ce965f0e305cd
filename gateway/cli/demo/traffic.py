"""What keeps the lines of the demo busy while somebody looks: some clients that poll without end."""

import asyncio
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from typing import Final

from gateway.modbus import mbap
from gateway.modbus.frame import Frame
from gateway.simulator.panel import Panel

#: How long a response may take, and how long a client waits before it connects again, in seconds.
_PATIENCE: Final = 10.0
_AGAIN: Final = 1.0


@dataclass(frozen=True, slots=True)
class DemoClient:
    """A client that asks this, units and PDUs in hexadecimal, one after the other, and then pauses for some seconds."""

    name: str
    asks: Sequence[tuple[int, str]]
    pause: float


POLLERS: Final = (
    DemoClient(
        "scada", ((71, "03 00 00 00 0A"), (72, "03 00 00 00 0A"), (73, "03 00 00 00 0A"), (61, "03 00 00 00 02")), 0.25
    ),
    DemoClient("historian", ((71, "03 00 00 00 3C"), (61, "03 00 00 00 02"), (72, "04 00 00 00 14")), 0.9),
    DemoClient(
        "hmi", ((72, "01 00 00 00 10"), (73, "06 00 05 00 2A"), (73, "03 00 05 00 01"), (72, "03 FF FF 00 01")), 0.6
    ),
    DemoClient("spare", ((74, "03 00 00 00 01"),), 2.5),
    DemoClient("weights", ((41, "03 00 00 00 02"), (42, "03 00 00 00 02"), (50, "03 00 00 00 02")), 0.5),
    DemoClient("press", ((46, "03 00 6B 00 03"), (57, "03 00 6B 00 03"), (57, "01 00 13 00 25")), 0.3),
    DemoClient(
        "energy",
        (
            *((81, "04 00 00 00 34"), (81, "04 00 34 00 38")),
            *((82, "04 00 00 00 20"), (82, "04 00 46 00 1A")),
            (85, "04 00 01 00 02"),
        ),
        1.0,
    ),
    DemoClient(
        "details",
        (
            *((81, "04 00 C8 00 34"), (81, "04 01 02 00 0C"), (81, "04 01 4E 00 30")),
            *((82, "04 01 02 00 08"), (82, "04 01 56 00 04"), (85, "03 01 03 00 02")),
        ),
        5.0,
    ),
    DemoClient("plc", ((240, "03 00 00 00 20"),), 0.5),
    DemoClient("axes", ((52, "03 00 1D 00 02"), (52, "02 00 00 00 10"), (53, "03 00 01 00 01")), 0.7),
)


#: What the old HMI asks for over its serial line, one after the other, and how long it pauses after each, in seconds.
PANEL_ASKS: Final = (Frame(41, bytes.fromhex("03 00 00 00 02")), Frame(46, bytes.fromhex("03 00 6B 00 03")))
PANEL_PAUSE: Final = 0.6


@asynccontextmanager
async def traffic(address: str, panel: Panel) -> AsyncIterator[None]:
    """Ask the gateway inside the context: the pollers at `address`, and `panel` over its serial line."""
    host, port = address.removeprefix("tcp://").rsplit(":", 1)
    tasks = [asyncio.create_task(_poll(each, host, int(port)), name=f"demo {each.name}") for each in POLLERS]
    tasks.append(asyncio.create_task(_panel_polls(panel), name="demo panel"))
    try:
        yield
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def _panel_polls(panel: Panel) -> None:
    while True:
        for request in PANEL_ASKS:
            await panel.ask(request)
            await asyncio.sleep(PANEL_PAUSE)


async def _poll(poller: DemoClient, host: str, port: int) -> None:
    while True:
        with suppress(OSError, TimeoutError, asyncio.IncompleteReadError):
            reader, writer = await asyncio.open_connection(host, port)
            try:
                await _ask(poller, reader, writer)
            finally:
                writer.close()
        await asyncio.sleep(_AGAIN)


async def _ask(poller: DemoClient, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    while True:
        for unit, request in poller.asks:
            writer.write(mbap.encode(1, unit, bytes.fromhex(request)))
            async with asyncio.timeout(_PATIENCE):
                header = await reader.readexactly(6)
                await reader.readexactly(int.from_bytes(header[4:]))
        await asyncio.sleep(poller.pause)
