"""The main job in one gateway_bench: three lines of both kinds and an image, asked by many clients at once."""

import asyncio

import pytest

from gateway.events import LineLost, LineReopened
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import GatewayBench, gateway_bench

CONFIG = """
[[line]]
name    = "hall-a"
port    = "/dev/hall-a"
baud    = 9600
devices = [
  { unit = 1, as = 41, profile = "weigher" },
  { unit = 6, as = 46, profile = "v80" },
  { unit = "10-12", as = "110-112", name = "drive-*" },
]

[[line]]
name    = "hall-b"
port    = "/dev/hall-b"
baud    = 19200
devices = [{ unit = "1-3" }]

[[line]]
name    = "press"
port    = "/dev/press"
mode    = "ascii"
baud    = 19200
devices = [{ unit = 2, as = 52, profile = "mint" }]

[[image]]
unit    = 200
name    = "shift-data"
holding = 100
initial.holding = [{ at = 0, values = [7, 8, 9] }]
"""

#: Client's unit, port, unit on the wire.
UNITS = [
    (41, "hall-a", 1), (46, "hall-a", 6), (110, "hall-a", 10), (111, "hall-a", 11), (112, "hall-a", 12),
    (1, "hall-b", 1), (2, "hall-b", 2), (3, "hall-b", 3), (52, "press", 2),
]  # fmt: skip


def furnish(bench: GatewayBench) -> dict[int, SimulatedDevice]:
    """A device behind every unit; the value of a register says whose and which it is."""
    devices = {}
    for known_as, _, unit in UNITS:
        device = SimulatedDevice(unit, delay=0.01)
        device.holding = [known_as * 256 + address for address in range(200)]
        devices[known_as] = device
    for port, mode in (("hall-a", "rtu"), ("hall-b", "rtu"), ("press", "ascii")):
        bench.attach(port, SimulatedLine(mode, *(devices[known_as] for known_as, at, _ in UNITS if at == port)))
    return devices


async def test_every_client_gets_the_values_of_the_unit_it_asked() -> None:
    async with gateway_bench(CONFIG) as bench:
        furnish(bench)

        async def poll(number: int) -> None:
            client = bench.client(f"10.0.0.{number}:1")
            for turn in range(20):
                known_as, _, _ = UNITS[(number + turn) % len(UNITS)]
                address = 1 + (7 * number + turn) % 90
                answer = await client.asks(known_as, f"03 {address:04X} 0001")
                assert answer == f"03 02 {known_as:02X} {address:02X}"

        await asyncio.gather(*(poll(number) for number in range(12)))


async def test_one_client_with_requests_to_all_lines_under_way_gets_one_answer_for_each() -> None:
    async with gateway_bench(CONFIG) as bench:
        furnish(bench)
        client = bench.client()
        asked = {client.ask(known_as, "03 0005 0001"): known_as for known_as, _, _ in UNITS}
        asked[client.ask(200, "03 0001 0001")] = 200
        answered = {}
        for _ in asked:
            transaction, unit, pdu = await client.responses.get()
            answered[transaction] = unit
            assert pdu == ("03 02 00 08" if unit == 200 else f"03 02 {unit:02X} 05")
        assert answered == asked


async def test_writes_arrive_and_are_read_back() -> None:
    async with gateway_bench(CONFIG) as bench:
        devices = furnish(bench)
        client = bench.client()
        for unit in (41, 52, 200):
            assert await client.asks(unit, "10 0010 0002 04 1234 5678") == "10 00 10 00 02"
            assert await client.asks(unit, "03 0010 0002") == "03 04 12 34 56 78"
        assert devices[41].holding[16:18] == [0x1234, 0x5678]


async def test_a_reader_from_elsewhere_reads_and_cannot_write() -> None:
    async with gateway_bench(CONFIG) as bench:
        devices = furnish(bench)
        reader = bench.client(host="10.0.0.9")
        assert await reader.asks(46, "03 0001 0001") == "03 02 2E 01"
        assert await reader.asks(46, "06 0001 0001") == "86 01"
        assert [frame.pdu[0] for frame in devices[46].heard] == [3]


async def test_a_line_without_its_adapter_does_not_hurt_the_others() -> None:
    async with gateway_bench(CONFIG) as bench:
        furnish(bench)
        bench.lines["hall-b"].pull()
        client = bench.client()
        assert await client.asks(1, "03 0005 0001") == "83 0A"
        assert await client.asks(46, "03 0005 0001") == "03 02 2E 05"


async def test_pulling_the_adapter_answers_everybody_and_its_return_is_noticed_within_two_seconds() -> None:
    async with gateway_bench(CONFIG) as bench:
        devices = furnish(bench)
        devices[1].silent = True
        client = bench.client()
        client.ask(1, "03 0005 0001")
        client.ask(2, "03 0005 0001")
        await asyncio.sleep(0.05)
        bench.lines["hall-b"].pull()
        assert [await client.answer(), await client.answer()] == ["83 0B", "83 0A"]
        await asyncio.sleep(60)
        bench.lines["hall-b"].plug()
        await asyncio.sleep(2)
        assert await client.asks(2, "03 0005 0001") == "03 02 02 05"
        assert [type(event) for event in bench.events][-2:] == [LineLost, LineReopened]


@pytest.mark.parametrize(
    ("unit", "pdu", "answer"),
    [
        (99, "03 0000 0001", "83 0A"),
        (255, "2B 0E 01 00", "AB 0A"),
        (0, "03 0000 0001", "83 0A"),
        (46, "01 0000 0401", "81 03"),
        (41, "04 0000 0001", "84 01"),
        (52, "03 0000 0001", "83 02"),
        (200, "03 0063 0002", "83 02"),
    ],
)
async def test_what_cannot_be_is_refused_without_a_byte_on_any_line(unit: int, pdu: str, answer: str) -> None:
    async with gateway_bench(CONFIG) as bench:
        assert await bench.client().asks(unit, pdu) == answer
        assert not any(line.written for line in bench.lines.values())
