"""Devices at addresses that the specification reserves, 248 to 255, and one that answers as 0."""

import pytest

from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import gateway_bench

LINE = """
[[line]]
name    = "hall-a"
port    = "/dev/hall-a"
devices = [{ unit = "247-255" }]
"""
READ = "03 00 05 00 01"
WRITE = bytes.fromhex("06 00 06 00 01")


@pytest.mark.parametrize("unit", range(247, 256))
async def test_it_is_reached_through_every_listener(unit: int) -> None:
    listeners = (
        '[[listen]]\nbind = "tcp://127.0.0.1:5020"\n[[listen]]\nbind = "tcp://127.0.0.1:5021"\nline = "hall-a"\n'
    )
    async with gateway_bench(listeners + LINE) as bench:
        device = SimulatedDevice(unit)
        device.holding[5] = unit
        bench.attach("hall-a", SimulatedLine("rtu", device))
        for listener in (0, 1):
            client = bench.client(listener=listener)
            assert await client.asks(unit, READ) == f"03 02 00 {unit:02X}"
            assert await client.asks(unit, "06 00 06 00 01") == "06 00 06 00 01"


async def test_those_that_are_not_configured_are_0a() -> None:
    async with gateway_bench('[[line]]\nname = "hall-a"\nport = "/dev/hall-a"\n') as bench:
        bench.attach("hall-a", SimulatedLine("rtu", SimulatedDevice(250)))
        assert await bench.client().asks(250, READ) == "83 0A"
        assert await bench.client().asks(247, READ) == "83 0B"


ROWS = """
[[access]]
units = [5, 250]
allow = ["read", "write"]
[[access]]
allow = ["read"]
"""


async def test_rows_of_access_may_name_it_and_a_broadcast_needs_its_right() -> None:
    listen = '[[listen]]\nbind = "tcp://127.0.0.1:5020"\nunit0 = "broadcast"\n'
    config = listen + ROWS + LINE.replace('"247-255"', "[5, 250, 251]")
    async with gateway_bench(config) as bench:
        bench.attach("hall-a", SimulatedLine("rtu", SimulatedDevice(250), SimulatedDevice(251), SimulatedDevice(5)))
        client = bench.client(host="10.0.0.9")
        assert await client.asks(250, "06 00 06 00 01") == "06 00 06 00 01"
        assert await client.asks(251, "06 00 06 00 01") == "86 01"
        assert await client.asks(251, READ) == "03 02 00 00"
        assert await client.asks(0, "06 00 06 00 01") == "86 01"
    everywhere = ROWS.replace("[5, 250]", '["1-247", 250]')
    async with gateway_bench(listen + everywhere + LINE.replace('"247-255"', "[5, 250, 251]")) as bench:
        assert not bench.gateway.listeners[0].router.rights.permits("10.0.0.9", 0, WRITE)
    async with gateway_bench(listen + everywhere + LINE.replace('"247-255"', "[5, 250]")) as bench:
        assert bench.gateway.listeners[0].router.rights.permits("10.0.0.9", 0, WRITE)


@pytest.mark.parametrize("answers_from", [0, 1, 250])
async def test_a_lone_device_that_is_asked_at_address_0_may_answer_from_any(answers_from: int) -> None:
    config = LINE.replace('unit = "247-255"', 'unit = 0, as = 50, profile = "weigher"')
    async with gateway_bench(config) as bench:
        device = SimulatedDevice(answers_from)
        device.answers_unit_0 = True
        line = SimulatedLine("rtu", device)
        line._asked = lambda _: [device]
        bench.attach("hall-a", line)
        assert await bench.client().asks(50, READ) == "03 02 00 00"
