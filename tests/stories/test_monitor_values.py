"""Values of a bus on which others ask: what is heard there is in mirrors and maps, and nothing is ever sent."""

import asyncio
from contextlib import asynccontextmanager

from kit.asking import answers
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import GatewayBench, gateway_bench
from kit.others import Others

CONFIG = """
[[line]]
name    = "hall-a"
port    = "/dev/hall-a"
devices = [{ unit = 1, name = "silo" }]

[[line]]
name    = "old-plc"
port    = "/dev/plc"
role    = "monitor"
devices = [
  { unit = 3, as = 63, name = "boiler", points = [
    { name = "state", holding = 0, labels = { 1 = "heating" } },
    { name = "temperature", holding = 4, type = "float32", unit = "C" },
  ] },
  { unit = 4, as = 64, name = "pump" },
]

[[image]]
unit  = 241
name  = "boiler-mirror"
of    = "boiler"
read  = [{ holding = "0-9" }]
stale = "3 s"

[[image]]
unit  = 240
name  = "hall"
stale = "3 s"
when_stale = "hold"
map = [
  { at = 0, device = "boiler", point = "temperature", type = "int16", scale = 0.1 },
  { at = 1, device = "pump", holding = "2-3", write = true },
  { at = 3, device = "silo", holding = 0, every = "500 ms" },
  { at = 4, fresh = ["boiler", "pump", "silo"] },
  { at = 5, age = "pump" },
]
"""


@asynccontextmanager
async def stage(config: str = CONFIG):
    """The gateway, its own device, and the others with theirs: unit 3 has 12.5 at 4, unit 4 has 100, 101, ..."""
    async with gateway_bench(config) as bench:
        boiler, pump, silo = (SimulatedDevice(unit, delay=0.01) for unit in (3, 4, 1))
        boiler.holding[:6] = [1, 2, 3, 4, 0x4148, 0]
        pump.holding[:10] = range(100, 110)
        silo.holding[0] = 33
        bench.attach("hall-a", SimulatedLine("rtu", silo))
        await asyncio.sleep(5.0)
        yield bench, Others(bench.lines["plc"], boiler, pump), boiler
        assert bench.lines["plc"].written == b""


async def known(bench: GatewayBench) -> dict[str, tuple[object, str, str | None]]:
    (answer,) = await answers(bench.running, {"verb": "values", "unit": "boiler"})
    return {each.point: (each.text, each.state, each.source) for each in answer["values"]}


async def test_a_client_reads_what_others_have_read():
    async with stage() as (bench, others, _):
        client = bench.client()
        assert await client.asks(241, "03 0000 0001") == "83 0B"
        await others.ask(3, "03 0000 0006")
        assert await client.asks(241, "03 0000 0006") == "03 0C 00 01 00 02 00 03 00 04 41 48 00 00"
        assert await client.asks(241, "03 0005 0002") == "83 0B"
        assert await client.asks(241, "03 0009 0002") == "83 02"


async def test_values_are_as_old_as_the_requests_of_others():
    async with stage() as (bench, others, boiler):
        client = bench.client()
        await others.ask(3, "03 0000 000A")
        await asyncio.sleep(2.5)
        assert await client.asks(241, "03 0000 0001") == "03 02 00 01"
        boiler.holding[0] = 7
        await asyncio.sleep(0.5)
        assert await client.asks(241, "03 0000 0001") == "83 0B"
        await others.ask(3, "03 0000 000A")
        assert await client.asks(241, "03 0000 0001") == "03 02 00 07"


async def test_what_others_write_is_unknown_until_they_read_it():
    async with stage() as (bench, others, _):
        client = bench.client()
        await others.ask(3, "03 0000 000A")
        await others.ask(3, "06 0001 0063")
        assert await client.asks(241, "03 0000 0001") == "03 02 00 01"
        assert await client.asks(241, "03 0001 0001") == "83 0B"
        await others.ask(3, "03 0001 0001")
        assert await client.asks(241, "03 0000 0002") == "03 04 00 01 00 63"


async def test_a_broadcast_of_others_is_a_write_to_all_units():
    async with stage() as (bench, others, _):
        client = bench.client()
        await others.ask(3, "03 0000 000A")
        await others.ask(4, "03 0000 000A")
        await others.ask(0, "06 0002 0063")
        assert await client.asks(241, "03 0001 0001") == "03 02 00 02"
        assert await client.asks(241, "03 0002 0001") == "83 0B"
        assert (await client.asks(240, "03 0004 0001"))[-2:] == "05"


async def test_nobody_can_ask_there():
    async with stage() as (bench, others, _):
        client = bench.client()
        await others.ask(3, "03 0000 000A")
        await others.ask(4, "03 0000 000A")
        assert await client.asks(63, "03 0000 0001") == "83 0A"
        assert await client.asks(64, "06 0000 0001") == "86 0A"
        assert await client.asks(241, "06 0000 0001") == "86 0A"
        assert await client.asks(241, "2B 0E 01 00") == "AB 0A"
        assert await client.asks(240, "06 0001 0001") == "86 0A"
        assert await client.asks(241, "03 0000 0001") == "03 02 00 01"
        assert await client.asks(240, "03 0001 0001") == "03 02 00 66"


async def test_a_map_has_what_is_heard_beside_what_is_polled():
    async with stage() as (bench, others, _):
        client = bench.client()
        assert await client.asks(240, "03 0003 0003") == "03 06 00 21 00 04 FF FF"
        await others.ask(3, "03 0004 0002")
        await others.ask(4, "03 0000 000A")
        assert await client.asks(240, "03 0000 0006") == "03 0C 00 7D 00 66 00 67 00 21 00 07 00 00"
        await asyncio.sleep(5.0)
        assert await client.asks(240, "03 0000 0006") == "03 0C 00 7D 00 66 00 67 00 21 00 04 00 05"


async def test_operators_see_points_out_of_what_was_heard():
    async with stage() as (bench, others, _):
        assert {state for _, state, _ in (await known(bench)).values()} == {"never"}
        await others.ask(3, "03 0000 0006")
        assert await known(bench) == {
            "state": ("heating", "fresh", "heard"),
            "temperature": ("12.5", "fresh", "heard"),
        }
        await others.ask(3, "06 0000 0002")
        assert (await known(bench))["state"] == ("heating", "stale", "heard")
        await asyncio.sleep(60.0)
        assert (await known(bench))["temperature"][1] == "stale"


async def test_a_reload_keeps_what_was_heard_where_nothing_changes():
    async with stage() as (bench, others, _):
        client = bench.client()
        await others.ask(3, "03 0000 000A")
        await others.ask(4, "03 0000 000A")
        await bench.reload(CONFIG.replace('stale = "3 s"\nwhen', 'stale = "4 s"\nwhen') + "\n[trace]\nring = '1 MiB'\n")
        assert await client.asks(241, "03 0000 0001") == "03 02 00 01"
        assert await client.asks(240, "03 0000 0003") == "03 06 00 7D 00 66 00 67"
        await others.ask(4, "03 0002 0002")
        assert await client.asks(240, "03 0004 0001") == "03 02 00 07"


async def test_a_line_that_a_reload_makes_anew_has_heard_nothing():
    async with stage() as (bench, others, _):
        client = bench.client()
        await others.ask(3, "03 0000 000A")
        await bench.reload(CONFIG.replace('port    = "/dev/plc"', 'port    = "/dev/plc"\nbaud = 9600'))
        await asyncio.sleep(6.0)  # before, an answer could be to a request from before the port was opened
        assert await client.asks(241, "03 0000 0001") == "83 0B"
        await others.ask(3, "03 0000 000A")
        assert await client.asks(241, "03 0000 0001") == "03 02 00 01"
        assert {state for _, state, _ in (await known(bench)).values()} == {"fresh"}


async def test_a_unit_with_two_names_is_heard_for_both():
    twin = (
        '{ unit = 4, as = 65, name = "twin" },\n]\n\n[[image]]\nunit = 242\nof = "twin"\nread = [{ holding = "0-1" }]\n'
    )
    async with stage(CONFIG.replace("]\n\n[[image]]", f"{twin}\n[[image]]", 1)) as (bench, others, _):
        await others.ask(4, "03 0000 0004")
        assert await bench.client().asks(242, "03 0000 0002") == "03 04 00 64 00 65"
        assert (await bench.client().asks(240, "03 0001 0002")) == "03 04 00 66 00 67"
