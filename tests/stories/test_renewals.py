"""Dead units on a line behind a device server, in virtual time: what new connections cost the living unit."""

import asyncio

import pytest

from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import Client, gateway_bench

PORT = "rtu+tcp://10.0.0.9:4001"
DEAD, LIVING = range(1, 11), 11
#: How long a server takes to take a connection, and how long what it held is dropped.
OPENS_IN = 0.15
CONFIG = f"""
[[line]]
name    = "hall-a"
port    = "{PORT}"
baud    = 9600
timeout = "%d ms"
devices = [{{ unit = "1-11" }}]
"""


async def poll(client: Client, unit: int, every: float, answers: list[str]) -> None:
    while True:
        answers.append(await client.asks(unit, "03 00 05 00 01"))
        await asyncio.sleep(every)


@pytest.mark.parametrize("milliseconds", [50, 100, 200])
async def test_dead_units_behind_a_device_server_do_not_starve_the_living_one(milliseconds: int) -> None:
    async with gateway_bench(CONFIG % milliseconds) as bench:
        bench.lines[PORT].opens_in = OPENS_IN
        bench.attach(PORT, SimulatedLine("rtu", SimulatedDevice(LIVING)))
        answers: list[str] = []
        async with asyncio.TaskGroup() as group:
            polls = [poll(bench.client(), LIVING, 5.0, answers)]
            polls += [poll(bench.client(f"10.0.1.{unit}:49152"), unit, 0.5, []) for unit in DEAD]
            tasks = [group.create_task(each) for each in polls]
            await asyncio.sleep(120.0)
            for task in tasks:
                task.cancel()
        assert len(answers) >= 20
        assert "83 0A" not in answers
        assert answers.count("03 02 00 00") >= len(answers) - 1  # before the dead units rest, one may wait too long
        assert bench.lines[PORT].openings < 50
