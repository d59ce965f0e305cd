"""Devices that change their addresses, with every fault: no client gets what is another device's."""

import pytest

from gateway.devices.device import EveryDevice
from gateway.devices.quirks import EveryQuirkyDevice, MovableDevice
from gateway.lines.exchange import Exchange
from gateway.lines.transaction import Transaction
from gateway.state.memory import Memory
from soak.noticing import is_noticed
from soak.tally import Tally
from soak.worlds.moving import play

pytestmark = pytest.mark.search


async def played(seed: int) -> Tally:
    return await play(transactions=15_000, share=0.2, seed=seed)


async def test_fifteen_thousand_transactions_and_no_wrong_answer() -> None:
    tally = await played(4)
    assert tally.wrong == []
    assert sum(count for (_, outcome), count in tally.outcomes.items() if outcome == "right data") > 10_000
    assert min(tally.counts["refused moves"], tally.counts["addresses set by hand"], tally.counts["spares"]) > 5
    assert min(tally.events["address_moved"], tally.events["late_response"], tally.broadcasts) > 100


@pytest.mark.interpreted
async def test_it_notices_what_is_asked_while_a_move_or_a_late_answer_is_awaited(monkeypatch) -> None:
    def forbids_the_same(late: Exchange, other: Transaction) -> bool:
        return late.asked.function == other.asked.function and late.unit == other.device.unit

    monkeypatch.setattr(Exchange, "forbids", forbids_the_same)
    assert await is_noticed(played)


@pytest.mark.interpreted
async def test_it_notices_a_gateway_that_asks_where_the_config_says(monkeypatch) -> None:
    failed = MovableDevice._failed

    def try_configured(device: MovableDevice, transaction: Transaction) -> None:
        failed(device, transaction)
        if device.breaker.failures >= 3 and device.address.is_free(device.settings.unit):
            device.begin_at(*device.address.units, device.settings.unit)
            device.unit = device.settings.unit

    monkeypatch.setattr(MovableDevice, "_failed", try_configured)
    assert await is_noticed(played)


@pytest.mark.interpreted
async def test_it_notices_a_restart_that_forgets_an_unanswered_move(monkeypatch) -> None:
    remember = Memory.remember
    monkeypatch.setattr(
        Memory, "remember", lambda memory, key, configured, now, *_: remember(memory, key, configured, now)
    )
    assert await is_noticed(played)


@pytest.mark.interpreted
async def test_it_notices_a_broadcast_of_an_address(monkeypatch) -> None:
    monkeypatch.setattr(EveryQuirkyDevice, "check", EveryDevice.check)
    assert await is_noticed(played)
