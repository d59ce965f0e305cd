"""Clients that ask without end, and one that asks now and then: it neither stands behind them nor is refused (C11)."""

import asyncio
import itertools

import pytest

from gateway.events import QueueFull
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import Client, GatewayBench, gateway_bench

CONFIG = """
[[line]]
port    = "/dev/hall-a"
baud    = 9600
devices = [{ unit = 1 }]
"""


async def test_a_modest_client_waits_for_no_more_turns_than_there_are_clients() -> None:
    async with gateway_bench(CONFIG) as bench:
        bench.attach("hall-a", SimulatedLine("rtu", SimulatedDevice(1)))
        greedy, modest = bench.client("10.0.0.9:1"), bench.client("10.0.0.7:1")
        for address in range(16):
            greedy.ask(1, f"03 {address:04X} 0001")

        async def greedy_asks(times: int) -> None:
            for number in range(times):
                await greedy.answer()
                greedy.ask(1, f"03 {number:04X} 0001")

        begin = greedy.now()
        await greedy_asks(times=100)
        turn = (greedy.now() - begin) / 100
        for number in range(20):
            await greedy_asks(times=10)
            await asyncio.sleep(turn * number / 20)
            begin = modest.now()
            assert await modest.asks(1, "03 0064 0001") == "03 02 00 00"
            waited = modest.came_at - begin - turn
            assert waited <= 2 * turn + 0.001


async def test_a_client_with_one_request_is_not_refused_though_others_have_filled_the_queue() -> None:
    """Promise P18: five connections of one host keep sixteen requests each under way, and 64 may wait."""
    async with gateway_bench(CONFIG) as bench:
        bench.attach("hall-a", SimulatedLine("rtu", SimulatedDevice(1)))
        greedy = [bench.client(f"10.0.0.9:{number}", host="127.0.0.9") for number in range(5)]
        modest = bench.client("10.0.0.7:1", host="127.0.0.7")
        asking = [asyncio.create_task(keeps_asking(client)) for client in greedy]
        await asyncio.sleep(1)
        for _ in range(12):
            assert await modest.asks(1, "03 0064 0001") == "03 02 00 00"
            await asyncio.sleep(1)
        assert {told.client[:8] for told in queue_full(bench)} == {"10.0.0.9"}
        for task in asking:
            task.cancel()


@pytest.mark.search
async def test_clients_that_ask_again_at_once_are_not_refused_over_and_over() -> None:
    """Each refusal costs the processor what the lines need: there are not many more of them than answers."""
    async with gateway_bench(CONFIG) as bench:
        bench.attach("hall-a", SimulatedLine("rtu", SimulatedDevice(1)))
        greedy = [bench.client(f"10.0.0.9:{number}", host="127.0.0.9") for number in range(60)]
        asking = [asyncio.create_task(keeps_asking(client)) for client in greedy]
        await asyncio.sleep(5)
        refused_before = len(queue_full(bench))
        await asyncio.sleep(10)
        assert (len(queue_full(bench)) - refused_before) / 10 < 1000
        for task in asking:
            task.cancel()


async def keeps_asking(client: Client) -> None:
    """Keep sixteen requests under way, whatever is answered; a network takes a millisecond."""
    for address in range(16):
        client.ask(1, f"03 {address:04X} 0001")
    for number in itertools.count(16):
        await client.answer()
        await asyncio.sleep(0.001)
        client.ask(1, f"03 {number:04X} 0001")


def queue_full(bench: GatewayBench) -> list[QueueFull]:
    return [event for event in bench.events if isinstance(event, QueueFull)]
