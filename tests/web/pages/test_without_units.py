"""Devices without a unit for clients, on pages and over the HTTP API: by their names."""

import re

import pytest

from gateway.devices.device import key_of
from gateway.events import WriteAudit
from kit.browser import web_bench
from kit.device import SimulatedDevice, SimulatedLine

CONFIG = """
[[line]]
name = "hall"
port = "/dev/hall"
devices = [
  { unit = 5, as = "none", name = "pump", points = [{ name = "speed", holding = 0, write = true }] },
  { unit = 6, as = 41, name = "press" },
]
"""


@pytest.fixture
def device():
    device = SimulatedDevice(5)
    device.holding[0] = 120
    return device


@pytest.fixture
async def bench(tmp_path, device):
    async with web_bench(CONFIG, tmp_path) as bench:
        bench.inner.attach("hall", SimulatedLine("rtu", device))
        yield bench


@pytest.fixture
async def anna(bench):
    browser = bench.browser()
    await browser.log_in("anna")
    return browser


async def test_the_api_has_it_by_its_name(anna):
    units = (await anna.get("/api/v1/units")).json["units"]
    assert [(unit["unit"], unit["name"]) for unit in units] == [(41, "press"), (None, "pump")]
    read = (await anna.get("/api/v1/units/pump/holding/0-1")).json
    assert (read["unit"], read["name"], [each["value"] for each in read["values"]]) == (None, "pump", [120, 0])
    assert (await anna.get("/api/v1/units/pump/points/speed")).json["values"][0]["value"] == 120
    assert (await anna.get("/api/v1/units/5")).status == 404


async def test_the_api_writes_it_by_its_name(anna, bench, device):
    answer = await anna.put("/api/v1/units/pump/points/speed", [70])
    assert (answer.status, device.holding[0]) == (200, 70)
    [audit] = [event for event in bench.inner.events if isinstance(event, WriteAudit)]
    assert (audit.listener, audit.unit, audit.device) == ("web", 5, "pump")


@pytest.mark.parametrize("page", ["/", "/units/pump", "/units/pump/values", "/lines/hall", "/traffic", "/clients"])
async def test_pages_show_no_number(anna, page):
    await anna.get("/api/v1/units/pump/holding/0-1")
    shown = await anna.get(page)
    assert shown.status == 200
    assert "pump" in shown.text or page == "/clients"
    assert str(key_of("pump")) not in shown.text
    assert not re.search(r"\bNone (?!since)|>\s*None\s*<", shown.text)


async def test_traffic_of_it_is_chosen_by_its_name(anna):
    await anna.get("/api/v1/units/pump/holding/0-1")
    page = await anna.get("/traffic?unit=pump")
    assert '<option value="pump" selected>pump</option>' in page.text
    assert "5 pump" in page.text


async def test_a_form_writes_it(anna, device):
    page = await anna.post("/units/pump/writes", {"point": "speed", "value": "80"})
    question = page.headers["Location"]
    assert question.startswith("/units/pump/writes/")
    assert await anna.get(question)
    assert device.holding[0] == 120
    await anna.post(question)
    assert device.holding[0] == 80


async def test_metrics_have_its_name(anna):
    await anna.get("/api/v1/units/pump/holding/0-1")
    counted = re.findall(r"^modbus_gateway_requests_total\{(.*)\} 1", (await anna.get("/metrics")).text, re.MULTILINE)
    assert [dict(re.findall(r'(\w+)="(\w*)"', each)) for each in counted] == [
        {"line": "hall", "unit": "pump", "function": "3", "result": "ok"}
    ]
