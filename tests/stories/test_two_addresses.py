"""A server with two addresses, one of which hears and never answers, in virtual time."""

import asyncio
from collections.abc import AsyncIterator

import pytest

from gateway.modbus.mbap import MbapFramer, encode
from kit.gateway_bench import GatewayBench, gateway_bench
from kit.memory import MemoryLine

DEAF, OTHER = "tcp://10.1.0.5:502", "tcp://10.2.0.5:502"
CONFIG = f"""
[[upstream]]
name    = "roof"
to      = ["{DEAF}", "{OTHER}"]
units   = [{{ unit = "1-3" }}]
timeout = "200 ms"
"""


@pytest.fixture
async def bench() -> AsyncIterator[GatewayBench]:
    """Registers at the other address hold their addresses."""
    async with gateway_bench(CONFIG) as bench:
        answer_at(bench.lines[OTHER])
        yield bench


def answer_at(line: MemoryLine) -> None:
    def answer(data: bytes) -> None:
        for transaction, unit, pdu in MbapFramer().cut(data):
            line.deliver(encode(transaction, unit, b"\x03\x02" + pdu[1:3]))

    line.on_write = answer


async def test_three_time_outs_in_a_row_lead_to_the_other_address_and_no_unit_rests_for_them(
    bench: GatewayBench,
) -> None:
    client = bench.client()
    began = client.now()
    assert [await client.asks(1, "03 00 05 00 01") for _ in range(4)] == ["83 0B"] * 3 + ["03 02 00 05"]
    assert client.now() - began == pytest.approx(0.6, abs=0.01)
    assert (bench.lines[DEAF].is_open, bench.lines[OTHER].is_open) == (False, True)


async def test_a_late_answer_from_the_address_that_was_left_reaches_nobody(bench: GatewayBench) -> None:
    client = bench.client()
    for _ in range(3):
        assert await client.asks(1, "03 00 05 00 01") == "83 0B"
    late = bench.lines[DEAF].take_written()
    assert await client.asks(1, "03 00 05 00 01") == "03 02 00 05"
    bench.lines[OTHER].on_write = None
    client.ask(1, "03 00 06 00 01")
    for transaction, unit, pdu in MbapFramer().cut(late):
        bench.lines[DEAF].deliver(encode(transaction, unit, b"\x03\x02" + pdu[1:3]))
    await asyncio.sleep(0.1)
    assert client.responses.empty()


async def test_time_outs_at_an_address_that_was_lost_do_not_count_at_the_next_one(bench: GatewayBench) -> None:
    client, deaf, other = bench.client(), bench.lines[DEAF], bench.lines[OTHER]
    for _ in range(2):
        assert await client.asks(1, "03 00 05 00 01") == "83 0B"
    deaf.pull()
    await asyncio.sleep(1.0)
    assert other.is_open
    other.on_write = None
    assert await client.asks(1, "03 00 05 00 01") == "83 0B"
    answer_at(other)
    deaf.plug()
    await asyncio.sleep(1.0)
    assert (deaf.is_open, other.is_open) == (False, True)


async def test_so_it_is_at_an_address_that_was_left_while_idle(bench: GatewayBench) -> None:
    client, deaf, other = bench.client(), bench.lines[DEAF], bench.lines[OTHER]
    for _ in range(2):
        assert await client.asks(1, "03 00 05 00 01") == "83 0B"
    deaf.hang_up()
    deaf.pull()
    other.on_write = None
    assert await client.asks(1, "03 00 05 00 01") == "83 0B"
    deaf.plug()
    assert other.is_open
    answer_at(other)
    assert await client.asks(1, "03 00 05 00 01") == "03 02 00 05"
    assert (deaf.is_open, other.is_open) == (False, True)
