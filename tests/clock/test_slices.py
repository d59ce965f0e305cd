"""Long work in slices: what else has its turn meanwhile."""

import asyncio
from collections.abc import Iterator

import pytest

from gateway.clock.slices import in_slices, turn


async def test_however_many_wait_one_goes_on_in_each_turn_of_the_loop() -> None:
    went_on: list[int] = []
    turns: list[int] = []

    async def work() -> None:
        for _ in range(3):
            await turn()
            went_on.append(len(turns))

    works = asyncio.gather(*(work() for _ in range(64)))
    while not works.done():
        turns.append(0)
        await asyncio.sleep(0)
    assert len(went_on) == 3 * 64
    assert max(map(went_on.count, went_on)) == 1


async def test_one_that_gives_up_keeps_nobody_waiting() -> None:
    first, second = asyncio.create_task(turn()), asyncio.create_task(turn())
    await asyncio.sleep(0)
    first.cancel()
    await asyncio.wait_for(second, 1)
    await asyncio.wait_for(turn(), 1)


async def test_long_readings_side_by_side_take_turns(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.clock.slices._SLICE", 0.0)
    turns = 0
    made: list[int] = []

    def parts() -> Iterator[int]:
        for part in range(100):
            made.append(turns)
            yield part

    readings = asyncio.gather(*(in_slices(parts()) for _ in range(8)))
    while not readings.done():
        await asyncio.sleep(0)
        turns += 1
    assert readings.result() == [list(range(100))] * 8
    most_at_once = max(made.count(turn) for turn in range(2, turns))
    assert most_at_once == 1
