"""Points on the page of a unit: bits, values that are none, limits, and what they are written with."""

import re

import pytest

from gateway.modbus.rtu import with_crc
from kit.browser import web_bench
from kit.device import SimulatedDevice, SimulatedLine
from kit.markup import Markup

CONFIG = """
[[line]]
name = "hall"
port = "/dev/hall"
devices = [{ unit = 1, as = 41, name = "boiler", profile = "boiler" }]

[[image]]
unit = 200
name = "copy"
holding = "0-19"
profile = "boiler"

[profile.boiler]
functions = [3, 4, 6, 16, 22]
points = [
    { name = "pump", holding = 8, bit = 3, write = true },
    { name = "mode", holding = 8, bits = "4-6", labels = { 0 = "off", 2 = "eco" }, write = true },
    { name = "step", holding = 8, byte = "high" },
    { name = "flow", input = 12, scale = 0.1, unit = "m³/h", invalid = 0x8000, write = true, write_at = 15 },
    { name = "limit", holding = 2, scale = 0.5, min = 10, max = 20, write = true },
    { name = "power-sf", holding = 5, type = "int16" },
    { name = "power", holding = 4, type = "int16", scale_from = "power-sf", unit = "W", write = true },
]
"""
PAGE = "/units/boiler"
NOT_TO_22 = """
[[access]]
listen = ["web"]
units = "all"
functions = [3, 4, 6, 16]
"""


@pytest.fixture
def device():
    device = SimulatedDevice(1)
    device.holding[8] = 0x0728
    device.holding[4:6] = [123, 0xFFFF]
    device.input[12] = 0x8000
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


def rows(page: str) -> dict[str, list[str]]:
    """Place, value and unit of each point."""
    found = {}
    for name, row in re.findall(r'<tr data-point="([^"]+)">(.*?)</tr>', page, re.DOTALL):
        cells = re.findall(r"<td.*?>(.*?)</td>", row, re.DOTALL)[:3]
        found[name] = [re.sub(r"<[^>]+>|\s+", " ", cell).strip() for cell in cells]
    return found


def form(page: str, name: str) -> str:
    """The field for the new value of a point; empty if it has none."""
    row = re.search(rf'<tr data-point="{name}">(.*?)</tr>', page, re.DOTALL)
    assert row is not None
    field = re.search(r'<select name="value".*?</select>|<input name="value".*?>', row[1], re.DOTALL)
    return field[0] if field else ""


def heard(device) -> list[str]:
    return [frame.pdu.hex(" ").upper() for frame in device.heard]


async def written(anna, point: str, value: str) -> str:
    """The page after a value was entered, and confirmed."""
    page = await anna.post(f"{PAGE}/writes", {"point": point, "value": value})
    assert page.status == 303, page.text
    question = page.headers["Location"]
    await anna.post(question)
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", (await anna.get(question)).text))


async def test_bits_and_values_that_are_none_are_shown(anna, device):
    await anna.post(f"{PAGE}/points")
    assert heard(device) == ["03 00 02 00 01", "03 00 04 00 02", "03 00 08 00 01", "04 00 0C 00 01"]
    page = (await anna.get(PAGE)).text
    shown = rows(page)
    assert shown["pump"] == ["holding 8.3 (40009.3)", "1", ""]
    assert shown["mode"] == ["holding 8.4-6 (40009.4-6)", "eco", ""]
    assert shown["step"] == ["holding 8.8-15 (40009.8-15)", "7", ""]
    assert shown["flow"] == ["input 12 (30013)", "–", "m³/h"]  # noqa: RUF001
    assert "No value: the device says so, or the registers hold no number." in page
    assert shown["power"] == ["holding 4 (40005)", "12.3", "W"]


async def test_the_forms_offer_what_can_be_written(anna):
    page = (await anna.get(PAGE)).text
    assert re.findall(r"<option>(\w+)", form(page, "pump")) == ["off", "on"]
    assert re.findall(r"<option>(\w+)", form(page, "mode")) == ["off", "eco"]
    assert form(page, "step") == ""
    assert form(page, "flow")
    assert 'type="number" step="any" min="10.0" max="20.0"' in form(page, "limit")
    assert 'type="number"' not in form(page, "power")
    Markup(page)


async def test_bits_are_written_and_the_others_stay(anna, device):
    page = await written(anna, "pump", "off")
    assert "pump holding 8.3 (40009.3) 1 → 0 0" in page
    assert "Function 22 (mask write), request 16 00 08 FF F7 00 00" in page
    assert device.holding[8] == 0x0720
    assert "mode holding 8.4-6 (40009.4-6) eco → off off" in await written(anna, "mode", "off")
    assert device.holding[8] == 0x0700


async def test_who_may_not_use_function_22_finds_no_form_for_bits(tmp_path, device):
    async with web_bench(CONFIG + NOT_TO_22, tmp_path) as bench:
        bench.inner.attach("hall", SimulatedLine("rtu", device))
        browser = bench.browser()
        await browser.log_in("anna")
        page = (await browser.get(PAGE)).text
        assert (form(page, "pump"), bool(form(page, "limit"))) == ("", True)
        assert (await browser.post(f"{PAGE}/writes", {"point": "pump", "value": "on"})).status == 403


async def test_an_input_is_written_where_its_point_says(anna, device):
    page = await written(anna, "flow", "2.5")
    assert "– → 2.5 m³/h – differs" in page  # noqa: RUF001
    assert device.holding[15] == 25


async def test_a_value_beyond_the_limits_is_refused_before_anything_is_asked(anna, device):
    page = await anna.post(f"{PAGE}/writes", {"point": "limit", "value": "20.5"})
    assert page.status == 422
    assert "20.5 is too high: limit must be 10 to 20" in page.text
    assert heard(device) == []


async def test_the_scale_is_that_of_the_moment_of_the_write(anna, device):
    page = await anna.post(f"{PAGE}/writes", {"point": "power", "value": "25"})
    question = page.headers["Location"]
    assert "request 06 00 04 00 FA" in (await anna.get(question)).text
    device.holding[5] = 0
    await anna.post(question)
    assert device.holding[4] == 25
    assert "request 06 00 04 00 19" in (await anna.get(question)).text


async def test_without_a_scale_nothing_is_asked_and_nothing_is_written(anna, device):
    page = await anna.post(f"{PAGE}/writes", {"point": "power", "value": "25"})
    question, device.holding[5] = page.headers["Location"], 0x8000
    await anna.post(question)
    shown = (await anna.get(question)).text
    assert "Not written" in shown
    assert "the device has no scale for power now" in shown
    page = await anna.post(f"{PAGE}/writes", {"point": "power", "value": "25"})
    assert (page.status, device.holding[4]) == (422, 123)
    device.silent = True
    page = await anna.post(f"{PAGE}/writes", {"point": "power", "value": "25"})
    assert page.status == 504


async def test_programs_are_told_the_bits_and_that_there_is_no_value(anna, device):
    values = {each["point"]: each for each in (await anna.get("/api/v1/units/41/points")).json["values"]}
    assert values["mode"] == {
        "point": "mode", "area": "holding", "address": 8, "reference": "40009", "bits": [4, 6], "value": "eco",
        "registers": [0x0728],
    }  # fmt: skip
    assert (values["flow"]["value"], values["flow"]["registers"]) == (None, [0x8000])
    assert "bits" not in values["limit"]


async def test_the_grid_of_an_image_names_the_bits_of_a_register(bench, anna):
    await bench.inner.client().asks(200, "10 00 04 00 02 04 00 7B FF FF")
    page = (await anna.get("/images/copy")).text
    assert re.search(r'<td data-at="8"[^>]*title="pump \.3, mode \.4-6, step \.8-15"', page)
    assert re.search(r'<td data-at="7"(?![^>]*title)', page)
    page = await anna.post("/units/copy/writes", {"point": "mode", "value": "eco"})
    await anna.post(page.headers["Location"])
    page = (await anna.get("/images/copy")).text
    assert re.search(r'<td data-at="8"[^>]*title="pump \.3, mode \.4-6, step \.8-15 · web:anna@127.0.0.1">32<', page)
    assert rows(page)["mode"] == ["holding 8.4-6 (40009.4-6)", "eco", ""]
    assert rows(page)["power"] == ["holding 4 (40005)", "12.3", "W"]


async def test_values_by_address_are_in_registers_of_four_bytes(tmp_path, device):
    wide = CONFIG.replace("functions = [3, 4, 6, 16, 22]", 'wide = { holding = "100-119" }')
    wide = wide.replace('holding = "0-19"\nprofile = "boiler"', 'holding = "0-19"')
    async with web_bench(wide, tmp_path) as bench:
        bench.inner.attach("hall", SimulatedLine("rtu", device))
        anna = bench.browser()
        await anna.log_in("anna")
        response = with_crc(bytes.fromhex("01 03 08 00 01 11 70 00 00 00 07"))
        device.script.extend([[(0.01, response)]] * 2)
        page = (await anna.get(f"{PAGE}/values?area=holding&start=100&count=2&type=&swap=none")).text
        assert re.findall(r'<td class="number">(\d+)</td>', page) == ["70000", "7"]
        fields = {"area": "holding", "address": "100", "value": "70000 8", "type": "", "swap": "none"}
        page = await anna.post(f"{PAGE}/writes", fields)
        page = (await anna.get(page.headers["Location"])).text
        assert "request 10 00 64 00 02 08 00 01 11 70 00 00 00 08" in page
