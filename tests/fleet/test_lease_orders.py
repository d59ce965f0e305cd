"""Everything that may happen to a lease, in every order: no two gateways may ever write at once."""

import random
from functools import cache

import pytest

from fleet.lease_world import World

#: How often each thing happens on a random walk, beside 1.
WEIGHTS = {
    "pass": 2,
    "ask": 12,
    "serve": 20,
    "answer": 20,
    "kill": 0.3,
    "stop": 0.5,
    "wipe": 0.2,
    "release": 0.3,
    "roll back": 0.2,
}
RATES = [(1.0, 1.0), (0.92, 1.08), (1.08, 0.92), (1.0, 0.9, 1.05)]


def searched(rates: tuple[float, ...]) -> object:
    """These too when there is time."""
    return pytest.param(rates, marks=pytest.mark.search)


@cache
def weight(happening: str) -> float:
    return WEIGHTS.get(happening.rpartition(" ")[0], 1.0)


def walk(world: World, seed: int, steps: int) -> list[str]:
    """Let so much happen by chance, until something is wrong; what has happened."""
    choose = random.Random(seed)
    story: list[str] = []
    while len(story) < steps and not world.wrong:
        may = list(world.happenings())
        weights = [weight(one) for one in may]
        story += choose.choices(may, weights)
        world.do(story[-1])
    return story


def after(world: World, *happenings: str) -> World:
    """The world after all this."""
    for one in happenings:
        world.do(one)
    return world


def settle(world: World, number: int) -> None:
    """Let one gateway ask, and hear the answer."""
    world.do(f"ask {number}")
    if f"serve {number}" in world.happenings():
        after(world, f"serve {number}", f"answer {number}")


def held_by_the_first(rates: tuple[float, ...]) -> World:
    """The first gateway holds the lease and writes; all others have seen that."""
    world = World(rates)
    first = world.gateways[0]
    assert first is not None
    while first.wrote < world.now:
        after(world, "pass 1")
        settle(world, 0)
        assert world.now < 1040
    for number in range(1, len(rates)):
        settle(world, number)
    return world


@pytest.mark.parametrize("rates", [*map(searched, RATES[:2]), *RATES[2:]])
def test_on_random_walks_no_two_gateways_write_at_once(rates: tuple[float, ...]) -> None:
    taken = 0
    for seed in range(150):
        world = World(rates)
        story = walk(world, seed, steps=300)
        assert not world.wrong, f"{world.wrong}: {story}"
        taken += any(one is not None and one.wrote > 0 for one in world.gateways)
    assert taken > 60, "most walks must get somewhere"


@pytest.mark.parametrize("rates", [RATES[1], searched(RATES[2])])
def test_in_every_order_no_two_gateways_write_at_once(rates: tuple[float, ...]) -> None:
    worlds, seen = [held_by_the_first(rates)], set()
    for _ in range(5):
        longer = []
        for world in worlds:
            for happening in world.happenings():
                there = world.copy()
                there.do(happening)
                assert not there.wrong, f"{there.wrong}: {happening}"
                picture = there.picture()
                if picture not in seen:
                    seen.add(picture)
                    longer.append(there)
        worlds = longer
    assert len(seen) > 1000


@pytest.mark.parametrize("how", ["stop", "hear"])
def test_who_has_seen_a_later_entry_waits_when_the_store_comes_back_older(how: str) -> None:
    """It comes back with an entry of the first, or a released one. The second holds the lease, and cannot ask."""
    world = after(held_by_the_first(RATES[3]), f"{how} 0")
    if how == "hear":
        settle(world, 0)
    begin, second = world.revision, world.gateways[1]
    assert second is not None
    while not second.lease.is_held:
        world.do("pass 1")
        settle(world, 1)
        assert world.now < 1100
    if how == "stop":
        world.do("go on 0")
    while f"roll back {world.revision - begin}" not in world.happenings():
        world.do("pass 1")
        settle(world, 0)
        settle(world, 2)
        assert world.now < 1100
    world.do(f"roll back {world.revision - begin}")
    for _ in range(60):
        for number in (0, 2):
            if f"lose {number}" in world.happenings():
                world.do(f"lose {number}")
            settle(world, number)
        world.do("pass 1")
        assert not world.wrong
    assert any(one is not None and one.lease.is_held for one in world.gateways)
