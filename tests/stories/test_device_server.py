"""A line behind a device server, in virtual time: what was said before the connection is not believed."""

import asyncio

from gateway.events import BaudChanged
from gateway.modbus import rtu
from gateway.ports.port import TcpSettings
from kit.device import SimulatedDevice, SimulatedLine
from kit.house import house

PORT = "rtu+tcp://10.0.0.9:4001"
CONFIG = f"""
[[line]]
name    = "hall-a"
port    = "{PORT}"
baud    = 9600
timeout = "200 ms"
devices = [{{ unit = 1 }}]
"""
READ = "03 00 05 00 01"


async def test_it_is_a_line_like_any_other_with_the_networks_latency() -> None:
    async with house(CONFIG) as home:
        device = SimulatedDevice(1, delay=0.25)
        device.holding[5] = 7
        home.attach(PORT, SimulatedLine("rtu", device))
        assert home.opened[PORT] == TcpSettings(PORT, "10.0.0.9", 4001, latency=0.1)
        assert await home.client().asks(1, READ) == "03 02 00 07"


async def test_the_answer_that_a_lost_connection_leaves_owing_is_not_given_to_the_next_request() -> None:
    async with house(CONFIG) as home:
        line, client = home.lines[PORT], home.client()
        client.ask(1, READ)
        await asyncio.sleep(0.05)
        line.pull("closed")
        assert await client.answer() == "83 0B"
        line.plug()
        await asyncio.sleep(0.15)
        client.ask(1, READ)
        line.deliver(rtu.encode(1, bytes.fromhex("03 02 DE AD")))
        await asyncio.sleep(0.5)
        assert await client.answer() == "83 0B"


async def test_a_rate_that_a_device_was_given_is_followed_as_far_as_that_goes() -> None:
    """The wire times follow; the device server keeps its own rate, and its port says so."""
    config = CONFIG.replace("unit = 1", 'unit = 1, profile = "weigher"')
    async with house(config) as home:
        home.attach(PORT, SimulatedLine("rtu", SimulatedDevice(1, items=0x300)))
        await home.client().asks(1, "10 02 00 00 02 04 46 96 00 00")
        assert [event.baud for event in home.events if isinstance(event, BaudChanged)] == [19200]
        assert home.lines[PORT].baud == 19200
        assert home.gateway.lines[0].driver.line.settings.timing.baud == 19200
