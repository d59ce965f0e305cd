"""The gateway as a device: a line that is down shows in its registers. In virtual time."""

import asyncio
from types import SimpleNamespace

import pytest

from gateway.images.self_map import FRESHNESS
from gateway.runtime.self_state import show_itself
from kit.asking import ask, pictured
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import GatewayBench, gateway_bench

CONFIG = """
[self]
unit = 246

[[line]]
name = "hall-a"
port = "/dev/hall-a"
devices = [{ unit = 1, as = 41 }, { unit = 2, as = 47, timeout = "200 ms" }]

[[line]]
name = "hall-b"
port = "/dev/hall-b"
devices = [{ unit = 3 }]

[[line]]
name   = "panel"
port   = "/dev/panel"
role   = "server"
serves = [41, 246]

[[upstream]]
name = "plant"
to = "tcp://10.1.0.5"
units = [{ as = 37, unit = 1 }]
"""
READ = "03 00 00 00 01"
UP, DOWN = 1, 2


def show(bench: GatewayBench) -> None:
    """As a gateway that runs does."""
    show_itself(SimpleNamespace(gateway=bench.gateway, recent=bench.recent, started=0.0, reload_succeeded=True))


async def registers(bench: GatewayBench, start: int, count: int, function: int = 3) -> list[int]:
    await asyncio.sleep(2 * FRESHNESS)
    pdu = f"{function:02X} {start:04X} {count:04X}"
    data = bytes.fromhex((await ask(bench.running, "request", unit=246, pdu=pdu))["pdu"])[2:]
    return [int.from_bytes(data[at : at + 2], "big") for at in range(0, len(data), 2)]


async def value(bench: GatewayBench, name: str) -> int:
    """A value by its name."""
    point = next(one for one in pictured(bench.running, 246).points if one.name == name)
    found = await registers(bench, point.address, point.count)
    return int.from_bytes(b"".join(each.to_bytes(2, "big") for each in found), "big")


@pytest.fixture
async def bench():
    async with gateway_bench(CONFIG) as bench:
        bench.attach("hall-a", SimulatedLine("rtu", SimulatedDevice(1)))
        show(bench)
        yield bench


async def test_the_states_of_all_lines_are_side_by_side(bench):
    assert await registers(bench, 100, 4) == [UP, UP, 0, 0]
    bench.lines["hall-b"].pull()
    assert await registers(bench, 100, 4) == [UP, DOWN, 0, 0]
    assert await registers(bench, 100, 4, function=4) == [UP, DOWN, 0, 0]
    assert await registers(bench, 200, 2) == [UP, 0]
    assert [await value(bench, name) for name in ("trouble", "lines", "lines-down", "hall-b.state")] == [
        1,
        2,
        1,
        DOWN,
    ]


async def test_a_line_says_its_name_and_what_happened_to_its_requests(bench):
    client = bench.client()
    for unit in (41, 41, 47):
        await client.asks(unit, READ)
    assert await value(bench, "hall-a.answered") == 2
    assert await value(bench, "hall-a.timeouts") == 1
    assert await value(bench, "hall-a.units-failing") == 1
    name = await registers(bench, 1030, 4)
    assert b"".join(each.to_bytes(2, "big") for each in name) == b"hall-a\0\0"
    assert await value(bench, "answered") == 2
    assert await value(bench, "failed") == 1


async def test_units_that_do_not_answer_have_a_bit(bench):
    assert await registers(bench, 80, 16) == [0] * 16
    await bench.client().asks(47, READ)
    assert await registers(bench, 80, 16) == [0, 0, 1 << 15, *[0] * 13]


async def test_the_units_of_a_line_that_is_down_do_not_answer(bench):
    await bench.client().asks(41, READ)
    assert await registers(bench, 80, 3) == [0, 0, 0]
    bench.lines["hall-a"].pull()
    assert await registers(bench, 80, 3) == [0, 0, 1 << 9]
    assert await value(bench, "hall-a.units-failing") == 1


async def test_the_uptime_counts(bench):
    before = await value(bench, "uptime")
    await asyncio.sleep(100)
    assert await value(bench, "uptime") - before == 100


async def test_places_of_no_line_are_there_and_empty(bench):
    assert await registers(bench, 1100, 50) == [0] * 50
    assert await bench.client().asks(246, "03 01 90 00 01") == "83 02"


@pytest.mark.parametrize("pdu", ["06 00 00 00 01", "10 00 00 00 01 02 00 01", "05 00 00 FF 00", "01 00 00 00 01"])
async def test_nobody_can_write_it(bench, pdu):
    refused = f"{int(pdu[:2], 16) | 0x80:02X} 01"
    assert await bench.client().asks(246, pdu) == refused


async def test_function_08_counts_what_happens_on_the_lines(bench):
    client = bench.client()
    await client.asks(41, READ)
    await client.asks(47, READ)
    await asyncio.sleep(2 * FRESHNESS)
    assert await client.asks(246, "08 00 0B 00 00") == "08 00 0B 00 03"  # two requests, one response
    assert await client.asks(246, "08 00 0F 00 00") == "08 00 0F 00 01"
    assert await client.asks(246, "08 00 0A 00 00") == "08 00 0A 00 00"
    assert await client.asks(246, "08 00 0F 00 00") == "08 00 0F 00 00"
    assert await value(bench, "hall-a.timeouts") == 1


async def test_it_says_who_it_is(bench):
    answer = bytes.fromhex(await bench.client().asks(246, "2B 0E 01 00"))
    assert b"modbus-gateway" in answer
    assert b"gateway" in answer[20:]


async def test_values_are_looked_up_once_in_a_while_however_often_it_is_asked(bench):
    (image,) = bench.gateway.images
    looks, look = [], image.look
    image.look = lambda now: looks.append(now) or look(now)
    client = bench.client()
    for _ in range(50):
        await client.asks(246, READ)
    assert len(looks) == 1


async def test_lines_that_go_leave_an_empty_place(bench):
    (image,) = bench.gateway.images
    assert await value(bench, "hall-b.state") == UP
    shown = image.look(0.0)
    image.look = lambda now: shown._replace(parts={"Lines": shown.parts["Lines"][:1]})
    assert await registers(bench, 100, 2) == [UP, 0]
    assert await registers(bench, 1050, 50) == [0] * 50
    assert await registers(bench, 200, 2) == [0, 0]


async def test_rights_hold_as_for_any_unit():
    async with gateway_bench(CONFIG + '[[access]]\nunits = 41\nallow = ["read"]\n') as bench:
        show(bench)
        assert await bench.client().asks(246, READ) == "83 01"
