"""Clients that were refused are read again, of many only some at once: in virtual time."""

import asyncio
from collections import Counter
from itertools import pairwise

from gateway.listeners.holds import MOST_AT_ONCE, PAUSE, Holds


def released(holds: Holds, seconds: float, times: list[float]) -> None:
    loop = asyncio.get_running_loop()

    def release() -> bool:
        times.append(loop.time())
        return True

    holds.add(seconds, release)


async def test_one_is_released_after_its_time_and_of_many_only_some_at_once() -> None:
    holds, alone, times = Holds(), [], []
    start = asyncio.get_running_loop().time()
    released(holds, 0.128, alone)
    await asyncio.sleep(1.0)
    assert alone == [start + 0.128]
    for _ in range(300):
        released(holds, 0.002, times)
    await asyncio.sleep(1.0)
    assert len(times) == 300
    at_once = Counter(times)
    assert max(at_once.values()) == MOST_AT_ONCE
    assert min(later - earlier for earlier, later in pairwise(sorted(at_once))) > 0.9 * PAUSE
    assert times[-1] - start - 1.0 < 310 / MOST_AT_ONCE * PAUSE


async def test_who_waits_for_a_shorter_time_is_released_before_who_has_come_earlier() -> None:
    holds, order = Holds(), []
    for name, seconds in (("long", 0.128), ("short", 0.002)):
        holds.add(seconds, lambda name=name: order.append(name) is None)
    await asyncio.sleep(1.0)
    assert order == ["short", "long"]


async def test_clients_that_are_gone_take_no_turns() -> None:
    holds, times = Holds(), []
    for _ in range(3000):
        holds.add(0.001, lambda: False)
    start = asyncio.get_running_loop().time()
    released(holds, 0.002, times)
    await asyncio.sleep(1.0)
    assert times[0] - start < 0.002 + 2 * PAUSE


async def test_nobody_is_released_once_the_listener_is_closed() -> None:
    holds, times = Holds(), []
    for _ in range(2):
        released(holds, 0.002, times)
    holds.close()
    await asyncio.sleep(1.0)
    assert times == []
