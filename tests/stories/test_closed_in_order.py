"""Servers that close idle connections, in virtual time: no loss, and the next request has the connection opened."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from functools import partial

import pytest

from gateway.events import Event, LineLost, LineReopened, UpstreamClosed
from gateway.modbus import rtu
from gateway.modbus.frame import Frame
from gateway.modbus.mbap import MbapFramer, encode
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import GatewayBench, gateway_bench
from kit.memory import MemoryLine
from kit.statuses import status

READ = "03 00 05 00 01"
#: How a server is reached, and the limit of a read there.
WAYS = {"tcp": 0.2, "rtu+tcp": 0.308, "ascii+tcp": 0.316}


def port(way: str) -> str:
    return f"{way}://10.0.0.9:4001"


def config(way: str, keys: str = "") -> str:
    if way == "tcp":
        return (
            f'[[upstream]]\nname = "there"\nto = "{port(way)}"\ntimeout = "200 ms"\n{keys}\n'
            'units = [{ as = "1-3", unit = "1-3" }]\n'
        )
    return (
        f'[[line]]\nname = "there"\nport = "{port(way)}"\nbaud = 9600\ntimeout = "200 ms"\n{keys}\n'
        'devices = [{ unit = "1-3" }]\n'
    )


class There:
    """A server with units 1 to 3, whose registers hold their addresses."""

    def __init__(self, bench: GatewayBench, way: str) -> None:
        self.line: MemoryLine = bench.lines[port(way)]
        self.devices = [SimulatedDevice(unit) for unit in (1, 2, 3)]
        for device in self.devices:
            device.holding = list(range(100))
        if way != "tcp":
            bench.attach(port(way), SimulatedLine(way[: -len("+tcp")], *self.devices))
            return
        self._framer = MbapFramer()
        self.line.on_write = self._take

    def _take(self, data: bytes) -> None:
        for transaction, unit, pdu in self._framer.cut(data):
            for delay, response in self.devices[unit - 1].ask(Frame(unit, pdu), partial(encode, transaction)):
                asyncio.get_running_loop().call_later(delay, self.line.deliver, response)


@asynccontextmanager
async def there(way: str, keys: str = "") -> AsyncIterator[tuple[GatewayBench, There]]:
    async with gateway_bench(config(way, keys)) as bench:
        yield bench, There(bench, way)


def told(bench: GatewayBench) -> list[Event]:
    """What an operator would worry about."""
    return [event for event in bench.events if isinstance(event, LineLost | LineReopened | UpstreamClosed)]


def state(bench: GatewayBench) -> tuple[str, str]:
    """What status says of the line or the upstream."""
    now = status(bench.running)
    (part,) = [*now.lines, *now.upstreams]
    return part.state, part.reason


@pytest.mark.parametrize("way", WAYS)
async def test_a_server_that_closes_idle_connections_costs_no_request_and_no_word(way: str) -> None:
    async with there(way) as (bench, server):
        client = bench.client()
        server.line.opens_in = 0.15
        for number in range(100):
            assert await client.asks(1, READ) == "03 02 00 05"
            await asyncio.sleep(10)
            server.line.hang_up()
            await asyncio.sleep(20)
            assert server.line.openings == number + 1
            assert state(bench) == ("up", "")
        assert told(bench) == []


@pytest.mark.parametrize("way", WAYS)
async def test_a_server_that_closes_after_each_answer_is_served_too(way: str) -> None:
    async with there(way) as (bench, server):
        client = bench.client()
        for _ in range(100):
            assert await client.asks(1, READ) == "03 02 00 05"
            server.line.hang_up()
        assert told(bench) == []


@pytest.mark.parametrize("way", WAYS)
async def test_an_end_that_has_not_been_noticed_when_a_request_comes_costs_it_nothing(way: str) -> None:
    async with there(way) as (bench, server):
        client = bench.client()
        for number in range(20):
            assert await client.asks(1, READ) == "03 02 00 05"
            await asyncio.sleep(0.1)
            server.line.hang_up(unread=True)
            await asyncio.sleep(0.1)
            assert server.line.openings == number + 1
        assert told(bench) == []


@pytest.mark.parametrize("way", WAYS)
async def test_what_waits_is_asked_over_the_new_connection(way: str) -> None:
    async with there(way) as (bench, server):
        server.line.opens_in = 0.15
        server.line.hang_up()
        client = bench.client()
        for unit in (1, 2, 3):
            client.ask(unit, f"03 00 0{unit} 00 01")
        assert [await client.answer() for _ in range(3)] == [f"03 02 00 0{unit}" for unit in (1, 2, 3)]
        assert server.line.openings == 2
        assert told(bench) == []


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("keys", ["", 'max_wait = "150 ms"'])
async def test_a_request_waits_for_the_connection_as_long_as_its_limit_or_max_wait(way: str, keys: str) -> None:
    async with there(way, keys) as (bench, server):
        client, other = bench.client(), bench.client("10.0.0.8:1")
        server.line.opens_in = 1.0
        server.line.hang_up()
        await asyncio.sleep(5)
        began, bound = client.now(), 0.15 if keys else WAYS[way]
        client.ask(1, READ)
        await asyncio.sleep(0.1)
        other.ask(2, READ)
        assert [await client.answer(), await other.answer()] == ["83 0A"] * 2
        assert client.came_at - began == pytest.approx(bound, abs=0.002)
        assert other.came_at - began == pytest.approx(bound + 0.1, abs=0.002)
        await asyncio.sleep(1)
        assert await client.asks(1, READ) == "03 02 00 05"
        assert server.line.openings == 2
        assert told(bench) == []


@pytest.mark.parametrize("way", WAYS)
async def test_a_server_that_is_gone_when_it_is_needed_is_lost(way: str) -> None:
    async with there(way) as (bench, server):
        client = bench.client()
        server.line.hang_up()
        server.line.pull("refused")
        await asyncio.sleep(60)
        assert told(bench) == []
        for _ in range(2):
            began = client.now()
            assert await client.asks(1, READ) == "83 0A"
            assert client.now() == began
        assert state(bench) == ("down", "refused")
        server.line.plug()
        await asyncio.sleep(1.1)
        assert await client.asks(1, READ) == "03 02 00 05"
        assert [type(event) for event in told(bench)] == [LineLost, LineReopened]


@pytest.mark.parametrize("way", WAYS)
async def test_a_connection_that_ends_with_a_request_under_way_is_lost(way: str) -> None:
    async with there(way) as (bench, server):
        client = bench.client()
        server.devices[0].silent = True
        client.ask(1, READ)
        await asyncio.sleep(0.1)
        server.line.hang_up()
        assert await client.answer() == "83 0B"
        assert await client.asks(2, READ) == "83 0A"
        await asyncio.sleep(1)
        assert await client.asks(2, READ) == "03 02 00 05"
        assert [type(event) for event in told(bench)] == [LineLost, LineReopened]


@pytest.mark.parametrize("way", WAYS)
async def test_a_unit_that_rests_goes_on_resting(way: str) -> None:
    async with there(way) as (bench, server):
        client = bench.client()
        server.devices[0].silent = True
        for _ in range(3):
            assert await client.asks(1, READ) == "83 0B"
            await asyncio.sleep(1)
        server.line.hang_up()
        assert await client.asks(2, READ) == "03 02 00 05"
        began = client.now()
        assert await client.asks(1, READ) == "83 0B"
        assert client.now() == began


async def test_a_late_window_outlasts_it() -> None:
    """The server gives the next connection what it still owes to the one before."""
    async with there("rtu+tcp") as (bench, server):
        client = bench.client()
        server.devices[0].silent = True
        assert await client.asks(1, READ) == "83 0B"
        server.devices[0].silent = False
        server.line.hang_up()
        await asyncio.sleep(0.1)
        assert await client.asks(2, READ) == "03 02 00 05"
        assert await client.asks(1, READ) == "83 0B"
        server.line.deliver(rtu.encode(1, bytes.fromhex("03 02 DE AD")))
        assert await client.asks(1, READ) == "03 02 00 05"


async def test_where_another_client_may_be_the_line_goes_on_listening() -> None:
    """Five minutes after it was heard last, nobody is there any more."""
    async with there("rtu+tcp") as (_, server):
        server.line.deliver(rtu.encode(2, bytes.fromhex("03 00 07 00 01")))
        for _ in range(10):
            await asyncio.sleep(20)
            server.line.hang_up()
            await asyncio.sleep(0.001)
            assert server.line.is_open
        await asyncio.sleep(101)
        server.line.hang_up()
        await asyncio.sleep(60)
        assert not server.line.is_open
        assert server.line.openings == 11


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("is_asked", [False, True])
async def test_a_server_that_closes_at_once_makes_no_storm(way: str, *, is_asked: bool) -> None:
    async with there(way) as (bench, server):
        client, line = bench.client(), server.line
        line.opened = lambda: asyncio.get_running_loop().call_later(0.001, partial(line.hang_up, at_once=True))
        line.hang_up()
        began, before = client.now(), line.openings
        while client.now() < began + 60:
            if is_asked:
                assert await client.asks(1, READ) in {"83 0A", "83 0B"}
            await asyncio.sleep(0.01)
        assert line.openings - before <= (150 if is_asked else 0)
        assert not is_asked or any("has closed" in event.reason for event in told(bench) if isinstance(event, LineLost))
