"""A client that asks without end, and one that asks now and then: the second does not stand behind the first (C11)."""

import asyncio

from kit.device import SimulatedDevice, SimulatedLine
from kit.house import house

CONFIG = """
[[line]]
port    = "/dev/hall-a"
baud    = 9600
devices = [{ unit = 1 }]
"""


async def test_a_modest_client_waits_for_no_more_turns_than_there_are_clients() -> None:
    async with house(CONFIG) as home:
        home.attach("hall-a", SimulatedLine("rtu", SimulatedDevice(1)))
        greedy, modest = home.client("10.0.0.9:1"), home.client("10.0.0.7:1")
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
