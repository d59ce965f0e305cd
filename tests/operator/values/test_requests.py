"""Requests of operators in virtual time."""

import asyncio

import pytest

from gateway.runtime.running import LONGEST_START
from kit.asking import ask
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import gateway_bench

CONFIG = """
[[line]]
name = "hall"
port = "/dev/hall"
wire = "direct"
devices = [{ unit = 1 }]
"""


async def read(bench):
    return await ask(bench.running, "request", unit=1, pdu="03 00 00 00 01")


@pytest.mark.parametrize("waits", [1.0, LONGEST_START + 1.0])
async def test_a_request_that_is_there_before_its_line_waits_for_it(waits):
    async with gateway_bench(CONFIG) as bench:
        bench.attach("hall", SimulatedLine("rtu", SimulatedDevice(1)))
        (line,) = bench.gateway.lines
        line.reconnector.tried.clear()
        reading = asyncio.create_task(read(bench))
        await asyncio.sleep(waits)
        assert reading.done() == (waits > LONGEST_START)
        line.reconnector.tried.set()
        assert (await reading)["pdu"] == "03 02 00 00"
