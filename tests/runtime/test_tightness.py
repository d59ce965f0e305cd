"""Who is near its time limit is told once in a while, and only then."""

import pytest

from gateway.events import TimingTight
from gateway.runtime.tightness import ENOUGH, PAUSE, STEP, TightLimits
from kit.gateway_bench import gateway_bench

CONFIG = """
[[line]]
name = "hall"
port = "/dev/hall"
devices = [{ unit = 1, as = 41, name = "silo-1" }, { unit = 2 }]
"""


class Watched:
    """A gateway whose devices respond as the test says."""

    def __init__(self, bench) -> None:
        self.bench = bench
        self.limits = TightLimits()
        self.now = 0.0
        self.device = bench.gateway.lines[0].devices[41]

    def respond(self, *shares: float, limit: float = 0.2) -> None:
        counts = self.device.counts
        counts[3].ok += 1
        for share in shares:
            counts.times[3].answered(share * limit, 0.0, limit)

    def look(self) -> list[TimingTight]:
        self.now += STEP
        return self.limits.look(self.bench.gateway, self.now)


@pytest.fixture
async def watched():
    async with gateway_bench(CONFIG) as bench:
        yield Watched(bench)


async def test_who_is_near_its_limit_is_told_with_what_to_do(watched):
    watched.respond(*[0.9] * ENOUGH)
    (event,) = watched.look()
    assert (event.line, event.unit, event.device, event.function, event.limit_ms) == ("hall", 1, "silo-1", 3, 200.0)
    assert 170 <= event.elapsed_ms <= 200
    assert event.advice == "modbus-gateway calibrate silo-1 shows which limit it needs"


@pytest.mark.parametrize(
    "shares", [[0.9] * (ENOUGH - 1), [0.7] * ENOUGH, [0.1] * 99 + [0.95]], ids=["few", "not near", "one of a hundred"]
)
async def test_others_are_not(watched, shares):
    watched.respond(*shares)
    assert watched.look() == []


async def test_it_is_told_once_an_hour_as_long_as_it_lasts(watched):
    told = []
    for _ in range(int(3 * PAUSE / STEP)):
        watched.respond(*[0.9] * ENOUGH)
        told += watched.look()
    assert len(told) == 3


async def test_what_was_slow_long_ago_is_not_told_again(watched):
    watched.respond(*[0.9] * ENOUGH)
    assert len(watched.look()) == 1
    watched.now += 2 * PAUSE
    watched.respond(*[0.2] * 10 * ENOUGH)
    assert watched.look() == []


async def test_few_responses_add_up(watched):
    for _ in range(4):
        watched.respond(*[0.9] * (ENOUGH // 4))
        told = watched.look()
    assert len(told) == 1
