"""The page of the sites of a fleet."""

import csv
from dataclasses import replace

import pytest

from gateway.errors import FleetError
from kit.browser import web_bench
from kit.markup import Markup
from kit.sites import INVENTORY, TO_FIX, site

CONFIG = """
site = "control"
[[listen]]
bind = "tcp://127.0.0.1:5020"
[[image]]
unit = 1
holding = 1
"""


FLEET = """
[fleet]
servers = ["nats://127.0.0.1:4222"]

[[upstream]]
name = "north"
to = "fleet://north"
units = [{ unit = 21, name = "north-pump" }, { unit = 22, name = "north-fan" }]

[[upstream]]
name = "office"
to = "tcp://127.0.0.1:5029"
units = [{ unit = 31, name = "office-fan" }]
"""


@pytest.fixture
async def bench(tmp_path):
    async with web_bench(CONFIG, tmp_path) as bench:
        yield bench


@pytest.fixture
def fleet(bench, monkeypatch):
    found = []

    async def sites(_kept):
        return found

    monkeypatch.setattr(bench.running.add_ons.fleet, "sites", sites)
    return found


async def page(bench, address="/sites"):
    shown = await bench.browser().get(address)
    assert shown.status == 200
    return shown.text


async def test_all_sites_are_listed_those_that_are_not_fine_first(bench, fleet):
    fleet += [site("east"), site("north", state="lost", lines_down=("hall",)), site("west", inventory=None)]
    rows = [" | ".join(row).replace("\u2013", "-") for row in Markup(await page(bench)).rows()]
    assert rows[-3:] == [
        "north | lost | 90 s | 2 · down: hall | 7 | - | 2027-05-01 | 634c3833bedd | 0.1.0 | gw-north",
        "east | up | 90 s | 2 | 7 | - | 2027-05-01 | 634c3833bedd | 0.1.0 | gw-east",
        "west | up | 90 s | 2 | 7 | - | - | - | 0.1.0 | gw-west",
    ]


async def test_it_says_how_many_are_in_trouble_and_finds_those_with_another_config(bench, fleet):
    fleet += [site("east"), site("west", inventory=TO_FIX), site("old", inventory=replace(INVENTORY, config="0ld"))]
    text = await page(bench)
    assert '<span class="state up">3 up</span>' in text
    assert "1 with something to fix" in text
    assert '<a href="/sites?find.all=0ld">0ld</a> \u00d7 1' in text


async def test_one_site_is_shown_with_all_that_it_tells(bench, fleet):
    fleet += [site("east"), site("west", inventory=TO_FIX)]
    text = await page(bench, "/sites?site=west")
    rows = [" | ".join(row) for row in Markup(text).rows()]
    assert "unit silo | does not answer <now>" in rows
    assert "hall | /dev/serial/by-id/usb-FTDI-if00 | ftdi_sio | 0403:6001" in rows
    assert "scada | certificate | 2027-05-01" in rows
    assert "config 634c3833bedd, in use since 2026-05-01T12:00:00Z" in text
    assert "<now>" not in text


async def test_what_expires_soon_stands_out(bench, fleet):
    soon = replace(INVENTORY, certificates=(replace(INVENTORY.certificates[0], until="2026-05-20"),))
    fleet += [site("east", inventory=soon)]
    assert '<span class="state failing">2026-05-20</span>' in await page(bench)


async def test_five_hundred_sites_are_a_light_page(bench, fleet):
    fleet += [site(f"plant-{number}") for number in range(500)]
    assert len(await page(bench)) < 160_000


async def test_they_come_as_a_file_for_spreadsheets_and_to_programs(bench, fleet):
    fleet += [site("east")]
    (row,) = csv.DictReader((await page(bench, "/sites.csv")).removeprefix("\ufeff").splitlines())
    assert row["site"] == "east"


async def test_sites_that_are_not_known_say_why(bench):
    assert "The sites of the fleet are not known:" in await page(bench)
    assert (await bench.browser().get("/sites.csv")).status == 503


async def test_programs_get_them_from_the_api_with_the_right_to_read(bench, monkeypatch):
    async def sites():
        return (site("east"),)

    monkeypatch.setattr(bench.running.add_ons.fleet, "sites", sites)
    (east,) = (await bench.browser().get("/api/v1/fleet")).json["sites"]
    assert (east["site"], east["inventory"]["config"]) == ("east", INVENTORY.config)
    assert east["inventory"]["adapters"][0]["driver"] == "ftdi_sio"

    async def unknown():
        raise FleetError("no NATS")

    monkeypatch.setattr(bench.running.add_ons.fleet, "sites", unknown)
    assert "no NATS" in (await bench.browser().get("/api/v1/fleet")).problem


async def test_without_a_fleet_no_page_leads_there(bench):
    assert 'href="/sites"' not in await page(bench, "/")


async def test_on_the_overview_a_site_is_one_row_with_its_units_counted(tmp_path):
    """A control room may have hundreds."""
    async with web_bench(CONFIG + FLEET, tmp_path) as bench:
        text = await page(bench, "/")
    rows = [row for row in Markup(text).rows() if row[0] in ("north", "north-pump 21", "office", "office-fan 31")]
    assert [row[0] for row in rows] == ["office-fan 31", "north", "office"]
    assert rows[1][2:] == ["0/2", "0.0", "0"]
    assert 'data-line="office"' in text
    assert 'data-line="north"' not in text
