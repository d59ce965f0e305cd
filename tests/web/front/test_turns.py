"""Requests whose clients have gone cost nothing any more: who still waits has a response at once."""

import asyncio

import pytest

from gateway.operator.config.view import UNREAD_KEPT
from kit.browser import web_bench

CONFIG = """
[[image]]
unit = 200
holding = 20
"""
#: How long each thread takes, in seconds.
SLOW = 1.0


@pytest.fixture
async def bench(tmp_path, monkeypatch):
    """A page whose threads take SLOW."""
    loop = asyncio.get_running_loop()
    at_once = loop.run_in_executor

    async def slowly(executor, func, *args):
        await asyncio.sleep(SLOW)
        return await at_once(executor, func, *args)

    async with web_bench(CONFIG, tmp_path) as bench:
        monkeypatch.setattr(loop, "run_in_executor", slowly)
        yield bench
        assert not bench.events("part_failed")


@pytest.mark.parametrize("path", ["/login", "/no-such-page", "/metrics", "/config"])
async def test_requests_of_clients_that_have_gone_delay_nobody(bench, path):
    browser, loop = bench.browser(), asyncio.get_running_loop()
    wires = [browser.open(path, headers={"Accept": "text/html"}) for _ in range(50)]
    await asyncio.sleep(SLOW / 2)
    for wire in wires:
        wire.close()
    began = loop.time()
    page = await browser.get(path, Accept="text/html")
    assert page.status == (404 if path == "/no-such-page" else 200)
    assert loop.time() - began <= 8 * SLOW  # what had begun, and its own
    assert not any(wire.received for wire in wires)


async def test_why_the_config_cannot_be_read_is_kept_for_a_while(tmp_path, monkeypatch):
    began = []

    def hang(file, **_):
        began.append(file)
        raise TimeoutError

    monkeypatch.setattr("kit.browser.read_here", hang)
    async with web_bench(CONFIG, tmp_path) as bench:
        for _ in range(3):
            assert "cannot be read within" in (await bench.browser().get("/config")).text
        assert len(began) == 1
        await asyncio.sleep(UNREAD_KEPT)
        await bench.browser().get("/config")
        assert len(began) == 2
