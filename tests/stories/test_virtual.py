"""Virtual units in a whole gateway: one block of registers from devices on two lines, and from an image."""

import asyncio

from gateway.events import WriteAudit
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import GatewayBench, gateway_bench

CONFIG = """
[[line]]
name    = "hall-a"
port    = "/dev/hall-a"
baud    = 9600
broadcast = true
devices = [{ unit = 1, name = "meter-1", points = [
  { name = "power", holding = 4, type = "float32", write = true, max = 1000 }
] }]

[[line]]
name    = "hall-b"
port    = "/dev/hall-b"
devices = [{ unit = 1, as = 2, name = "meter-2" }]

[[image]]
unit = 200
name = "shift"
holding = 10
initial.holding = [{ at = 3, values = [33] }]

[[image]]
unit  = 240
name  = "hall"
stale = "2 s"
when_stale = "hold"
holding = "50-59"
map = [
  { at = 0, device = "meter-1", point = "power", type = "int32", scale = 0.1, every = "500 ms", write = true },
  { at = 2, device = "meter-2", holding = "0-2", every = "500 ms", write = true },
  { at = 5, device = "shift", holding = 3, every = "100 ms", write = true },
  { at = 6, fresh = ["meter-1", "meter-2", "shift"] },
  { at = 7, age = "meter-2" },
]
"""

#: 12.5 in tenths; three registers; one of the image; three bits; the age.
BLOCK = "03 10 00 00 00 7D 00 C8 00 C9 00 CA 00 21 00 07 00 00"


def furnish(bench: GatewayBench) -> list[SimulatedDevice]:
    """Unit 1 on both lines: the first holds 12.5 as a float from 4 on, the second 200, 201, ..."""
    devices = []
    for port in ("hall-a", "hall-b"):
        device = SimulatedDevice(1, delay=0.01)
        devices.append(device)
        bench.attach(port, SimulatedLine("rtu", device))
    devices[0].holding[4:6] = [0x4148, 0]
    devices[1].holding = [200 + address for address in range(20)]
    return devices


async def test_one_read_gets_the_values_of_all_devices_and_costs_them_only_the_polls():
    async with gateway_bench(CONFIG) as bench:
        one, two = furnish(bench)
        await asyncio.sleep(10.0)
        client = bench.client()
        assert await client.asks(240, "03 0000 0008") == BLOCK
        heard = len(one.heard), len(two.heard)
        for _ in range(100):
            assert await client.asks(240, "03 0000 0008") == BLOCK
        assert (len(one.heard), len(two.heard)) == heard


async def test_a_dead_device_is_told_by_its_bit_and_its_age():
    async with gateway_bench(CONFIG) as bench:
        _, two = furnish(bench)
        await asyncio.sleep(10.0)
        two.silent = True
        await asyncio.sleep(5.0)
        assert await bench.client().asks(240, "03 0002 0006") == "03 0C 00 C8 00 C9 00 CA 00 21 00 05 00 05"
        two.silent = False
        await asyncio.sleep(15.0)
        assert await bench.client().asks(240, "03 0006 0002") == "03 04 00 07 00 00"


async def test_writes_go_to_their_devices_and_the_audit_names_both():
    async with gateway_bench(CONFIG) as bench:
        one, two = furnish(bench)
        await asyncio.sleep(10.0)
        client = bench.client()
        assert await client.asks(240, "10 0000 0002 04 0000 00AF") == "10 00 00 00 02"
        assert one.holding[4:6] == [0x418C, 0]
        assert await client.asks(240, "06 0003 0009") == "06 00 03 00 09"
        assert two.holding[:3] == [200, 9, 202]
        assert await client.asks(240, "16 0004 FFF0 0003") == "16 00 04 FF F0 00 03"
        assert two.holding[2] == 0xC3
        assert await client.asks(240, "06 0005 0022") == "06 00 05 00 22"
        assert await client.asks(200, "03 0003 0001") == "03 02 00 22"
        assert await client.asks(240, "06 0032 0001") == "06 00 32 00 01"
        assert await client.asks(240, "10 0000 0002 04 0000 2711") == "90 03"
        assert await client.asks(240, "03 0000 0008") == "03 10 00 00 00 AF 00 C8 00 09 00 C3 00 22 00 07 00 00"
        audit = [
            (each.unit, each.device, each.function, each.address, each.result)
            for each in bench.events
            if isinstance(each, WriteAudit)
        ]
        assert audit == [
            (240, "meter-1", 16, 0, "ok"),
            (240, "meter-2", 6, 3, "ok"),
            (240, "meter-2", 22, 4, "ok"),
            (240, "shift", 6, 5, "ok"),
            (240, "", 6, 50, "ok"),
            (240, "meter-1", 16, 0, "refused"),
        ]


async def test_a_broadcast_changes_own_registers_only():
    listen = '[[listen]]\nbind = "tcp://127.0.0.1:5021"\nunit0 = "broadcast"\n'
    async with gateway_bench(listen + CONFIG.replace("broadcast = true\n", "")) as bench:
        _, two = furnish(bench)
        await asyncio.sleep(10.0)
        client = bench.client()
        client.ask(0, "06 0002 0007")
        client.ask(0, "06 0032 0008")
        assert await client.asks(240, "03 0032 0001") == "03 02 00 08"
        assert await client.asks(240, "03 0002 0001") == "03 02 00 C8"
        assert two.holding[2] == 202


async def test_a_reload_of_another_row_keeps_values_and_own_registers():
    async with gateway_bench(CONFIG) as bench:
        _, two = furnish(bench)
        await asyncio.sleep(10.0)
        client = bench.client()
        assert await client.asks(240, "06 0032 0001") == "06 00 32 00 01"
        two.silent = True
        await asyncio.sleep(3.0)
        (before,) = bench.gateway.virtual
        await bench.reload(CONFIG.replace('holding = "0-2"', 'holding = "0-2" '))
        assert bench.gateway.virtual == (before,)
        await bench.reload(CONFIG.replace("scale = 0.1", "scale = 1"))
        assert bench.gateway.virtual != (before,)
        client = bench.client()
        assert await client.asks(240, "03 0032 0001") == "03 02 00 01"
        assert await client.asks(240, "03 0000 0005") == "03 0A 00 00 00 0D 00 C8 00 C9 00 CA"
        assert await client.asks(240, "03 0006 0002") == "03 04 00 05 00 03"


async def test_a_unit_that_goes_is_polled_no_more():
    async with gateway_bench(CONFIG) as bench:
        one, _ = furnish(bench)
        await asyncio.sleep(10.0)
        await bench.reload(CONFIG[: CONFIG.rindex("[[image]]")])
        heard = len(one.heard)
        await asyncio.sleep(5.0)
        assert len(one.heard) == heard
        assert await bench.client().asks(240, "03 0000 0001") == "83 0A"


async def test_own_registers_survive_a_restart_if_they_persist(tmp_path):
    config = CONFIG.replace('holding = "50-59"', 'holding = "50-59"\npersist = "always"')
    async with gateway_bench(config, state=tmp_path) as bench:
        furnish(bench)
        assert await bench.client().asks(240, "10 0032 0002 04 0001 0002") == "10 00 32 00 02"
    async with gateway_bench(config, state=tmp_path) as bench:
        furnish(bench)
        await asyncio.sleep(10.0)
        client = bench.client()
        assert await client.asks(240, "03 0032 0003") == "03 06 00 01 00 02 00 00"
        client.ask(240, "06 0033 0009")
        client.ask(240, "03 0033 0001")
        assert [await client.answer(), await client.answer()] == ["06 00 33 00 09", "03 02 00 09"]


async def test_a_write_under_way_during_a_reload_is_there_when_it_is_acknowledged():
    async with gateway_bench(CONFIG) as bench:
        _, two = furnish(bench)
        await asyncio.sleep(10.0)
        client, other = bench.client(), bench.client("10.0.0.7:1")
        two.delay = 0.2
        client.ask(240, "06 0003 0009")
        await asyncio.sleep(0.1)
        await bench.reload(CONFIG.replace("scale = 0.1", "scale = 1"))
        assert await client.answer() == "06 00 03 00 09"
        assert await other.asks(240, "03 0003 0001") == "03 02 00 09"
