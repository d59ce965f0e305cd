"""A line behind a device server, in virtual time: what belongs to an earlier connection or request is not believed."""

import asyncio

import pytest

from gateway.events import BaudChanged, ConnectionRenewed, LineLost, LineReopened, UnitResting
from gateway.modbus import rtu
from gateway.ports.port import TcpSettings
from kit.device import Answer, SimulatedDevice, SimulatedLine
from kit.gateway_bench import GatewayBench, gateway_bench

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
    async with gateway_bench(CONFIG) as bench:
        device = SimulatedDevice(1, delay=0.25)
        device.holding[5] = 7
        bench.attach(PORT, SimulatedLine("rtu", device))
        assert bench.opened[PORT] == TcpSettings(PORT, "10.0.0.9", 4001, latency=0.1)
        assert await bench.client().asks(1, READ) == "03 02 00 07"


async def test_the_answer_that_a_lost_connection_leaves_owing_is_not_given_to_the_next_request() -> None:
    async with gateway_bench(CONFIG) as bench:
        line, client = bench.lines[PORT], bench.client()
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
    async with gateway_bench(config) as bench:
        bench.attach(PORT, SimulatedLine("rtu", SimulatedDevice(1, items=0x300)))
        await bench.client().asks(1, "10 02 00 00 02 04 46 96 00 00")
        assert [event.baud for event in bench.events if isinstance(event, BaudChanged)] == [19200]
        assert bench.lines[PORT].baud == 19200
        assert bench.gateway.lines[0].driver.line.settings.timing.baud == 19200


@pytest.mark.parametrize("pdu", ["03 0005 0001", "11", "18 0001", "2B 0E 01 00", "14 07 06 0001 0000 0001"])
async def test_a_response_that_promises_more_than_follows_swallows_no_other(pdu: str) -> None:
    async with gateway_bench(CONFIG.replace("unit = 1", 'unit = "1-2"')) as bench:
        devices, client = [SimulatedDevice(1), SimulatedDevice(2)], bench.client()
        bench.attach(PORT, SimulatedLine("rtu", *devices))
        begun = bytes((1, int(pdu[:2], 16), 0xFA, 1, 2, 3, 4))
        devices[0].script.append([Answer(0.01, begun)])
        assert (await client.asks(1, pdu))[2:] == " 0B"
        for unit, asked in ((2, "03"), (1, "04"), (2, "04")):
            assert await client.asks(unit, f"{asked} 0005 0001") == f"{asked} 02 00 00"


# --- servers that stall ---

STALLING = CONFIG.replace("unit = 1", 'unit = "1-3"')
#: The limit of a read, and how long a late answer to it is awaited after that.
LIMIT, WINDOW = 0.32, 0.64


class Server:
    """A device server with units 1 to 3, whose registers hold their addresses. One connection at a time.

    While it is `stalled` it takes what comes, and asks nobody. What a connection has left behind is forgotten with it.
    """

    def __init__(self, bench: GatewayBench) -> None:
        self.stalled = False
        self.devices = [SimulatedDevice(unit) for unit in (1, 2, 3)]
        for device in self.devices:
            device.holding = list(range(100))
        self._line = bench.lines[PORT]
        self._line.on_write = self._take
        self._devices = SimulatedLine("rtu", *self.devices)
        self._waiting: list[tuple[int, bytes]] = []

    @property
    def connections(self) -> int:
        return self._line.openings

    def go_on(self) -> None:
        """Work off what has come meanwhile."""
        self.stalled = False
        waiting, self._waiting = self._waiting, []
        for connection, data in waiting:
            if connection == self.connections:
                self._ask(data)

    def _take(self, data: bytes) -> None:
        if self.stalled:
            self._waiting.append((self.connections, data))
        else:
            self._ask(data)

    def _ask(self, data: bytes) -> None:
        loop = asyncio.get_running_loop()
        for delay, response in self._devices.received(data, loop.time()):
            loop.call_later(delay, self._line.deliver, response)


@pytest.mark.parametrize("lasts", [WINDOW + 0.01, 1.0, 1.3, 2.0, 5.0, 60.0])
async def test_a_request_that_a_stalled_server_held_back_never_answers_the_next_one(lasts: float) -> None:
    async with gateway_bench(STALLING) as bench:
        server, client = Server(bench), bench.client()
        server.stalled = True
        asyncio.get_running_loop().call_later(LIMIT + lasts, server.go_on)
        answers = [await client.asks(1, "03 0005 0001")]
        for address in range(6, 100):
            answers.append(await client.asks(1, f"03 {address:04X} 0001"))
            assert answers[-1] in ("83 0B", "83 0A", f"03 02 {address:04X}"[:8] + f" {address:02X}"), address
            await asyncio.sleep(0.05)
        assert server.connections > 1
        assert answers[0] == "83 0B"


async def test_a_dead_unit_among_living_ones_costs_no_connection() -> None:
    async with gateway_bench(STALLING) as bench:
        server, client = Server(bench), bench.client()
        server.devices[0].silent = True
        for address in range(90):
            await client.asks(1, READ)
            assert await client.asks(2, f"03 {address:04X} 0001") == f"03 02 00 {address:02X}"
            await asyncio.sleep(0.5)
        assert server.connections == 1


async def test_a_dead_unit_that_is_asked_alone_rests_and_its_connections_are_no_alarm() -> None:
    async with gateway_bench(STALLING) as bench:
        server, client = Server(bench), bench.client()
        server.devices[0].silent = True
        for _ in range(600):
            assert await client.asks(1, READ) == "83 0B"
            await asyncio.sleep(0.1)
        assert 3 <= server.connections <= 8
        told = [event for event in bench.events if isinstance(event, ConnectionRenewed)]
        assert (len(told), told[0].line) == (server.connections - 1, "hall-a")
        assert any(isinstance(event, UnitResting) for event in bench.events)
        assert not any(isinstance(event, LineLost | LineReopened) for event in bench.events)


async def test_what_waits_meanwhile_is_asked_over_the_new_connection() -> None:
    async with gateway_bench(STALLING) as bench:
        server, client = Server(bench), bench.client()
        server.devices[0].silent = True
        bench.lines[PORT].opens_in = 0.1
        assert await client.asks(1, READ) == "83 0B"
        server.devices[0].silent = False
        await asyncio.sleep(WINDOW - 0.1)
        client.ask(1, READ)
        await asyncio.sleep(0.15)
        assert not bench.lines[PORT].is_open
        client.ask(2, "03 00 06 00 01")
        assert [await client.answer(), await client.answer()] == ["03 02 00 05", "03 02 00 06"]
        assert server.connections == 2


async def test_a_server_that_takes_no_new_connection_is_down_as_any_other() -> None:
    async with gateway_bench(STALLING) as bench:
        server, client, line = Server(bench), bench.client(), bench.lines[PORT]
        server.stalled = True
        bench.lines[PORT].opens_in = 0.1
        assert await client.asks(1, READ) == "83 0B"
        await asyncio.sleep(WINDOW - 0.1)
        client.ask(1, READ)
        await asyncio.sleep(0.15)
        line.pull("it takes none")
        assert await client.answer() == "83 0A"
        assert [event.reason for event in bench.events if isinstance(event, LineLost)] == ["it takes none"]
        began = client.now()
        assert await client.asks(2, READ) == "83 0A"
        assert client.now() == began
        line.plug()
        server.go_on()
        await asyncio.sleep(2.0)
        assert await client.asks(2, READ) == "03 02 00 05"


async def test_a_read_is_repeated_over_the_new_connection() -> None:
    async with gateway_bench(STALLING.replace("[[line]]", "[[line]]\nretries = 1")) as bench:
        server, client = Server(bench), bench.client()
        server.stalled = True
        asyncio.get_running_loop().call_later(LIMIT + WINDOW + 0.05, server.go_on)
        assert await client.asks(1, READ) == "03 02 00 05"
        assert server.connections == 2
