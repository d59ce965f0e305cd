"""A weighing transducer through the whole gateway: it moves, it changes its rate, it is asked at address 0."""

import asyncio

from gateway.events import AddressMoved, BaudChanged, RequestRefused
from gateway.service.state import Memory
from kit.gateway_bench import GatewayBench, gateway_bench

ALONE = """
[[line]]
name    = "hall-a"
port    = "/dev/hall-a"
baud    = 9600
devices = [{ unit = 1, as = 41, name = "silo-1", profile = "weigher" }]
"""
TWO = ALONE.replace('"weigher" }', '"weigher" }, { unit = 2, as = 42, name = "silo-2", profile = "weigher" }')
LONE = """
[[line]]
name    = "hall-a"
port    = "/dev/hall-a"
baud    = 9600
devices = [{ unit = 0, as = 50, profile = "weigher" }]
"""


MOVE_TO_5 = ("01 10 01 00 00 01 02 00 05 76 93", "05 10 01 00 00 01 01 B1")
MOVE_TO_1 = ("05 10 01 00 00 01 02 00 01 45 90", "01 10 01 00 00 01 00 35")
TO_19200 = ("01 10 02 00 00 02 04 46 96 00 00 1F AB", "01 10 02 00 00 02 40 70")


async def exchange(bench: GatewayBench, unit: int, request: str, response: str) -> str:
    """Ask `unit`; the request must be on the line as it is printed, and gets the printed response."""
    client, line = bench.client(), bench.lines["hall-a"]
    client.ask(unit, request[3:-6])
    await asyncio.sleep(0.2)
    assert line.take_written().hex(" ").upper() == request
    line.deliver(bytes.fromhex(response))
    return await client.answer()


async def test_it_moves_there_and_back_with_the_printed_frames() -> None:
    async with gateway_bench(ALONE) as bench:
        assert await exchange(bench, 41, *MOVE_TO_5) == "10 01 00 00 01"
        assert await exchange(bench, 41, *MOVE_TO_1) == "10 01 00 00 01"
        moved = [event for event in bench.events if isinstance(event, AddressMoved)]
        assert [(event.was, event.unit, event.advice) for event in moved] == [
            (1, 5, "requests follow it; set unit = 5 in gateway.toml:6"),
            (5, 1, "requests follow it; as the config says"),
        ]


async def test_after_a_restart_it_is_asked_where_it_moved_to() -> None:
    memory = Memory()
    async with gateway_bench(ALONE, memory) as bench:
        await exchange(bench, 41, *MOVE_TO_5)
    async with gateway_bench(ALONE, memory) as bench:
        bench.client().ask(41, "03 0000 0002")
        await asyncio.sleep(0.1)
        assert bench.lines["hall-a"].take_written()[0] == 5


async def test_after_an_edit_of_the_config_it_is_asked_where_the_config_says() -> None:
    memory = Memory()
    async with gateway_bench(ALONE, memory) as bench:
        await exchange(bench, 41, *MOVE_TO_5)
    async with gateway_bench(ALONE.replace("unit = 1,", "unit = 7,"), memory) as bench:
        bench.client().ask(41, "03 0000 0002")
        await asyncio.sleep(0.1)
        assert bench.lines["hall-a"].take_written()[0] == 7


async def test_it_cannot_move_to_where_its_neighbour_is() -> None:
    async with gateway_bench(TWO) as bench:
        assert await bench.client().asks(41, "10 0100 0001 02 0002") == "90 03"
        assert bench.lines["hall-a"].written == b""
        (told,) = [event for event in bench.events if isinstance(event, RequestRefused)]
        assert told.why == "another device of the line has the address 2"


async def test_the_line_follows_it_to_another_rate_and_is_opened_at_that_rate_from_then_on() -> None:
    memory = Memory()
    async with gateway_bench(ALONE, memory) as bench:
        assert await exchange(bench, 41, *TO_19200) == "10 02 00 00 02"
        assert bench.lines["hall-a"].baud == 19200
        assert bench.gateway.lines[0].driver.line.settings.timing.baud == 19200
        assert any(isinstance(event, BaudChanged) for event in bench.events)
    async with gateway_bench(ALONE, memory) as bench:
        assert bench.opened["hall-a"].baud == 19200
        assert bench.gateway.lines[0].driver.line.settings.timing.baud == 19200


async def test_a_line_with_neighbours_stays_at_its_rate() -> None:
    async with gateway_bench(TWO) as bench:
        assert await exchange(bench, 41, *TO_19200) == "10 02 00 00 02"
        assert bench.lines["hall-a"].baud == 0
        (told,) = [event for event in bench.events if isinstance(event, BaudChanged)]
        assert told.advice.startswith("the line stays at its rate")


async def test_at_address_0_it_answers_from_where_it_is() -> None:
    async with gateway_bench(LONE) as bench:
        request, response = "00 03 00 10 00 01 84 1E", "01 03 02 00 01 79 84"
        assert await exchange(bench, 50, request, response) == "03 02 00 01"


async def test_address_0_can_only_be_read() -> None:
    async with gateway_bench(LONE) as bench:
        assert await bench.client().asks(50, "10 0100 0001 02 0005") == "90 01"
        assert bench.lines["hall-a"].written == b""
