"""Tests of the silo and of the program, by pytest-asyncio."""

from collections.abc import AsyncIterator
from pathlib import Path

import pytest
import pytest_asyncio
from silo import Silo

from gateway import Area, ConfigError, Gateway, IllegalAddress, Refused
from plant import note

CONFIG = Path(__file__).with_name("plant.toml")


@pytest_asyncio.fixture
async def gateway() -> AsyncIterator[Gateway]:
    async with Gateway.from_toml(CONFIG) as gateway:
        yield gateway


@pytest.mark.asyncio
async def test_a_silo_alone() -> None:
    silo = Silo(3)
    assert await silo.read(Area.HOLDING, 0, 1) == [3]
    with pytest.raises(IllegalAddress):
        await silo.read(Area.INPUT, 0, 1)


@pytest.mark.asyncio
async def test_the_weight_is_noted(gateway: Gateway) -> None:
    assert await note(gateway.unit("silo"), gateway.unit("recipe")) == 1200
    assert await gateway.unit("recipe").read_holding(3, 2) == [1200, 1]


@pytest.mark.asyncio
async def test_only_one_sets_it_to_zero(gateway: Gateway) -> None:
    silo = gateway.unit("silo")
    with pytest.raises(Refused) as refused:
        await silo.write_coils(0, [False])
    assert refused.value.code == 3
    await silo.write_coils(0, [True])
    assert (await silo.read("weight")).value == 0


def test_a_config_that_is_wrong() -> None:
    with pytest.raises(ConfigError) as error:
        Gateway.from_text("[[image]]\nunit = 0\n")
    assert error.value.problems
