"""What a TCP listener does at regular times, in virtual time."""

import asyncio

from gateway.listeners.arrivals import LOOK_STEP
from gateway.listeners.rounds import Rounds


async def test_clients_that_keep_connecting_do_not_put_the_next_look_off() -> None:
    looks = 0

    def look() -> bool:
        nonlocal looks
        looks += 1
        return True

    rounds = Rounds(1.0, lambda: None, look)
    for _ in range(100):
        rounds.look_later()
        await asyncio.sleep(LOOK_STEP / 2)
    rounds.close()
    assert 40 <= looks <= 50


async def test_looking_ends_when_nobody_is_left_and_begins_again() -> None:
    looks = []
    rounds = Rounds(1.0, lambda: None, lambda: looks.append(1) is not None)
    for expected in (1, 2):
        rounds.look_later()
        await asyncio.sleep(10 * LOOK_STEP)
        assert len(looks) == expected
    rounds.close()
