"""Connections to other servers in virtual time: left when idle, silent at first, and by another address."""

import asyncio
from collections.abc import Callable
from functools import partial

import pytest

from gateway.events import LineLost, LineReopened, LineUp, UpstreamClosed
from gateway.modbus.mbap import MbapFramer, encode
from kit.gateway_bench import GatewayBench, gateway_bench
from kit.memory import MemoryLine
from kit.statuses import status

FIRST, SECOND = "tcp://10.1.0.5:502", "tcp://10.2.0.5:502"
READ = "03 00 05 00 01"


def config(keys: str, *addresses: str) -> str:
    to = ", ".join(f'"{each}"' for each in addresses or (FIRST,))
    return f'[[upstream]]\nname = "there"\nto = [{to}]\n{keys}\nunits = [{{ as = "1-3", unit = "1-3" }}]\n'


def answer_on(line: MemoryLine, value: int, delay: float = 0.0) -> Callable[[bytes], None]:
    """Let a server answer every read with this value."""
    framer = MbapFramer()

    def take(data: bytes) -> None:
        for transaction, unit, _ in framer.cut(data):
            response = encode(transaction, unit, bytes((3, 2, 0, value)))
            asyncio.get_running_loop().call_later(delay, line.deliver, response)

    line.on_write = take
    return take


def state(bench: GatewayBench) -> tuple[str, str]:
    """What status says: whether it is up, and where."""
    (there,) = status(bench.running).upstreams
    return there.state, there.to


def told(bench: GatewayBench) -> list[str]:
    """Names of the events about the connection, with the port."""
    kinds = LineUp | LineLost | LineReopened | UpstreamClosed
    return [f"{type(each).__name__} {getattr(each, 'port', '')}" for each in bench.events if isinstance(each, kinds)]


# --- idle ---


async def test_an_idle_connection_is_closed_in_silence_and_opened_for_the_next_request() -> None:
    async with gateway_bench(config('idle = "10 s"')) as bench:
        line, client = bench.lines[FIRST], bench.client()
        answer_on(line, 7)
        for number in range(1, 6):
            await asyncio.sleep(8.9 if number == 1 else 9.9)
            assert line.is_open
            assert await client.asks(1, READ) == "03 02 00 07"
            await asyncio.sleep(9.99)
            assert line.is_open
            await asyncio.sleep(0.02)
            assert not line.is_open
            assert state(bench) == ("up", FIRST)
            line.opens_in = 0.3
            assert await client.asks(1, READ) == "03 02 00 07"
            assert line.openings == number + 1
            answer_on(line, 7)
        assert told(bench) == [f"LineUp {FIRST}"]


async def test_an_idle_connection_that_cannot_be_opened_again_is_lost() -> None:
    async with gateway_bench(config('idle = "1 s"')) as bench:
        line, client = bench.lines[FIRST], bench.client()
        await asyncio.sleep(5)
        line.pull("refused")
        assert await client.asks(1, READ) == "83 0A"
        assert state(bench)[0] == "down"
        line.plug()
        await asyncio.sleep(2)
        assert told(bench) == [f"LineUp {FIRST}", f"LineLost {FIRST}", f"LineReopened {FIRST}"]


# --- after_connect ---


@pytest.mark.parametrize("keys", ["", 'max_wait = "300 ms"'])
async def test_a_request_waits_through_the_silence_after_connecting(keys: str) -> None:
    async with gateway_bench(config(f'after_connect = "3 s"\n{keys}')) as bench:
        line, client = bench.lines[FIRST], bench.client()
        answer_on(line, 7)
        line.hang_up()
        line.opens_in = 3.2  # the silence is part of the opening
        assert await client.asks(1, READ) == "03 02 00 07"


# --- several addresses ---


async def test_the_next_address_is_used_when_the_first_cannot_be_reached() -> None:
    async with gateway_bench(config("", FIRST, SECOND)) as bench:
        first, second, client = bench.lines[FIRST], bench.lines[SECOND], bench.client()
        answer_on(first, 1)
        answer_on(second, 2)
        assert await client.asks(1, READ) == "03 02 00 01"
        first.pull("gone")
        await asyncio.sleep(0.2)
        assert await client.asks(1, READ) == "03 02 00 02"
        assert state(bench) == ("up", SECOND)
        first.plug()
        await asyncio.sleep(60)
        assert await client.asks(1, READ) == "03 02 00 02"
        second.pull("gone too")
        await asyncio.sleep(0.2)
        assert await client.asks(1, READ) == "03 02 00 01"
        assert told(bench) == [
            f"LineUp {FIRST}",
            f"LineLost {FIRST}",
            f"LineReopened {SECOND}",
            f"LineLost {SECOND}",
            f"LineReopened {FIRST}",
        ]


async def test_an_address_that_does_not_answer_leaves_the_others_their_time() -> None:
    third = "tcp://10.3.0.5:502"
    async with gateway_bench(config("", FIRST, SECOND, third)) as bench:
        client = bench.client()
        for number, address in enumerate((FIRST, SECOND, third)):
            answer_on(bench.lines[address], number)
        bench.lines[FIRST].opens_in = bench.lines[SECOND].opens_in = 1e6
        bench.lines[third].opens_in = 2.0
        bench.lines[FIRST].hang_up()
        assert await client.asks(1, READ) == "83 0A"
        await asyncio.sleep(4)
        assert await client.asks(1, READ) == "03 02 00 02"
        assert told(bench)[1:] == [f"LineUp {third}"]


async def test_each_address_gets_as_much_time_as_a_single_one_in_its_turn() -> None:
    """Connecting takes long there, and nothing answers elsewhere."""
    async with gateway_bench(config("", FIRST, SECOND)) as bench:
        for address, time in ((FIRST, 2.0), (SECOND, 1e6)):
            bench.lines[address].opens_in = time
        answer_on(bench.lines[FIRST], 1)
        bench.lines[FIRST].pull("gone")
        bench.lines[FIRST].plug()
        await asyncio.sleep(30)
        assert await bench.client().asks(1, READ) == "03 02 00 01"


async def test_after_three_time_outs_in_a_row_the_next_address_is_used() -> None:
    async with gateway_bench(config('timeout = "200 ms"', FIRST, SECOND)) as bench:
        second, client = bench.lines[SECOND], bench.client()
        answer_on(second, 2)
        for unit in (1, 2, 3):
            assert await client.asks(unit, READ) == "83 0B"
        for unit in (1, 2, 3):
            assert await client.asks(unit, READ) == "03 02 00 02"
        assert state(bench) == ("up", SECOND)
        assert told(bench) == [f"LineUp {FIRST}", "UpstreamClosed ", f"LineUp {SECOND}"]
        (closed,) = [each for each in bench.events if isinstance(each, UpstreamClosed)]
        assert closed.reason == (f"3 requests in a row have timed out, and nothing came; {SECOND} is tried next")


async def test_what_was_received_keeps_the_address() -> None:
    async with gateway_bench(config('timeout = "200 ms"', FIRST, SECOND)) as bench:
        first, client = bench.lines[FIRST], bench.client()
        take = answer_on(first, 1)
        for _ in range(5):
            first.on_write = None
            for unit in (2, 3):
                assert await client.asks(unit, READ) == "83 0B"
                await asyncio.sleep(10)
            first.on_write = take
            assert await client.asks(1, READ) == "03 02 00 01"
        assert first.openings == 1


async def test_one_hiccup_of_many_requests_keeps_it_too() -> None:
    async with gateway_bench(config('timeout = "200 ms"', FIRST, SECOND)) as bench:
        clients = [bench.client(f"10.0.0.{number}:1") for number in range(6)]
        for client in clients:
            client.ask(1, READ)
        assert [await client.answer() for client in clients] == ["83 0B"] * 6
        assert state(bench) == ("up", FIRST)


async def test_each_address_gets_three_requests() -> None:
    async with gateway_bench(config('timeout = "200 ms"\nrest = "off"', FIRST, SECOND)) as bench:
        client = bench.client()
        for number in range(12):
            assert state(bench) == ("up", (FIRST, SECOND)[number // 3 % 2])
            assert await client.asks(number % 3 + 1, READ) == "83 0B"


async def test_a_late_answer_of_the_first_address_reaches_nobody_at_the_second() -> None:
    async with gateway_bench(config('timeout = "200 ms"', FIRST, SECOND)) as bench:
        first, second, client = bench.lines[FIRST], bench.lines[SECOND], bench.client()
        for unit in (1, 2, 3):
            assert await client.asks(unit, READ) == "83 0B"
        second.on_write = None
        client.ask(1, READ)
        await asyncio.sleep(0.01)
        for transaction in range(1, 6):
            first.deliver(encode(transaction, 1, bytes.fromhex("03 02 DE AD")))
        assert second.is_open
        assert not first.is_open
        assert await client.answer() == "83 0B"


async def test_a_server_with_identifier_zero_is_left_after_three_time_outs_too() -> None:
    keys = 'timeout = "200 ms"\ntransaction_id = "zero"'
    async with gateway_bench(config(keys, FIRST, SECOND)) as bench:
        answer_on(bench.lines[SECOND], 2)
        client = bench.client()
        for unit in (1, 2, 3):
            assert await client.asks(unit, READ) == "83 0B"
        assert await client.asks(1, READ) == "03 02 00 02"


# --- a server that needs silence ---


async def test_a_server_that_needs_a_pause_gets_it() -> None:
    """It ignores what comes within 50 ms of its last response."""
    async with gateway_bench(config('gap = "50 ms"')) as bench:
        line = bench.lines[FIRST]
        loop, framer, answered_at = asyncio.get_running_loop(), MbapFramer(), [0.0]

        def respond(data: bytes) -> None:
            answered_at[0] = loop.time()
            line.deliver(data)

        def take(data: bytes) -> None:
            for transaction, unit, _ in framer.cut(data):
                if loop.time() >= answered_at[0] + 0.05:
                    loop.call_later(0.005, respond, encode(transaction, unit, bytes.fromhex("03 02 00 01")))

        line.on_write = take
        clients = [bench.client(f"10.0.0.{number}:1") for number in range(4)]
        for client in clients:
            for unit in (1, 2, 3, 1, 2):
                client.ask(unit, f"03 00 0{unit} 00 01")
        answers = await asyncio.gather(*(client.answer() for client in clients for _ in range(5)))
        assert answers == ["03 02 00 01"] * 20


@pytest.mark.parametrize("keys", ["", 'gap = "20 ms"'])
async def test_a_server_that_closes_after_each_answer_at_once_is_served_too(keys: str) -> None:
    """The end comes with the answer, and others wait."""
    async with gateway_bench(config(f"in_flight = 1\n{keys}")) as bench:
        line = bench.lines[FIRST]
        loop = asyncio.get_running_loop()

        def respond(data: bytes) -> None:
            line.hang_up(unread=True)
            line.deliver(data)

        def take(data: bytes) -> None:
            for transaction, unit, _ in MbapFramer().cut(data):
                loop.call_later(0.005, partial(respond, encode(transaction, unit, bytes.fromhex("03 02 00 01"))))

        line.on_write = take
        client = bench.client()
        for unit in (1, 2, 3, 1, 2):
            client.ask(unit, READ)
        assert [await client.answer() for _ in range(5)] == ["03 02 00 01"] * 5
        assert "LineLost" not in str(told(bench))


# --- the longest wait ---


@pytest.mark.parametrize(
    "keys",
    [
        "",
        "retries = 2",
        'retries = 1\nwake = "1 s"\ngap = "30 ms"',
        'transaction_id = "zero"\nretries = 2\nwake = "1 s"',
        'transaction_id = "zero"\nafter_connect = "200 ms"\nretries = 1\ngap = "30 ms"',
        'idle = "1 s"\nafter_connect = "200 ms"\nretries = 2',
    ],
)
@pytest.mark.parametrize("bytes_of_it", [0, 7], ids=["silence", "half a response"])
async def test_nobody_waits_longer_than_check_says(keys: str, bytes_of_it: int) -> None:
    """The server sends nothing, or a beginning that makes the connection useless. It takes long to accept the next."""
    usual = 'timeout = "300 ms"\nmax_wait = "1 s"\nrest = "off"\nin_flight = 1\n'
    async with gateway_bench(config(usual + keys)) as bench:
        line, longest = bench.lines[FIRST], bench.gateway.longest_waits["there/1"]
        if bytes_of_it:
            line.on_write = lambda request: line.deliver(request[:bytes_of_it])
        line.opens_in = 0.25 + ("after" in keys) * 0.2
        clients = [bench.client(f"10.0.0.{number}:1") for number in range(4)]
        took: list[float] = []

        async def ask(number: int) -> None:
            for round_ in range(10):
                began = clients[number].now()
                answer = await clients[number].asks(1, f"03 00 {number:02X} 00 01")
                assert answer in {"83 0A", "83 0B", "83 06"}
                took.append(clients[number].now() - began)
                await asyncio.sleep(round_ % 3)

        await asyncio.gather(*map(ask, range(4)))
        assert max(took) <= longest
        repeats = 1 + keys.count("wake") + sum(int(one[-1]) for one in keys.splitlines() if "retries" in one)
        assert max(took) >= 0.3 * repeats
