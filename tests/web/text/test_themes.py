"""Light or dark: what the address, the cookie and the visitor's system want."""

import pytest

from gateway.web.text.themes import COOKIE
from kit.browser import web_bench

CONFIG = """
[[line]]
name = "hall"
port = "/dev/hall"
devices = [{ unit = 1, name = "silo" }]
"""


@pytest.fixture
async def browser(tmp_path):
    async with web_bench(CONFIG, tmp_path) as bench:
        yield bench.browser()


def dark_applies_to(page) -> str:
    """For which media the page applies the dark colours."""
    link = next(line for line in page.text.splitlines() if "dark.css" in line)
    return link.partition('media="')[2].partition('"')[0]


async def test_the_system_decides_until_somebody_chooses_and_the_choice_is_kept(browser):
    assert dark_applies_to(await browser.get("/")) == "(prefers-color-scheme: dark)"
    assert COOKIE not in browser.cookies
    assert dark_applies_to(await browser.get("/?theme=dark")) == "all"
    assert browser.cookies[COOKIE] == "dark"
    page = await browser.get("/health")
    assert dark_applies_to(page) == "all"
    assert '<meta name="color-scheme" content="dark">' in page.text
    assert dark_applies_to(await browser.get("/?theme=light")) == "not all"
    assert dark_applies_to(await browser.get("/?theme=auto")) == "(prefers-color-scheme: dark)"


@pytest.mark.parametrize("theme", ["", "blue", '"><script>'])
async def test_a_theme_that_there_is_not_changes_nothing(browser, theme):
    assert dark_applies_to(await browser.get(f"/?theme={theme}")) == "(prefers-color-scheme: dark)"
    assert browser.cookies == {}


async def test_a_page_leads_to_itself_in_the_other_themes(browser):
    page = await browser.get("/traffic?line=hall&theme=dark")
    assert '<a href="/traffic?line=hall&amp;theme=light"' in page.text
    assert '<a href="/traffic?line=hall&amp;theme=dark" aria-current="true"' in page.text


async def test_a_panel_has_the_theme_of_its_address(browser):
    assert dark_applies_to(await browser.get("/?kiosk&theme=dark")) == "all"
