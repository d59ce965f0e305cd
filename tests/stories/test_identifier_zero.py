"""Servers that always answer with transaction identifier 0, in virtual time: nobody gets another's response."""

import asyncio
import random

import pytest

from gateway.events import LineLost, LineReopened, UpstreamClosed
from gateway.modbus.mbap import MbapFramer, encode
from kit.gateway_bench import Client, GatewayBench, gateway_bench

TO = "tcp://10.1.0.5:502"
CONFIG = f"""
[[upstream]]
name = "inverter"
to = "{TO}"
timeout = "500 ms"
transaction_id = "zero"
units = [{{ as = "1-3", unit = "1-3" }}]
"""
READ = "03 00 05 00 01"


class Server:
    """It answers after `delay`, with identifier 0. A register holds its unit and its address."""

    def __init__(self, bench: GatewayBench) -> None:
        self.line = bench.lines[TO]
        self.line.on_write = self.take
        self.asked: list[tuple[int, int, bytes]] = []
        self.delay = 0.01
        self._framer = MbapFramer()

    def take(self, data: bytes) -> None:
        for adu in self._framer.cut(data):
            self.asked.append(tuple(adu))
            asyncio.get_running_loop().call_later(self.delay, self.line.deliver, answer(adu.unit, adu.pdu[2]))


def answer(unit: int, address: int, identifier: int = 0) -> bytes:
    return encode(identifier, unit, bytes((3, 2, unit, address)))


def troubles(bench: GatewayBench) -> list[type]:
    return [type(event) for event in bench.events if isinstance(event, LineLost | LineReopened | UpstreamClosed)]


async def test_its_answers_are_taken_and_the_connection_stays() -> None:
    async with gateway_bench(CONFIG) as bench:
        server, client = Server(bench), bench.client()
        for unit in (1, 2, 3) * 5:
            assert await client.asks(unit, READ) == f"03 02 0{unit} 05"
        assert server.line.openings == 1


async def test_the_right_identifier_is_taken_too_and_no_other_one() -> None:
    async with gateway_bench(CONFIG) as bench:
        server, client = Server(bench), bench.client()
        server.line.on_write = None
        client.ask(1, READ)
        server.line.deliver(answer(1, 9, identifier=2))
        server.line.deliver(answer(1, 5, identifier=1))
        assert await client.answer() == "03 02 01 05"


async def test_without_zero_such_an_answer_is_none() -> None:
    async with gateway_bench(CONFIG.replace("zero", "checked")) as bench:
        Server(bench)
        assert await bench.client().asks(1, READ) == "83 0B"


async def test_after_a_time_out_the_next_request_has_a_new_connection_in_silence() -> None:
    async with gateway_bench(CONFIG) as bench:
        server, client, other = Server(bench), bench.client(), bench.client("10.0.0.8:1")
        server.delay = 0.7
        client.ask(1, "03 00 06 00 01")
        other.ask(2, READ)
        assert await client.answer() == "83 0B"
        server.delay = 0.3
        assert await other.answer() == "03 02 02 05"
        assert server.line.openings == 2
        assert troubles(bench) == []


async def test_a_late_answer_reaches_nobody_while_the_connection_is_opened() -> None:
    async with gateway_bench(CONFIG) as bench:
        server, client = Server(bench), bench.client()
        server.delay, server.line.opens_in = 0.6, 0.2
        assert await client.asks(1, "03 00 06 00 01") == "83 0B"
        server.delay = 0.01
        assert await client.asks(1, READ) == "03 02 01 05"


@pytest.mark.parametrize("keys", ["retries = 1", 'wake = "10 s"'])
async def test_a_read_that_is_sent_again_has_a_new_connection_too(keys: str) -> None:
    async with gateway_bench(CONFIG.replace("units =", f"{keys}\nunits =")) as bench:
        server, client = Server(bench), bench.client()
        server.delay = 0.6
        client.ask(1, READ)
        await asyncio.sleep(0.55)
        server.delay = 0.01
        assert await client.answer() == "03 02 01 05"
        assert server.line.openings == 2
        assert len(server.asked) == 2


@pytest.mark.parametrize(
    "more",
    [
        answer(1, 5),  # the same again
        answer(2, 7, identifier=77),
        answer(1, 5)[:5],  # a part of it
        b"\x00",
    ],
)
@pytest.mark.parametrize("when", ["behind the answer", "later", "unread"])
async def test_what_comes_besides_costs_the_connection_and_no_request(more: bytes, when: str) -> None:
    async with gateway_bench(CONFIG) as bench:
        server, client = Server(bench), bench.client()
        server.line.on_write = None
        client.ask(1, READ)
        server.line.deliver(answer(1, 5) + (more if when == "behind the answer" else b""))
        assert await client.answer() == "03 02 01 05"
        if when == "unread":
            server.line.leave_unread()
        if when != "behind the answer":
            server.line.deliver(more)
        server.line.on_write = server.take
        assert await client.asks(1, "03 00 07 00 01") == "03 02 01 07"
        assert server.line.openings == 2
        assert troubles(bench) == []


async def test_bytes_before_the_answer_of_a_waiting_request_are_read_before_it_is_sent() -> None:
    """The next request waits already when the answer comes, and the copy behind it is still unread."""
    async with gateway_bench(CONFIG) as bench:
        server, client, other = Server(bench), bench.client(), bench.client("10.0.0.8:1")
        server.line.on_write = None
        client.ask(1, READ)
        other.ask(1, "03 00 07 00 01")
        port = server.line._port
        deliver = port.user.received
        port.pause()
        server.line.deliver(answer(1, 5))
        server.line.on_write = server.take
        deliver(answer(1, 5))
        assert [await client.answer(), await other.answer()] == ["03 02 01 05", "03 02 01 07"]
        assert server.line.openings == 2


async def test_a_request_without_an_expected_answer_costs_the_connection() -> None:
    """A server may answer it all the same."""
    async with gateway_bench(CONFIG) as bench:
        server, client = Server(bench), bench.client()
        server.line.on_write = None
        client.ask(1, "08 00 04 00 00")
        await asyncio.sleep(0.1)
        server.line.on_write = server.take
        assert await client.asks(1, READ) == "03 02 01 05"
        assert server.line.openings == 2


async def test_an_answer_in_pieces_costs_nothing() -> None:
    async with gateway_bench(CONFIG) as bench:
        server, client = Server(bench), bench.client()
        server.line.on_write = None
        client.ask(1, READ)
        whole = answer(1, 5)
        for at in range(len(whole)):
            await asyncio.sleep(0.01)
            server.line.deliver(whole[at : at + 1])
        assert await client.answer() == "03 02 01 05"
        server.line.on_write = server.take
        assert await client.asks(2, READ) == "03 02 02 05"
        assert server.line.openings == 1


class Faulty:
    """A server whose answers are late, lost, twice at once, with more, in pieces, or followed by the end."""

    def __init__(self, bench: GatewayBench, chance: random.Random) -> None:
        self.line = bench.lines[TO]
        self.line.on_write = self._take
        self._chance = chance
        self._framer = MbapFramer()
        self._connection = 0

    def _take(self, data: bytes) -> None:
        if self._connection != self.line.openings:
            self._connection, self._framer = self.line.openings, MbapFramer()
        for adu in self._framer.cut(data):
            identifier = self._chance.choice([0, 0, 0, adu.transaction])
            self._answer(answer(adu.unit, adu.pdu[2], identifier), answer(adu.unit % 3 + 1, adu.pdu[2]))

    def _answer(self, right: bytes, wrong: bytes) -> None:
        chance = self._chance
        part = right[: chance.randrange(1, len(right))]
        ways = [b"", right + right, part, right + part, wrong + right, right, right, right]
        is_late = chance.random() < 0.1
        self._say(chance.uniform(0.4, 1.2) if is_late else 0.01, chance.choice(ways))
        if chance.random() < 0.1:
            asyncio.get_running_loop().call_later(0.01, self.line.hang_up)

    def _say(self, delay: float, data: bytes) -> None:
        """Say this on the present connection, not on a later one."""
        line, here = self.line, self.line.openings
        asyncio.get_running_loop().call_later(delay, lambda: line.deliver(data) if line.openings == here else None)

    async def disturb(self) -> None:
        """Say what nobody has asked for, which the gateway has not read when it asks the next time."""
        chance = self._chance
        while True:
            await asyncio.sleep(chance.uniform(0.5, 3))
            self.line.leave_unread()
            if chance.random() < 0.5:
                self.line.deliver(answer(chance.choice([1, 2, 3]), 0xEE, chance.choice([0, 3]))[: chance.randrange(12)])


@pytest.mark.parametrize(
    "keys", ["", 'retries = 1\nwake = "3 s"', 'gap = "20 ms"\nidle = "1 s"', 'after_connect = "100 ms"']
)
@pytest.mark.parametrize("seed", range(5))
async def test_whatever_it_does_nobody_gets_anothers_answer(seed: int, keys: str) -> None:
    """But no copy of an answer comes later, while the next request is under way: that cannot be detected."""
    chance = random.Random(seed)
    async with gateway_bench(CONFIG.replace("units =", f"{keys}\nunits =")) as bench:
        server = Faulty(bench, chance)
        good: list[str] = []

        async def ask(client: Client) -> None:
            for _ in range(150):
                unit, address = chance.choice([1, 2, 3]), chance.randrange(256)
                response = await client.asks(unit, f"03 00 {address:02X} 00 01")
                if not response.startswith("83"):
                    assert response == f"03 02 {unit:02X} {address:02X}"
                    good.append(response)
                await asyncio.sleep(chance.choice([0, 0.01, 0.3, 2.0]))

        disturbing = asyncio.create_task(server.disturb())
        await asyncio.gather(*(ask(bench.client(f"10.0.0.{number}:1")) for number in range(4)))
        disturbing.cancel()
        assert len(good) > 150
