"""Units of a program in the life of a gateway: whatever is cancelled at whatever step, nothing stays behind."""

import asyncio
from contextlib import suppress
from functools import partial

import pytest

from gateway import CustomUnit, Gateway
from gateway.errors import RequestError
from kit.stepping_loop import ends_of
from library.test_life import CANCELLED

CONFIG = """
[[listen]]
bind = "tcp://127.0.0.1:0"

[[image]]
unit = 9
holding = "0-9"

[[image]]
unit = 240
map = [{ at = 0, device = "meter", holding = "0-3", every = "1 s" }]

[[image]]
unit = 60
name = "meter"
python = "plant:Meter"
timeout = "300 ms"
"""


class Meter(CustomUnit):
    """Asks another unit, waits, and cleans up; from address 8 on longer than it may."""

    def __init__(self) -> None:
        self.at_once = 0

    async def read(self, area, address, count):
        assert self.at_once == 0
        self.at_once += 1
        try:
            values = await self.unit(9).read_holding(address % 8, count)
            await asyncio.sleep(address / 20)
            return values
        finally:
            try:
                await asyncio.sleep(0.01)
            finally:
                self.at_once -= 1


async def live(*asked: tuple[int, int]) -> str:
    """Start a gateway, read units of it at once, each at an address, and stop it."""
    async with Gateway.from_text(CONFIG, units={60: Meter()}) as gateway, asyncio.TaskGroup() as group:
        for unit, address in asked:
            group.create_task(ask(gateway, unit, address))
    return "through"


async def ask(gateway: Gateway, unit: int, address: int) -> None:
    with suppress(RequestError):
        await gateway.unit(unit).read_holding(address)


@pytest.mark.parametrize("cancelled", CANCELLED)
def test_cancelled_at_any_step_nothing_is_left(cancelled):
    assert ends_of(partial(live, (60, 1), (60, 2), (240, 0), (60, 9)), CANCELLED[cancelled]) == []
