"""What other sites are told of this gateway beside its state. In virtual time."""

import asyncio
import json
from types import SimpleNamespace

import pytest

from gateway.tools import site_inventory
from gateway.tools.site_inventory import KEPT, STEP, keep_telling, own_inventory
from kit.browser import web_bench

CONFIG = """
site = "plant-7"
[[line]]
name = "hall"
port = "/dev/hall"
timeout = "100 ms"
devices = [{ unit = 6, as = 46, name = "press" }, { unit = 7, as = 47, name = "oven" }]
"""


@pytest.fixture
async def bench(tmp_path):
    async with web_bench(CONFIG, tmp_path) as bench:
        yield bench


async def test_it_has_config_and_adapters_and_what_doctor_would_find_without_sending(bench):
    client = bench.inner.client()
    for _ in range(3):
        await client.asks(46, "03 00 00 00 01")
    sent = bench.running.ring.added
    own = await own_inventory(bench.running, bench.operator.reloader)
    assert bench.running.ring.added == sent
    assert len(own.config) == 12
    assert [(each.line, each.port) for each in own.adapters] == [("hall", "/dev/hall")]
    assert own.to_fix == len(own.worst) > 0
    assert own.worst[0].what


async def test_it_tells_no_client_its_address_and_no_remedy(bench):
    (listener,) = bench.running.gateway.listeners
    for _ in range(3):
        listener.left_early("10.2.0.7", 0.5)
    own = await own_inventory(bench.running, bench.operator.reloader)
    assert "10.2.0.7" not in json.dumps(own.told(asyncio.get_running_loop().time()))


async def test_it_is_found_out_every_minute_and_soon_after_a_reload_while_there_is_a_fleet(bench, monkeypatch):
    looked = []

    async def look(running, reloader):
        looked.append(asyncio.get_running_loop().time())
        return reloader.text

    fleet = SimpleNamespace(is_connected=False, inventory=None)
    monkeypatch.setattr(site_inventory, "own_inventory", look)
    running = SimpleNamespace(add_ons=SimpleNamespace(fleet=fleet))
    reloader = SimpleNamespace(text="one")
    task = asyncio.create_task(keep_telling(running, reloader))
    await asyncio.sleep(3 * KEPT)
    assert looked == []
    fleet.is_connected = True
    await asyncio.sleep(5 * KEPT)
    assert 4 <= len(looked) <= 6
    reloader.text = "another"
    await asyncio.sleep(STEP + 1)
    assert fleet.inventory == "another"
    task.cancel()
