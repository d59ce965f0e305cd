"""What the gateway tells of itself: what it is, what it runs with and since when, what it has."""

import asyncio
import hashlib

import pytest

from kit.browser import web_bench

CONFIG = """
[[line]]
name = "hall"
port = "/dev/hall"
baud = 9600
devices = [{ unit = 6, as = 46, name = "press", profile = "v80" }, { unit = 7, as = "none", name = "oven" }]

[[line]]
name   = "panel"
port   = "/dev/panel"
role   = "server"
serves = [46]

[[upstream]]
name = "plant"
to = "tcp://10.1.0.5"
units = [{ as = 37, unit = 1 }]

[[listen]]
name = "hall-only"
bind = "tcp://127.0.0.1:5599"
line = "hall"
"""
PASSING = '[[line]]\nname = "hall"\nport = "/dev/hall"\n'


@pytest.fixture
async def bench(tmp_path):
    async with web_bench(CONFIG, tmp_path) as bench:
        yield bench


async def inventory(bench):
    page = await bench.browser().get("/api/v1/inventory")
    assert page.status == 200, page.text
    return page.json


async def test_lines_devices_and_adapters_are_those_of_the_config(bench):
    told = await inventory(bench)
    assert [(each["name"], each["role"], each["baud"]) for each in told["lines"]] == [
        ("hall", "client", 9600),
        ("panel", "server", 19200),
        ("plant", "upstream", None),
    ]
    assert [(each["name"], each["unit"], each["on_the_wire"], each["profile"]) for each in told["devices"]] == [
        ("press", 46, 6, "v80"),
        ("oven", None, 7, "generic"),
        ("plant/37", 37, 1, "generic"),
    ]
    assert [(each["line"], each["port"], each["ids"]) for each in told["adapters"]] == [
        ("hall", "/dev/hall", ""),
        ("panel", "/dev/panel", ""),
    ]


async def test_the_config_is_known_by_its_hash_and_since_when_it_is_applied(bench, tmp_path):
    before = await inventory(bench)
    assert before["config"]["sha256"] == hashlib.sha256(CONFIG.encode()).hexdigest()
    assert before["started"] == before["config"]["applied"] == "2026-05-01T12:00:00Z"
    await asyncio.sleep(60)
    changed = CONFIG.replace("baud = 9600", "baud = 19200")
    (tmp_path / "gateway.toml").write_text(changed)
    anna = bench.browser()
    await anna.log_in("anna")
    assert (await anna.post("/api/v1/reload")).status == 200
    after = await inventory(bench)
    assert after["config"]["sha256"] == hashlib.sha256(changed.encode()).hexdigest()
    assert after["started"] == before["started"]
    assert after["config"]["applied"].startswith("2026-05-01T12:01:0")


async def test_a_rejected_file_does_not_count_as_applied(bench, tmp_path):
    before = await inventory(bench)
    (tmp_path / "gateway.toml").write_text("[[line]]\nbaud = 1\n")
    anna = bench.browser()
    await anna.log_in("anna")
    assert (await anna.post("/api/v1/reload")).status == 422
    assert (await inventory(bench))["config"] == before["config"]


async def test_units_that_are_passed_through_are_no_devices(tmp_path):
    async with web_bench(PASSING, tmp_path) as bench:
        assert (await inventory(bench))["devices"] == []
