"""A client that sends no more, as `nc -N` does: whatever it asked before is answered, then it is closed."""

import asyncio

import pytest

from gateway.events import WriteAudit
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import Client, gateway_bench

CONFIG = """
[[line]]
name    = "hall-a"
port    = "/dev/hall-a"
devices = [{ unit = 1, name = "press" }, { unit = 2 }]

[[image]]
unit = 241
of   = "press"
read = [{ holding = "0-9", every = "10 s" }]
"""
WRITE = "06 0001 0007"


@pytest.mark.parametrize("unit", [1, 241])
async def test_a_write_that_still_waits_is_answered_06_and_not_sent(unit: int) -> None:
    async with gateway_bench(CONFIG) as bench:
        press = SimulatedDevice(1)
        bench.attach("hall-a", SimulatedLine("rtu", press, SimulatedDevice(2)))
        client = bench.client()
        for _ in range(3):
            client.ask(2, "03 0000 0001")
        client.ask(unit, WRITE)
        client.session.end_of_input()
        assert not client.session.gone
        assert await answers(client, 4) == {1: "03 02 00 00", 2: "03 02 00 00", 3: "03 02 00 00", 4: "86 06"}
        assert client.session.gone
        assert press.holding[1] == 0
        assert [(told.unit, told.result, told.code) for told in bench.events if isinstance(told, WriteAudit)] == [
            (unit, "unwanted", "06")
        ]


async def test_a_write_that_is_on_the_line_already_is_answered() -> None:
    async with gateway_bench(CONFIG) as bench:
        press = SimulatedDevice(1)
        bench.attach("hall-a", SimulatedLine("rtu", press))
        await asyncio.sleep(2)  # the mirror has polled
        client = bench.client()
        client.ask(1, WRITE)
        client.session.end_of_input()
        assert await client.answer() == "06 00 01 00 07"
        assert client.session.gone
        assert press.holding[1] == 7


async def answers(client: Client, count: int) -> dict[int, str]:
    """The next responses, by transaction."""
    async with asyncio.timeout(30):
        came = [await client.responses.get() for _ in range(count)]
    return {transaction: pdu for transaction, _, pdu in came}
