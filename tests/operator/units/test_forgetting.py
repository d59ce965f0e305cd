"""`forget`: a device is asked where the config says again, and its line has the configured rate."""

import asyncio

import pytest

from gateway.errors import WrongQuestion
from gateway.events import AddressMoved, BaudChanged
from gateway.operator.operations.answers.forget import Forgotten
from gateway.operator.units.forgetting import forget
from gateway.state.memory import Memory
from kit.asking import ask
from kit.gateway_bench import gateway_bench

CONFIG = """
[[line]]
name    = "hall-a"
port    = "/dev/hall-a"
baud    = 9600
devices = [{ unit = 1, as = 41, name = "silo-1", profile = "weigher" }]
"""
TWO = CONFIG.replace('"weigher" }', '"weigher" }, { unit = 2, as = 42, name = "silo-2", profile = "weigher" }')
PLAIN = CONFIG.replace(', profile = "weigher"', "")
SILO_1, SILO_2, RATE = "/dev/hall-a silo-1", "/dev/hall-a silo-2", "/dev/hall-a"
ADVICE = "what was remembered is forgotten, so the config counts again"


def remembering(**units: tuple[int, ...]) -> Memory:
    memory = Memory()
    for name, values in units.items():
        memory.remember(f"/dev/hall-a {name.replace('_', '-')}", *values)
    return memory


@pytest.mark.parametrize("device", ["silo-1", 41])
async def test_the_address_in_the_config_counts_again(device) -> None:
    memory = remembering(silo_1=(1, 5))
    async with gateway_bench(CONFIG, memory) as bench:
        answer = await ask(bench.running, "forget", device=device)
        assert answer["forgotten"] == Forgotten("hall-a", "silo-1", 1, (5,), 9600, 9600)
        assert bench.gateway.lines[0].devices[41].unit == 1
        assert AddressMoved("hall-a", "silo-1", 1, 5, ADVICE) in bench.events
    assert memory.recall(SILO_1, 1) == 1


async def test_a_doubt_ends() -> None:
    async with gateway_bench(CONFIG, remembering(silo_1=(1, 1, 5))) as bench:
        assert forget(bench.gateway, "silo-1", bench.events.append).was_at == (1, 5)
        assert bench.gateway.lines[0].devices[41].address.units == (1,)


async def test_not_while_the_device_may_still_change_its_address() -> None:
    """Its new address would count as free, and another one could get it too."""
    async with gateway_bench(CONFIG) as bench:
        client = bench.client()
        client.ask(41, "10 0100 0001 02 0005")
        for _ in range(2):  # on the line, and when its answer is late
            await asyncio.sleep(0.5)
            with pytest.raises(WrongQuestion, match=r"silo-1 was sent a change .* try again in \d s"):
                forget(bench.gateway, "silo-1", bench.events.append)
            assert bench.gateway.lines[0].devices[41].possible_units == (1, 5)
        assert await client.answer() == "90 0B"
        await asyncio.sleep(5.0)
        assert forget(bench.gateway, "silo-1", bench.events.append).was_at == (1, 5)


async def test_a_device_that_is_silent_is_forgotten_at_once() -> None:
    async with gateway_bench(CONFIG, remembering(silo_1=(1, 5))) as bench:
        assert await bench.client().asks(41, "03 0000 0002") == "83 0B"
        assert forget(bench.gateway, "silo-1", bench.events.append).was_at == (5,)


async def test_the_rate_in_the_config_counts_again() -> None:
    memory = Memory()
    memory.remember(RATE, 9600, 19200)
    async with gateway_bench(CONFIG, memory) as bench:
        assert forget(bench.gateway, "silo-1", bench.events.append) == Forgotten(
            "hall-a", "silo-1", 1, (1,), 9600, 19200
        )
        assert bench.lines["hall-a"].baud == 9600
        assert BaudChanged("hall-a", "silo-1", 9600, ADVICE) in bench.events
    assert memory.recall(RATE, 9600) == 9600


async def test_of_several_devices_only_the_one_that_is_named_is_forgotten() -> None:
    async with gateway_bench(TWO, remembering(silo_1=(1, 5), silo_2=(2, 7))) as bench:
        forget(bench.gateway, "silo-2", bench.events.append)
        units = [device.unit for device in bench.gateway.lines[0].devices.values()]
        assert units == [5, 2]


async def test_not_where_another_device_has_moved_to() -> None:
    memory = remembering(silo_1=(1, 5), silo_2=(2, 1))
    async with gateway_bench(TWO, memory) as bench:
        with pytest.raises(WrongQuestion, match=r"has, or may have, the address 1: .* another unit in gateway.toml:6"):
            forget(bench.gateway, "silo-1", bench.events.append)
        assert bench.gateway.lines[0].devices[41].unit == 5
    assert memory.recall(SILO_1, 1) == 5


async def test_what_was_in_the_way_may_be_forgotten_first() -> None:
    async with gateway_bench(TWO, remembering(silo_1=(1, 5), silo_2=(2, 1))) as bench:
        forget(bench.gateway, "silo-2", bench.events.append)
        forget(bench.gateway, "silo-1", bench.events.append)
        assert [device.unit for device in bench.gateway.lines[0].devices.values()] == [1, 2]


async def test_a_device_that_has_no_address_any_more_gets_that_of_the_config() -> None:
    edited = TWO.replace("unit = 2,", "unit = 5,")
    async with gateway_bench(edited, remembering(silo_1=(1, 5))) as bench:
        assert await bench.client().asks(41, "03 0000 0002") == "83 0A"
        forget(bench.gateway, "silo-1", bench.events.append)
        assert bench.gateway.lines[0].devices[41].address.units == (1,)


async def test_a_number_is_that_of_the_device_which_all_clients_can_reach() -> None:
    alone = """
[[listen]]
bind = "tcp://127.0.0.1:1503"
line = "hall-b"
[[listen]]
bind = "tcp://127.0.0.1:1502"
[[line]]
name = "hall-b"
port = "/dev/hall-b"
"""
    memory = remembering(silo_1=(41, 5))
    async with gateway_bench(alone + CONFIG.replace("unit = 1,", "unit = 41,"), memory) as bench:
        assert forget(bench.gateway, 41, bench.events.append).device == "silo-1"


async def test_of_a_device_without_quirks_nothing_is_remembered() -> None:
    async with gateway_bench(PLAIN) as bench:
        events = len(bench.events)
        assert forget(bench.gateway, "silo-1", bench.events.append) == Forgotten(
            "hall-a", "silo-1", 1, (1,), 9600, 9600
        )
        assert len(bench.events) == events


@pytest.mark.parametrize("device", ["silo-9", 9, 200, None])
async def test_what_is_no_device_on_a_line_is_told(device) -> None:
    async with gateway_bench(CONFIG + "[[image]]\nunit = 200\nholding = 1\n") as bench:
        with pytest.raises(WrongQuestion):
            forget(bench.gateway, device, bench.events.append)
