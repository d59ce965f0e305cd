"""Lines behind device servers that are left when nobody asks, in virtual time: nothing is lost, and nothing is told."""

import asyncio
from functools import partial

import pytest

from gateway.events import ConnectionRenewed, Event, LineLost, LineReopened, LineUp
from gateway.modbus import rtu
from gateway.operator.status.metrics import read
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import GatewayBench, gateway_bench
from kit.memory import MemoryLine
from kit.statuses import status

PORT = "rtu+tcp://10.0.0.9:4001"
READ = "03 00 05 00 01"
FOREIGN = rtu.encode(2, bytes.fromhex("03 00 07 00 01"))


def config(keys: str = 'idle = "10 s"') -> str:
    return (
        f'[[line]]\nname = "there"\nport = "{PORT}"\nbaud = 9600\ntimeout = "200 ms"\n{keys}\n'
        'devices = [{ unit = "1-3" }]\n'
    )


def server(bench: GatewayBench) -> tuple[MemoryLine, list[SimulatedDevice]]:
    """A server with units 1 to 3, whose registers hold their addresses."""
    devices = [SimulatedDevice(unit) for unit in (1, 2, 3)]
    for device in devices:
        device.holding = list(range(100))
    bench.attach(PORT, SimulatedLine("rtu", *devices))
    return bench.lines[PORT], devices


def told(bench: GatewayBench) -> list[Event]:
    """What an operator would notice, after the start."""
    seen = ConnectionRenewed | LineLost | LineReopened | LineUp
    return [event for event in bench.events if isinstance(event, seen)][1:]


def state(bench: GatewayBench) -> tuple[str, str]:
    (line,) = status(bench.running).lines
    return line.state, line.reason


async def test_an_idle_line_is_left_and_the_next_request_opens_it() -> None:
    async with gateway_bench(config()) as bench:
        line, _ = server(bench)
        client = bench.client()
        line.opens_in = 0.15
        for number in range(100):
            assert await client.asks(1, READ) == "03 02 00 05"
            assert line.openings == number + 1
            await asyncio.sleep(9.9)
            assert line.is_open
            await asyncio.sleep(0.2)
            assert not line.is_open
            assert state(bench) == ("up", "")
            await asyncio.sleep(20)
            assert not line.is_open
        (up,) = [each for each in await read(bench.running) if each.name == "line_up"]
        assert list(up.values) == [(("there",), 1)]
        assert told(bench) == []


async def test_requests_keep_it_open() -> None:
    async with gateway_bench(config()) as bench:
        line, _ = server(bench)
        client = bench.client()
        for _ in range(100):
            assert await client.asks(1, READ) == "03 02 00 05"
            await asyncio.sleep(9.9)
        assert line.openings == 1


async def test_requests_that_come_together_share_the_new_connection() -> None:
    async with gateway_bench(config()) as bench:
        line, _ = server(bench)
        line.opens_in = 0.15
        await asyncio.sleep(11)
        client = bench.client()
        for unit in (1, 2, 3):
            client.ask(unit, f"03 00 0{unit} 00 01")
        assert [await client.answer() for _ in range(3)] == [f"03 02 00 0{unit}" for unit in (1, 2, 3)]
        assert line.openings == 2


async def test_a_request_that_comes_just_when_the_connection_is_closed_is_answered() -> None:
    async with gateway_bench(config()) as bench:
        line, _ = server(bench)
        client = bench.client()
        assert await client.asks(1, READ) == "03 02 00 05"
        released = line.release

        def release() -> None:
            released()
            client.ask(1, READ)

        line.release = release
        await asyncio.sleep(10.1)
        line.release = released
        assert await client.answer() == "03 02 00 05"
        assert (line.openings, told(bench)) == (2, [])


async def test_a_server_that_is_gone_when_it_is_needed_is_lost() -> None:
    async with gateway_bench(config()) as bench:
        line, _ = server(bench)
        client = bench.client()
        await asyncio.sleep(11)
        line.pull("refused")
        await asyncio.sleep(60)
        assert told(bench) == []
        assert await client.asks(1, READ) == "83 0A"
        assert state(bench) == ("down", "refused")
        line.plug()
        await asyncio.sleep(1.1)
        assert await client.asks(1, READ) == "03 02 00 05"
        assert [type(event) for event in told(bench)] == [LineLost, LineReopened]


async def test_a_late_window_keeps_it_open_and_its_answer_is_nobodys() -> None:
    async with gateway_bench(config('idle = "100 ms"')) as bench:
        line, devices = server(bench)
        client = bench.client()
        devices[0].silent = True
        assert await client.asks(1, READ) == "83 0B"
        devices[0].silent = False
        await asyncio.sleep(0.5)
        assert line.is_open
        line.deliver(rtu.encode(1, bytes.fromhex("03 02 DE AD")))
        await asyncio.sleep(0.1)
        assert not line.is_open
        assert await client.asks(1, READ) == "03 02 00 05"


async def test_where_another_client_may_be_the_line_goes_on_listening() -> None:
    """Five minutes after it was heard last, nobody is there any more."""
    async with gateway_bench(config()) as bench:
        line, _ = server(bench)
        line.deliver(FOREIGN)
        await asyncio.sleep(299)
        assert line.is_open
        await asyncio.sleep(1.1)
        assert not line.is_open


async def test_a_client_that_is_heard_as_soon_as_the_line_is_open_counts() -> None:
    async with gateway_bench(config()) as bench:
        line, devices = server(bench)
        client = bench.client()
        await asyncio.sleep(11)
        devices[1].silent = True
        line.opened = lambda: asyncio.get_running_loop().call_soon(line.deliver, FOREIGN)
        client.ask(2, READ)
        await asyncio.sleep(0.15)
        line.deliver(rtu.encode(2, bytes.fromhex("03 02 DE AD")))
        assert await client.answer() == "83 0B"
        await asyncio.sleep(290)
        assert line.is_open


async def test_a_unit_that_rests_goes_on_resting() -> None:
    async with gateway_bench(config('idle = "100 ms"')) as bench:
        line, devices = server(bench)
        client = bench.client()
        devices[0].silent = True
        for _ in range(3):
            assert await client.asks(1, READ) == "83 0B"
            await asyncio.sleep(1)
        assert not line.is_open
        assert await client.asks(2, READ) == "03 02 00 05"
        began = client.now()
        assert await client.asks(1, READ) == "83 0B"
        assert client.now() == began


@pytest.mark.parametrize("idle", ["100 ms", "2 s"])
async def test_a_server_that_closes_before_we_do_makes_no_storm(idle: str) -> None:
    async with gateway_bench(config(f'idle = "{idle}"')) as bench:
        line, _ = server(bench)
        client = bench.client()
        line.opened = lambda: asyncio.get_running_loop().call_later(1.0, partial(line.hang_up))
        for number in range(20):
            assert await client.asks(1, READ) == "03 02 00 05"
            await asyncio.sleep(10)
            assert line.openings <= number + 2
        assert told(bench) == []


@pytest.mark.parametrize(("opens_in", "answer"), [(0.70, "03 02 00 05"), (0.72, "83 0A")])
async def test_the_silence_after_connecting_is_added_to_the_wait(opens_in: float, answer: str) -> None:
    """To the limit of the read, 308 ms. The memory line has no such silence: opening takes so long."""
    async with gateway_bench(config('idle = "10 s"\nafter_connect = "400 ms"')) as bench:
        line, _ = server(bench)
        client = bench.client()
        await asyncio.sleep(11)
        line.opens_in = opens_in
        assert await client.asks(1, READ) == answer
        await asyncio.sleep(1)
        assert told(bench) == []
