"""In a real browser, on pages of the demo: their head, tables, the meaning of traffic, and a line over an hour."""

import re
from collections.abc import Iterator
from typing import Any

import pytest

from kit.chromium import NEEDS_BROWSER, renew, until, until_scripts_run, watched

pytestmark = NEEDS_BROWSER


@pytest.fixture
def page(browser: Any) -> Iterator[Any]:
    with watched(browser, viewport={"width": 1280, "height": 900}) as page:
        yield page


def shown(page: Any, address: str) -> Any:
    page.goto(address)
    until_scripts_run(page)
    return page


def column(table: Any, number: int) -> list[str]:
    """The texts of a column, of the rows that are shown."""
    return table.locator("tbody tr:not([hidden])").evaluate_all(
        f"all => all.map((row) => row.cells[{number}].innerText)"
    )


def test_the_head_tells_how_it_is_and_its_clock_goes_on(page, address):
    shown(page, address)
    assert re.fullmatch(r"(ok|\d+ problems?) · Overview · \S.*", page.title())
    facts = page.locator("[data-facts]")
    assert re.match(r"\d+\.\d+\.\d+ · up .+ · \d\d:\d\d:\d\d \S+", facts.inner_text())
    before = page.locator("[data-clock]").inner_text()
    until(page, lambda: page.locator("[data-clock]").inner_text() != before)
    until(page, lambda: page.locator(".apart").inner_text() == "")  # a busy machine may show a page seconds late


def test_a_clock_that_differs_from_the_browsers_is_told(browser, address):
    with watched(browser) as page:
        page.clock.install()
        page.clock.set_fixed_time("2031-01-01T00:00:00Z")
        shown(page, address)
        until(page, lambda: "h behind your clock" in page.locator(".apart").inner_text())


def test_a_tile_leads_to_where_it_is_explained(page, address):
    shown(page, address)
    until(page, lambda: re.match(r"\d+/\d+\n", page.locator("a.tile", has_text="units answering").inner_text()))
    page.locator("a.tile", has_text="clients").click()
    page.wait_for_url("**/clients")


def test_a_table_is_sorted_by_a_click_on_its_head_and_stays_so(page, address):
    shown(page, address)
    table, head = page.locator("table.heat"), page.locator("table.heat thead th", has_text="Unit")
    plain = column(table, 0)
    assert head.get_attribute("aria-sort") is None
    head.get_by_role("button").click()
    assert head.get_attribute("aria-sort") == "ascending"
    assert column(table, 0) == sorted(plain)
    head.get_by_role("button").click()
    assert column(table, 0) == sorted(plain, reverse=True)
    _wait_for_renewal(page, table)
    assert column(table, 0) == sorted(plain, reverse=True)
    page.reload()
    until_scripts_run(page)
    assert column(table, 0) == sorted(plain, reverse=True)
    head.get_by_role("button").click()
    assert sorted(column(table, 0)) == sorted(plain)
    assert "sort" not in page.url


def test_numbers_are_sorted_as_numbers_the_largest_first(page, address):
    shown(page, address)
    page.locator("table.heat thead th", has_text="Requests").get_by_role("button").click()
    numbers = [int(text) for text in column(page.locator("table.heat"), 3)]
    assert numbers == sorted(numbers, reverse=True)


def test_rows_are_found_and_the_table_is_renewed_while_somebody_types(page, address):
    shown(page, address)
    table, field = page.locator("table.heat"), page.get_by_role("searchbox")
    count = len(column(table, 0))
    field.fill("drive")
    names = column(table, 0)
    assert [name.split("-")[0] for name in names] == ["drive"] * 3
    assert "find.units=drive" in page.url
    _wait_for_renewal(page, table)
    assert sorted(column(table, 0)) == sorted(names)
    assert field.evaluate("(each) => each === document.activeElement")
    field.fill("")
    assert len(column(table, 0)) == count > 3
    assert "find" not in page.url


def test_traffic_is_told_in_meanings(page, address):
    shown(page, f"{address}/traffic?line=silo")
    meant = page.locator("tbody tr", has=page.locator("td b", has_text=re.compile(r"^weight \d+\.\d\d$")))
    until(page, lambda: meant.count() > 0)
    meant.locator("summary").last.click()  # new rows come at the top
    until(page, lambda: page.locator(".told .piece small", has_text="weight").count() == 1)


def test_a_line_is_shown_over_an_hour_and_a_day_in_the_place_of_its_last_seconds(page, address):
    shown(page, f"{address}/lines/hall")
    page.get_by_role("button", name="1 h", exact=True).click()
    until(page, lambda: page.locator("table.past tr[data-past-unit]").count() == 5)
    assert not page.locator("figure.strip canvas").first.is_visible()
    page.keyboard.press("ArrowLeft")
    until(page, lambda: re.search(r"busy .* requests", page.locator(".detail").inner_text()))
    assert page.locator("table.past .mark").count() == 6
    page.get_by_role("button", name="24 h", exact=True).click()
    page.wait_for_url("**/lines/hall?span=24h")
    page.keyboard.press("+")
    page.keyboard.press("+")
    until(page, page.locator("figure.strip canvas").first.is_visible)
    assert page.locator("[data-past]").count() == 0
    assert "span" not in page.url


def test_without_javascript_a_line_is_shown_over_an_hour_too(browser, address):
    with watched(browser, java_script_enabled=False) as page:
        page.goto(f"{address}/lines/hall")
        page.get_by_role("link", name="1 h", exact=True).click()
        assert page.locator("table.past tr[data-past-unit] svg").count() == 5


def _wait_for_renewal(page: Any, table: Any) -> None:
    """Wait until the server has made the rows anew."""
    body = table.locator("tbody")
    body.evaluate("(each) => each.dataset.old = 1")
    renew(page)
    until(page, lambda: body.get_attribute("data-old") is None)
