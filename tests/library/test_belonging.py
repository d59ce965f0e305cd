"""A unit of a program belongs to one gateway at a time: what it asks is a unit of that one."""

import asyncio
import gc
from weakref import ref

import pytest

from gateway import CustomUnit, Gateway, ListenError, NotConfigured
from gateway.library.belonging import belonging

CONFIG = """
[[listen]]
bind = "tcp://127.0.0.1:0"

[[image]]
unit = 5
name = "shift"
holding = 10
"""


class Relay(CustomUnit):
    """Has the registers of another unit."""

    async def read(self, area, address, count):
        return await self.unit("shift").read_holding(address, count)


async def test_a_unit_that_two_gateways_have_does_not_answer_with_what_the_other_one_holds():
    relay = Relay()
    async with Gateway.from_text(CONFIG, units={60: relay, 61: relay}) as first:
        await first.unit(5).write_holding(0, [111])
        with pytest.raises(RuntimeError, match=r"units\[60\] belongs to another gateway that runs"):
            async with Gateway.from_text(CONFIG, units={59: Relay(), 60: relay}):
                pass
        assert await first.unit(60).read_holding(0) == [111]
        assert await first.unit(61).read_holding(0) == [111]
    async with Gateway.from_text(CONFIG, units={60: relay}) as second:  # one after the other
        await second.unit(5).write_holding(0, [222])
        assert await second.unit(60).read_holding(0) == [222]
    with pytest.raises(RuntimeError, match="belongs to no gateway"):
        relay.unit("shift")


async def test_a_unit_may_have_attributes_of_any_name():
    class Finds(Relay):
        find = "x"

        def _find(self, name):
            return self.unit(name)

        async def read(self, area, address, count):
            return await self._find("shift").read_holding(address, count)

    unit = Finds()
    unit._unit = unit._gateway = None
    async with Gateway.from_text(CONFIG, units={60: unit}) as gateway:
        assert await gateway.unit(60).read_holding(0) == [0]


async def test_a_unit_that_is_kept_does_not_keep_a_gateway_that_has_stopped():
    relay = Relay()
    gateway = Gateway.from_text(CONFIG, units={60: relay})
    async with gateway:
        assert await gateway.unit(60).read_holding(0) == [0]
    kept = ref(gateway)
    del gateway
    await asyncio.sleep(1)
    gc.collect()
    assert kept() is None
    assert vars(relay) == {}


async def test_a_start_that_fails_gives_its_units_back():
    relay = Relay()
    async with Gateway.from_text(CONFIG) as other:
        taken = CONFIG.replace("tcp://127.0.0.1:0", other.addresses[0])
        with pytest.raises(ListenError):
            async with Gateway.from_text(taken, units={60: relay}):
                pass
    async with Gateway.from_text(CONFIG, units={60: relay}) as gateway:
        with pytest.raises(NotConfigured):
            relay.unit("none")
        assert await gateway.unit(60).read_holding(0) == [0]


def test_those_of_a_gateway_that_may_not_have_all_stay_as_they_were():
    mine, of_another = Relay(), Relay()
    with belonging({1: of_another}, str):
        with pytest.raises(RuntimeError), belonging({1: mine, 2: of_another}, int):
            pass
        assert of_another.unit(7) == "7"
        with belonging({1: mine}, int):
            assert mine.unit(7) == 7
