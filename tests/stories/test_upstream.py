"""A gateway in front of another one, in virtual time: units behind it beside a line and an image of its own."""

import asyncio

import pytest

from gateway.events import LineLost, LineReopened, UpstreamClosed
from gateway.modbus.mbap import MbapFramer, encode
from kit.gateway_bench import GatewayBench, gateway_bench

CONFIG = """
[[line]]
name = "hall-a"
port = "/dev/hall-a"

[[upstream]]
name  = "plant-1"
to    = "tcp://10.1.0.5:502"
units = [{ as = "37-39", unit = "1-3" }]

[[image]]
unit = 200
holding = 10
"""
TO = "tcp://10.1.0.5:502"


class Server:
    """Another Modbus TCP server. A register's value is its unit and its address; each unit has a delay of its own."""

    def __init__(self, bench: GatewayBench) -> None:
        self.line = bench.lines[TO]
        self.line.on_write = self._take
        self.delays: dict[int, float] = {}
        self.asked: list[tuple[int, str]] = []
        self._framer = MbapFramer()

    def _take(self, data: bytes) -> None:
        for adu in self._framer.cut(data):
            self.asked.append((adu.unit, adu.pdu.hex(" ").upper()))
            answer = encode(adu.transaction, adu.unit, bytes((3, 2, adu.unit, adu.pdu[2])))
            asyncio.get_running_loop().call_later(self.delays.get(adu.unit, 0.01), self.line.deliver, answer)


async def test_units_behind_another_server_answer_beside_the_gateways_own() -> None:
    async with gateway_bench(CONFIG) as bench:
        server, client = Server(bench), bench.client()
        assert await client.asks(37, "03 00 05 00 01") == "03 02 01 05"
        assert await client.asks(39, "03 00 06 00 01") == "03 02 03 06"
        assert await client.asks(200, "03 00 06 00 01") == "03 02 00 00"
        assert server.asked == [(1, "03 00 05 00 01"), (3, "03 00 06 00 01")]


async def test_a_slow_unit_holds_up_no_other() -> None:
    async with gateway_bench(CONFIG) as bench:
        server, client = Server(bench), bench.client()
        server.delays[1] = 0.9
        began = client.now()
        client.ask(37, "03 00 01 00 01")
        for address in range(10):
            assert await client.asks(38, f"03 00 {address:02X} 00 01") == f"03 02 02 {address:02X}"
        assert client.now() - began < 0.2
        assert await client.answer() == "03 02 01 01"


async def test_a_dead_unit_that_many_clients_ask_takes_the_places_of_others_for_one_limit_only() -> None:
    async with gateway_bench(CONFIG) as bench:
        server = Server(bench)
        server.delays[1] = 1e6

        async def ask_in_vain(number: int) -> None:
            client = bench.client(f"10.0.1.{number}:1")
            while True:
                assert (await client.asks(37, "03 00 01 00 01"))[:2] == "83"
                await asyncio.sleep(0.1)

        crowd = [asyncio.create_task(ask_in_vain(number)) for number in range(20)]
        await asyncio.sleep(1.1)
        client = bench.client()
        for address in range(250):
            began = client.now()
            assert await client.asks(38, f"03 00 {address:02X} 00 01") == f"03 02 02 {address:02X}"
            assert client.now() - began < 0.05
            await asyncio.sleep(0.1)
        for task in crowd:
            task.cancel()


async def test_a_unit_that_is_always_late_gives_nobody_anothers_value() -> None:
    async with gateway_bench(CONFIG) as bench:
        server, client = Server(bench), bench.client()
        server.delays[1] = 1.2
        for address in range(1, 20):
            answer = await client.asks(37, f"03 00 {address:02X} 00 01")
            assert answer in {"83 0B", f"03 02 01 {address:02X}"}


async def test_a_unit_behind_another_server_can_be_mirrored() -> None:
    mirror = '[[image]]\nunit = 241\nof = "plant-1/38"\nread = [{ holding = "5-5", every = "500 ms" }]\nstale = "1 s"\n'
    async with gateway_bench(CONFIG + mirror) as bench:
        server, client = Server(bench), bench.client()
        await asyncio.sleep(1)
        polls = len(server.asked)
        for _ in range(20):
            assert await client.asks(241, "03 00 05 00 01") == "03 02 02 05"
        assert len(server.asked) == polls > 0
        server.line.pull()
        await asyncio.sleep(2)
        assert await client.asks(241, "03 00 05 00 01") == "83 0B"


async def test_a_read_only_client_writes_nothing_upstream() -> None:
    async with gateway_bench(CONFIG) as bench:
        server = Server(bench)
        assert await bench.client(host="10.0.0.9").asks(37, "06 00 01 00 05") == "86 01"
        assert server.asked == []


async def test_a_lost_connection_is_0b_then_0a_and_made_again() -> None:
    async with gateway_bench(CONFIG) as bench:
        server, client = Server(bench), bench.client()
        server.delays[1] = 0.5
        client.ask(37, "03 00 01 00 01")
        await asyncio.sleep(0.1)
        server.line.pull("gone")
        assert await client.answer() == "83 0B"
        assert await client.asks(38, "03 00 01 00 01") == "83 0A"
        server.line.plug()
        await asyncio.sleep(2)
        assert await client.asks(38, "03 00 01 00 01") == "03 02 02 01"
        told = [event for event in bench.events if isinstance(event, LineLost | LineReopened)]
        assert [(type(event), event.line) for event in told] == [(LineLost, "plant-1"), (LineReopened, "plant-1")]


async def test_a_server_that_speaks_something_else_is_left_and_tried_again() -> None:
    async with gateway_bench(CONFIG) as bench:
        server, client = Server(bench), bench.client()
        client.ask(37, "03 00 01 00 01")
        server.line.deliver(b"SSH-2.0-OpenSSH_9.2\r\n")
        assert await client.answer() == "83 0B"
        await asyncio.sleep(2)
        assert await client.asks(37, "03 00 01 00 01") == "03 02 01 01"
        assert sum(isinstance(event, UpstreamClosed) for event in bench.events) == 1


@pytest.mark.parametrize("length", [6, 71, 254])
async def test_a_response_whose_length_is_too_large_costs_one_limit(length: int) -> None:
    """It has the identifier of its request, or that of none."""
    async with gateway_bench(CONFIG) as bench:
        server, client = Server(bench), bench.client()
        take, server.line.on_write = server.line.on_write, None
        for identifier in (1, 1000):
            server.line.on_write = None
            began = client.now()
            client.ask(37, "03 00 01 00 01")
            wrong = encode(identifier, 1, bytes.fromhex("03 02 01 01"))
            server.line.deliver(wrong[:4] + length.to_bytes(2) + wrong[6:])
            assert await client.answer() == "83 0B"
            assert client.now() - began == pytest.approx(1.0, abs=0.001)
            server.line.on_write = take
            server._framer = MbapFramer()
            for unit in (37, 38, 39):
                assert await client.asks(unit, "03 00 05 00 01") == f"03 02 0{unit - 36} 05"
            assert client.now() - began < 1.1
        reasons = [event.reason for event in bench.events if isinstance(event, UpstreamClosed)]
        assert reasons == ["a response was cut, or its length is wrong: 11 bytes came of it"] * 2
        assert not any(isinstance(event, LineLost | LineReopened) for event in bench.events)


async def test_what_waits_is_asked_over_the_next_connection_after_a_response_that_was_cut() -> None:
    config = CONFIG.replace("units =", "in_flight = 1\nunits =")
    async with gateway_bench(config) as bench:
        server, client = Server(bench), bench.client()
        server.delays[1] = 1e6
        client.ask(37, "03 00 01 00 01")
        client.ask(38, "03 00 02 00 01")
        server.line.deliver(encode(1, 1, bytes.fromhex("03 02 01 01"))[:-1])
        assert [await client.answer(), await client.answer()] == ["83 0B", "03 02 02 02"]
        assert server.line.openings == 2


async def test_a_read_whose_response_was_cut_is_sent_again_over_the_next_connection() -> None:
    config = CONFIG.replace("units =", "retries = 1\nunits =")
    async with gateway_bench(config) as bench:
        server, client = Server(bench), bench.client()
        take, server.line.on_write = server.line.on_write, None
        client.ask(37, "03 00 01 00 01")
        server.line.deliver(encode(1, 1, bytes.fromhex("03 02 01 01"))[:-1])
        await asyncio.sleep(0.9)
        server.line.on_write, server._framer = take, MbapFramer()
        assert await client.answer() == "03 02 01 01"
        assert server.line.openings == 2


async def test_a_response_that_is_just_coming_in_is_not_cut_when_another_request_times_out() -> None:
    async with gateway_bench(CONFIG) as bench:
        server, client = Server(bench), bench.client()
        server.line.on_write = None
        client.ask(37, "03 00 01 00 01")
        await asyncio.sleep(0.5)
        client.ask(38, "03 00 02 00 01")
        response = encode(2, 2, bytes.fromhex("03 02 02 02"))
        await asyncio.sleep(0.49)
        for at in range(len(response)):
            server.line.deliver(response[at : at + 1])
            await asyncio.sleep(0.005)
        assert [await client.answer(), await client.answer()] == ["83 0B", "03 02 02 02"]
        assert server.line.openings == 1


async def test_broadcasts_do_not_go_upstream() -> None:
    listen = '[[listen]]\nbind = "tcp://127.0.0.1:502"\nunit0 = "broadcast"\n'
    async with gateway_bench(listen + CONFIG) as bench:
        server, client = Server(bench), bench.client()
        client.ask(0, "06 00 01 00 05")
        assert await client.asks(200, "03 00 01 00 01") == "03 02 00 05"
        assert server.asked == []
