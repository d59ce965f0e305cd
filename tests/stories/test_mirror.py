"""Mirrors in a whole gateway: many clients read, the line carries only the polls."""

import asyncio

from gateway.events import UnitResting
from gateway.modbus import mbap
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import GatewayBench, gateway_bench

CONFIG = """
[[line]]
name    = "hall-a"
port    = "/dev/hall-a"
baud    = 9600
devices = [{ unit = 1, name = "silo-1" }]

[[line]]
name    = "hall-b"
port    = "/dev/hall-b"
devices = [{ unit = 1, as = 2, name = "silo-2" }]

[[image]]
unit  = 241
of    = "silo-1"
read  = [{ holding = "0-9", every = "500 ms" }]
stale = "1 s"

[[image]]
unit  = 242
of    = "silo-2"
read  = [{ holding = "0-9", every = "500 ms" }]
stale = "1 s"
"""


def furnish(bench: GatewayBench) -> list[SimulatedDevice]:
    """Unit 1 on both lines; the first holds 100, 101, ..., the second 200, 201, ..."""
    devices = []
    for number, port in enumerate(("hall-a", "hall-b"), start=1):
        device = SimulatedDevice(1, delay=0.01)
        device.holding = [number * 100 + address for address in range(20)]
        devices.append(device)
        bench.attach(port, SimulatedLine("rtu", device))
    return devices


async def test_many_clients_cost_the_line_nothing_but_the_polls():
    async with gateway_bench(CONFIG) as bench:
        silo, _ = furnish(bench)
        await asyncio.sleep(5.0)
        polls = len(silo.heard)

        async def read_for_ten_seconds(number: int) -> None:
            client = bench.client(f"10.0.0.{number}:1")
            for _ in range(1000):
                assert await client.asks(241, "03 0000 0002") == "03 04 00 64 00 65"
                await asyncio.sleep(0.01)

        async with asyncio.TaskGroup() as group:
            for number in range(16):
                group.create_task(read_for_ten_seconds(number))
        assert len(silo.heard) - polls == 20


async def test_the_same_unit_on_two_lines_is_two_mirrors():
    async with gateway_bench(CONFIG) as bench:
        furnish(bench)
        await asyncio.sleep(5.0)
        client = bench.client()
        assert await client.asks(241, "03 0001 0001") == "03 02 00 65"
        assert await client.asks(242, "03 0001 0001") == "03 02 00 C9"


async def test_a_device_that_falls_silent_turns_into_0b_not_into_old_values():
    async with gateway_bench(CONFIG) as bench:
        silo, _ = furnish(bench)
        await asyncio.sleep(5.0)
        client = bench.client()
        silo.silent = True
        fallen_silent = client.now()
        while await client.asks(241, "03 0000 0001") == "03 02 00 64":
            assert client.now() < fallen_silent + 1.5 + 0.1  # stale, and the time since the last poll
            await asyncio.sleep(0.01)
        for _ in range(100):
            assert await client.asks(241, "03 0000 0001") == "83 0B"
            await asyncio.sleep(0.15)
        assert UnitResting in map(type, bench.events)
        silo.silent = False
        silo.holding[0] = 7
        await asyncio.sleep(70.0)
        assert await client.asks(241, "03 0000 0001") == "03 02 00 07"


async def test_a_write_goes_through_and_is_read_back_by_everybody():
    async with gateway_bench(CONFIG) as bench:
        silo, _ = furnish(bench)
        await asyncio.sleep(5.0)
        writer, reader = bench.client(), bench.client("10.0.0.8:1")
        writer.ask(241, "06 0003 BEEF")
        writer.ask(241, "03 0003 0001")
        assert [await writer.answer(), await writer.answer()] == ["06 00 03 BE EF", "03 02 BE EF"]
        assert await reader.asks(241, "03 0003 0001") == "03 02 BE EF"
        assert silo.holding[3] == 0xBEEF


async def test_a_client_reads_back_what_it_wrote_though_writes_overtake_polls():
    """Behind another server requests go side by side, and this one takes longer to read than to write."""
    config = """
    [[upstream]]
    name  = "plant-1"
    to    = "tcp://10.1.0.5:502"
    units = [{ as = 37, unit = 37 }]

    [[image]]
    unit  = 241
    of    = "plant-1/37"
    read  = [{ holding = "0-0", every = "500 ms" }]
    stale = "60 s"
    """
    async with gateway_bench(config) as bench:
        loop, framer, register = asyncio.get_running_loop(), mbap.MbapFramer(), bytes(2)
        server = bench.lines["tcp://10.1.0.5:502"]

        def answer(data: bytes) -> None:
            nonlocal register
            for adu in framer.cut(data):
                if adu.pdu[0] == 6:
                    register = adu.pdu[3:]
                response, delay = (adu.pdu, 0.01) if adu.pdu[0] == 6 else (b"\3\2" + register, 0.3)
                loop.call_later(delay, server.deliver, mbap.encode(adu.transaction, adu.unit, response))

        server.on_write = answer
        await asyncio.sleep(5.0)
        client = bench.client()
        for value in range(1, 60):
            await client.asks(241, f"06 0000 {value:04X}")
            assert await client.asks(241, "03 0000 0001") == f"03 02 00 {value:02X}"
            await asyncio.sleep(0.13)


async def test_one_clients_requests_keep_their_order():
    async with gateway_bench(CONFIG) as bench:
        furnish(bench)
        await asyncio.sleep(5.0)
        client, other = bench.client(), bench.client("10.0.0.8:1")
        await other.asks(241, "06 0001 0009")
        for pdu in ("03 0003 0001", "06 0003 0007", "03 0003 0001"):
            client.ask(241, pdu)
        assert [await client.answer() for _ in range(3)] == ["03 02 00 67", "06 00 03 00 07", "03 02 00 07"]


async def test_a_mirror_whose_line_is_down_gives_out_nothing_old():
    async with gateway_bench(CONFIG) as bench:
        furnish(bench)
        await asyncio.sleep(5.0)
        client = bench.client()
        bench.lines["hall-a"].pull()
        await asyncio.sleep(2.0)
        assert await client.asks(241, "03 0000 0001") == "83 0B"
        assert await client.asks(241, "06 0000 0001") == "86 0A"


async def test_a_pass_through_unit_can_be_mirrored_under_its_own_number():
    config = """
    [[line]]
    name = "a"
    port = "/dev/hall-a"

    [[image]]
    unit = 1
    of   = "a/1"
    read = [{ holding = "0-9", every = "500 ms" }]
    """
    async with gateway_bench(config) as bench:
        device = SimulatedDevice(1, delay=0.01)
        bench.attach("hall-a", SimulatedLine("rtu", device, SimulatedDevice(2)))
        device.holding = list(range(20))
        await asyncio.sleep(5.0)
        client = bench.client()
        assert await client.asks(1, "03 0005 0001") == "03 02 00 05"
        assert await client.asks(1, "03 000A 0001") == "83 02"
        assert await client.asks(2, "03 000A 0001") == "03 02 00 00"
