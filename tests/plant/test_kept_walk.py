"""Random lives of a publisher that keeps: nothing is lost, told twice, out of order, or counted wrongly; kept_world.py.

`pytest -m search tests/plant/test_kept_walk.py` lives many more of them.
"""

import pytest

from plant.kept_world import LIVES, run_one

pytestmark = pytest.mark.interpreted


@pytest.mark.parametrize("sparkplug", [False, True])
@pytest.mark.parametrize("name", LIVES)
def test_nothing_is_lost_in_a_random_life(name, sparkplug):
    for seed in range(2):
        run_one(seed, name, sparkplug=sparkplug, steps=300)


@pytest.mark.search
@pytest.mark.parametrize("seed", range(100, 108))
def test_nothing_is_lost_in_many_random_lives(seed):
    for name in LIVES:
        for sparkplug in (False, True):
            run_one(seed, name, sparkplug=sparkplug, steps=600)
