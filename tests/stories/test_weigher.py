"""A weighing transducer through the whole gateway: it moves, it changes its rate, it is asked at address 0."""

import asyncio

import pytest

from gateway.events import AddressMoved, AddressRemembered, BaudChanged, RequestRefused
from gateway.state.memory import Memory
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import GatewayBench, gateway_bench

ALONE = """
[[line]]
name    = "hall-a"
port    = "/dev/hall-a"
baud    = 9600
devices = [{ unit = 1, as = 41, name = "silo-1", profile = "weigher" }]
"""
TWO = ALONE.replace('"weigher" }', '"weigher" }, { unit = 2, as = 42, name = "silo-2", profile = "weigher" }')
#: The same, but a reload replaces the line.
TWO_IN_ANOTHER_LINE = TWO.replace("9600", "9600\nqueue   = 50")
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


READ_WEIGHT = "03 0000 0002"
WEIGHT_OF_1 = "01 03 04 45 9C 3D 51 3F D5"


async def reload(bench: GatewayBench, config: str) -> None:
    """Replace what differs in this config."""
    await bench.reload(config)


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


async def test_a_late_answer_to_what_was_asked_before_does_not_free_the_address_of_an_unanswered_move() -> None:
    """It works in order: a read takes it 260 ms, and a move 600 ms more; the limit is 100 ms."""
    config = TWO.replace('profile = "weigher"', 'profile = "weigher", timeout = "100 ms"')
    async with gateway_bench(config) as bench:
        client, line, loop = bench.client(), bench.lines["hall-a"], asyncio.get_running_loop()
        loop.call_later(0.260, line.deliver, bytes.fromhex(WEIGHT_OF_1))
        assert await client.asks(41, READ_WEIGHT) == "83 0B"
        assert await client.asks(41, MOVE_TO_5[0][3:-6]) == "90 0B"
        assert loop.time() > 1.260
        assert await client.asks(42, MOVE_TO_5[0][3:-6]) == "90 03"
        (told,) = [event for event in bench.events if isinstance(event, RequestRefused)]
        assert told.why == "another device of the line has, or may have, the address 5"


async def test_it_is_never_asked_where_the_config_says_when_it_is_silent_where_it_moved_to() -> None:
    """A spare may be there."""
    memory = Memory()
    memory.remember("/dev/hall-a silo-1", 1, 5)
    async with gateway_bench(ALONE, memory) as bench:
        client = bench.client()
        for _ in range(20):
            await client.asks(41, READ_WEIGHT)
            await asyncio.sleep(20.0)
        written = bytes(bench.lines["hall-a"].take_written())
        assert {written[at] for at in range(0, len(written), 8)} == {5}
        assert "modbus-gateway forget silo-1" in next(
            event.advice for event in bench.events if isinstance(event, AddressRemembered)
        )


async def test_an_unanswered_move_is_known_after_a_restart() -> None:
    memory = Memory()
    async with gateway_bench(TWO, memory) as bench:
        assert await bench.client().asks(41, MOVE_TO_5[0][3:-6]) == "90 0B"
    async with gateway_bench(TWO, memory) as bench:
        assert await bench.client().asks(42, MOVE_TO_5[0][3:-6]) == "90 03"


async def test_an_unanswered_move_is_known_after_a_reload_and_the_old_address_waits_for_it() -> None:
    """A read of the old address would be answered, and show nothing, while the move may still happen."""
    async with gateway_bench(TWO) as bench:
        assert await bench.client().asks(41, MOVE_TO_5[0][3:-6]) == "90 0B"
        await reload(bench, TWO_IN_ANOTHER_LINE)
        bench.lines["hall-a"].take_written()
        assert await bench.client().asks(41, READ_WEIGHT) == "83 0B"
        assert bench.lines["hall-a"].take_written() == b""
        await asyncio.sleep(5.0)
        assert await bench.client().asks(42, MOVE_TO_5[0][3:-6]) == "90 03"


async def test_a_move_that_is_answered_during_a_reload_is_known_to_the_next_line() -> None:
    async with gateway_bench(TWO) as bench:
        moving = bench.client()
        moving.ask(41, MOVE_TO_5[0][3:-6])
        await asyncio.sleep(0.1)
        reloading = asyncio.create_task(reload(bench, TWO_IN_ANOTHER_LINE))
        await asyncio.sleep(0.1)
        bench.lines["hall-a"].deliver(bytes.fromhex(MOVE_TO_5[1]))
        await reloading
        assert await moving.answer() == "10 01 00 00 01"
        assert bench.gateway.lines[0].devices[41].unit == 5


async def test_scales_that_changed_places_and_get_new_names_by_a_reload_are_asked_once_one_is_forgotten() -> None:
    memory = Memory()
    memory.remember("/dev/hall-a silo-1", 1, 2)
    memory.remember("/dev/hall-a silo-2", 2, 1)
    async with gateway_bench(TWO, memory) as bench:
        await reload(bench, TWO.replace("silo-1", "north").replace("silo-2", "south"))
        line, client = bench.gateway.lines[0], bench.client()
        assert await client.asks(41, "03 00 00 00 01") == "83 0A"
        line.forget(line.devices[41])
        client.ask(41, "03 00 00 00 01")
        await asyncio.sleep(0.1)
        assert bench.lines["hall-a"].written[:1] == b"\x01"


@pytest.mark.parametrize("is_answered", [True, False])
async def test_an_edit_of_the_unit_during_a_move_counts_whatever_becomes_of_the_move(is_answered: bool) -> None:
    """A late response to it is not believed either."""
    memory, edited = Memory(), TWO.replace("unit = 1,", "unit = 7,")
    async with gateway_bench(TWO, memory) as bench:
        client = bench.client()
        client.ask(41, MOVE_TO_5[0][3:-6])
        await asyncio.sleep(0.1)
        reloading = asyncio.create_task(reload(bench, edited))
        await asyncio.sleep(0.1)
        if is_answered:
            bench.lines["hall-a"].deliver(bytes.fromhex(MOVE_TO_5[1]))
        await reloading
        assert await client.answer() == ("10 01 00 00 01" if is_answered else "90 0B")
        line, device = bench.lines["hall-a"], bench.gateway.lines[0].devices[41]
        line.take_written()
        client.ask(41, READ_WEIGHT)
        await asyncio.sleep(0.1)
        assert line.take_written()[0] == 7
        line.deliver(bytes.fromhex(MOVE_TO_5[1]))
        assert await client.answer() == "83 0B"
        assert device.possible_units == (7,)
    async with gateway_bench(edited, memory) as bench:
        assert bench.gateway.lines[0].devices[41].possible_units == (7,)


async def test_a_rate_that_changes_during_a_reload_is_known_to_the_next_line() -> None:
    async with gateway_bench(ALONE) as bench:
        changing = bench.client()
        changing.ask(41, TO_19200[0][3:-6])
        await asyncio.sleep(0.1)
        reloading = asyncio.create_task(reload(bench, ALONE.replace("9600", "9600\nqueue = 50")))
        await asyncio.sleep(0.1)
        bench.lines["hall-a"].deliver(bytes.fromhex(TO_19200[1]))
        await reloading
        assert bench.opened["hall-a"].baud == 19200
        assert bench.gateway.lines[0].driver.line.settings.timing.baud == 19200


async def test_after_an_edit_and_back_it_is_asked_where_the_config_says() -> None:
    memory = Memory()
    memory.remember("/dev/hall-a silo-1", 1, 5)
    for config, unit in ((ALONE, 5), (ALONE.replace("unit = 1,", "unit = 7,"), 7), (ALONE, 1)):
        async with gateway_bench(config, memory) as bench:
            assert bench.gateway.lines[0].devices[41].unit == unit


async def test_no_client_broadcasts_an_address_on_its_line_but_other_lines_and_broadcasts_go_on() -> None:
    listen = '[[listen]]\nbind = "tcp://127.0.0.1:0"\nunit0 = "broadcast"\n'
    other = '[[line]]\nname = "hall-b"\nport = "/dev/hall-b"\ndevices = [{ unit = 9, profile = "generic" }]\n'
    async with gateway_bench(listen + ALONE + other) as bench:
        bench.client().ask(0, "10 0100 0001 02 0005")
        await asyncio.sleep(0.5)
        assert bench.lines["hall-a"].take_written() == b""
        assert bench.lines["hall-b"].take_written()[:-2].hex(" ").upper() == "00 10 01 00 00 01 02 00 05"
        (told,) = [event for event in bench.events if isinstance(event, RequestRefused)]
        assert (told.client, told.unit, told.code, told.device) == ("10.0.0.9:49152", 0, "03", "every device of hall-a")
        assert bench.gateway.lines[0].every_device.counts[16].refused == 1
        bench.client().ask(0, "10 1A00 0001 02 00BB")
        await asyncio.sleep(0.5)
        assert bench.lines["hall-a"].take_written()[:2] == b"\x00\x10"


async def test_a_write_through_its_mirror_is_checked_too() -> None:
    mirror = '[[image]]\nunit = 141\nof = "silo-1"\nread = [{ holding = "0-1", every = "1 s" }]\n'
    async with gateway_bench(TWO + mirror) as bench:
        bench.attach("hall-a", SimulatedLine("rtu", SimulatedDevice(1), SimulatedDevice(2)))
        await asyncio.sleep(60.0)
        assert await bench.client().asks(141, "10 0100 0001 02 0002") == "90 03"


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
        assert told.why == "another device of the line has, or may have, the address 2"


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
