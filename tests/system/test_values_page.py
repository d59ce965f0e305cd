"""The page of all values in a real browser, on that of the demo: what is typed and opened stays while it is renewed."""

from collections.abc import Iterator
from typing import Any

import pytest

from kit.chromium import NEEDS_BROWSER, renew, until, until_scripts_run, watched

pytestmark = NEEDS_BROWSER


@pytest.fixture
def page(browser: Any, address: str) -> Iterator[Any]:
    with watched(browser, viewport={"width": 1280, "height": 900}) as page:
        page.goto(f"{address}/values")
        until_scripts_run(page)
        yield page


def names(page: Any) -> list[str]:
    """The points that are shown, of all devices."""
    return [name for name in page.locator("details[open] tr[data-point] th").all_inner_texts() if name]


def open_ones(page: Any) -> list[str]:
    return page.locator("details[open]").evaluate_all("all => all.map((each) => each.dataset.device)")


def age(page: Any) -> str:
    return page.locator("details[data-device=silo-1] tr[data-point=baud] td").nth(3).inner_text()


def weight(page: Any) -> str:
    return page.locator("details[data-device=dock-1] tr[data-point=weight]").inner_text()


def test_what_is_typed_is_searched_and_stays_while_values_are_renewed(page: Any) -> None:
    field = page.get_by_role("searchbox")
    field.type("SILO-1 b")
    until(page, lambda: names(page) == ["baud"])
    assert "search=SILO-1+b" in page.url
    assert "1 point" in page.locator("p.found").inner_text()
    before = age(page)
    renew(page)
    until(page, lambda: age(page) != before)
    assert (field.input_value(), names(page)) == ("SILO-1 b", ["baud"])
    assert field.evaluate("field => document.activeElement === field")
    field.fill("")
    until(page, lambda: len(names(page)) > 100)
    assert "search" not in page.url


def test_a_device_that_is_opened_or_folded_stays_so_and_the_page_does_not_scroll(page: Any) -> None:
    assert "silo-1" in open_ones(page)
    assert "axis-2" not in open_ones(page)  # for which there was no room
    page.evaluate("scrollTo(0, document.body.scrollHeight)")
    page.locator("details[data-device=axis-2] summary").click()
    until(page, lambda: page.locator("details[data-device=axis-2] tr[data-point]").count() == 131)
    page.locator("details[data-device=silo-1] summary").click()
    until(page, lambda: page.locator("details[data-device=silo-1] tr[data-point]").count() == 0)
    place, opened = page.evaluate("scrollY"), open_ones(page)
    assert "axis-2" in opened
    assert "silo-1" not in opened
    before = weight(page)
    renew(page)
    until(page, lambda: weight(page) != before)
    assert (page.evaluate("scrollY"), open_ones(page)) == (place, opened)
    page.reload()
    assert open_ones(page) == opened


def test_rows_that_were_sorted_stay_so_while_values_are_renewed(page: Any) -> None:
    page.get_by_role("searchbox").fill("silo-1")
    until(page, lambda: names(page) == ["weight", "baud", "address"])
    page.get_by_role("button", name="Point").click()
    assert names(page) == ["address", "baud", "weight"]
    before = age(page)
    renew(page)
    until(page, lambda: age(page) != before)
    assert names(page) == ["address", "baud", "weight"]


def test_without_javascript_devices_are_opened_by_links(browser: Any, address: str) -> None:
    with watched(browser, java_script_enabled=False) as page:
        page.goto(f"{address}/values")
        page.locator("details[data-device=axis-2] summary").click()
        page.locator("details[data-device=axis-2]").get_by_role("link", name="Show its values").click()
        assert page.locator("details[data-device=axis-2] tr[data-point]").count() == 131
        page.get_by_role("searchbox").fill("weight")
        page.get_by_role("button", name="Show").click()
        assert set(names(page)) == {"weight"}


def test_the_csv_is_a_file_with_what_was_searched(page: Any) -> None:
    page.get_by_role("searchbox").fill("weight")
    until(page, lambda: "search=weight" in (page.get_by_role("link", name="CSV").get_attribute("href") or ""))
    with page.expect_download() as download:
        page.get_by_role("link", name="CSV").click()
    text = download.value.path().read_text(encoding="utf-8-sig")
    head, *rows = text.splitlines()
    assert head == "device,point,value,unit,state,age,source,time"
    assert rows
    assert all(row.split(",")[1] == "weight" for row in rows)
