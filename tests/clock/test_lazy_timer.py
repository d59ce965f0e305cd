"""The timer: never early, never twice, and cheap when a deadline moves away."""

import asyncio

import pytest

from gateway.clock.lazy_timer import LazyTimer


class Bell:
    """Notes when it was rung."""

    def __init__(self):
        self.loop = asyncio.get_running_loop()
        self.rung = []
        self.timer = LazyTimer(self.loop, self.ring)

    def ring(self):
        self.rung.append(self.loop.time())


@pytest.fixture
async def bell():
    bell = Bell()
    yield bell
    bell.timer.close()


async def test_calls_back_at_the_deadline(bell):
    bell.timer.set(2.5)
    await asyncio.sleep(10)
    assert bell.rung == [2.5]


async def test_a_later_deadline_wins(bell):
    bell.timer.set(1.0)
    bell.timer.set(3.0)
    await asyncio.sleep(10)
    assert bell.rung == [3.0]


async def test_a_later_deadline_leaves_the_timer_standing(bell):
    bell.timer.set(1.0)
    bell.timer.set(3.0)
    bell.timer.set(2.0)
    assert calls_ordered(bell) == [1.0]


async def test_a_call_that_has_been_ordered_serves_for_a_later_deadline_too(bell):
    """A line's limit, and the short waits before it, over and over."""
    for now in range(5):
        bell.timer.set(20.0 + now)
        bell.timer.set(now + 0.5)
        await asyncio.sleep(1)
    assert calls_ordered(bell) == [20.0]
    assert bell.rung == [0.5, 1.5, 2.5, 3.5, 4.5]
    bell.timer.set(24.0)
    await asyncio.sleep(30)
    assert bell.rung[5:] == [24.0]


def calls_ordered(bell):
    return [handle.when() for handle in bell.loop._scheduled]


async def test_an_earlier_deadline_wins(bell):
    bell.timer.set(3.0)
    bell.timer.set(1.0)
    await asyncio.sleep(10)
    assert bell.rung == [1.0]


async def test_none_means_not_at_all(bell):
    bell.timer.set(1.0)
    bell.timer.set(None)
    await asyncio.sleep(10)
    assert bell.rung == []


async def test_a_deadline_set_after_none_counts(bell):
    bell.timer.set(1.0)
    bell.timer.set(None)
    bell.timer.set(2.0)
    await asyncio.sleep(10)
    assert bell.rung == [2.0]


async def test_a_deadline_that_has_passed_rings_in_the_loops_next_turn(bell):
    await asyncio.sleep(5)
    bell.timer.set(1.0)
    assert bell.rung == []
    await asyncio.sleep(0)
    await asyncio.sleep(0)
    assert bell.rung == [5.0]


async def test_it_can_be_set_again_while_it_rings(bell):
    def ring_every_second():
        bell.ring()
        timer.set(bell.rung[-1] + 1)

    timer = LazyTimer(bell.loop, ring_every_second)
    timer.set(1.0)
    await asyncio.sleep(3.5)
    timer.close()
    assert bell.rung == [1.0, 2.0, 3.0]


async def test_a_timer_that_fires_early_does_not_ring(bell):
    """Some loops run their timers up to a millisecond early."""
    bell.timer.set(1.0)
    bell.timer._called()
    assert bell.rung == []
    bell.timer.set(2.0)
    bell.timer._called()
    assert bell.rung == []
    await asyncio.sleep(10)
    assert bell.rung == [2.0]


async def test_once_closed_it_never_rings(bell):
    bell.timer.set(1.0)
    bell.timer.close()
    bell.timer.set(2.0)
    await asyncio.sleep(10)
    assert bell.rung == []


async def test_its_repr_says_how_long_it_is_still_off(bell):
    assert repr(bell.timer) == "<LazyTimer off>"
    bell.timer.set(0.25)
    assert repr(bell.timer) == "<LazyTimer in 250.0 ms>"
