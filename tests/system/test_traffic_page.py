"""The pages of traffic, health, clients and config in a real browser, on the page of the demo."""

from collections.abc import Iterator
from typing import Any

import pytest

from kit.chromium import NEEDS_BROWSER, renew, until, watched

pytestmark = NEEDS_BROWSER


@pytest.fixture
def page(browser: Any) -> Iterator[Any]:
    with watched(browser, viewport={"width": 1280, "height": 900}) as page:
        yield page


def rows(page: Any) -> Any:
    return page.locator("table.traffic tbody tr")


def first_row(page: Any) -> str:
    return rows(page).first.inner_text() if rows(page).count() else ""


def all_rows(page: Any) -> list[str]:
    return rows(page).all_inner_texts()


def live(page: Any, path: str) -> Any:
    """The page, once new rows come."""
    page.goto(path)
    before = first_row(page)
    until(page, lambda: first_row(page) != before)
    return page


def test_transactions_come_in_above_and_are_counted(page: Any, address: str) -> None:
    live(page, f"{address}/traffic")
    until(page, lambda: "records/s" in page.locator(".controls output").inner_text())
    before = now = all_rows(page)
    assert len(now) > 10

    def has_moved() -> bool:  # by less than the page shows; two transactions may look alike
        nonlocal before, now
        before, now = now, all_rows(page)
        return any(now[place : place + 5] == before[:5] for place in range(1, len(now)))

    until(page, has_moved)


def test_a_row_opens_to_its_frames_and_the_page_holds_still(page: Any, address: str) -> None:
    live(page, f"{address}/traffic?line=silo&result=ok")
    summary = rows(page).first.locator("summary")
    summary.focus()
    page.keyboard.press("Enter")
    until(page, lambda: page.locator("details[open] .told").count() == 1)
    told = page.locator("details[open] .told").inner_text()
    for each in ("00 02\ncount 2", "C4 0B\nCRC", "limit", "asked at address 1"):
        assert each in told
    assert page.get_by_role("button", name="Live").is_visible()
    before = first_row(page)
    until(page, lambda: "more since then" in page.locator(".controls output").inner_text())
    assert first_row(page) == before
    page.get_by_role("button", name="Live").click()
    until(page, lambda: first_row(page) != before)


def test_a_row_that_the_server_made_opens_to_the_same(page: Any, address: str) -> None:
    page.goto(f"{address}/traffic?line=silo&result=ok")
    page.get_by_role("button", name="Pause").wait_for()
    page.keyboard.press(" ")
    row = page.locator("tr[data-fact]").first
    row.locator("summary").press("Enter")  # a click may meet another row, if these move at that moment
    until(page, lambda: "C4 0B\nCRC" in row.inner_text())


def test_a_row_that_is_opened_before_the_page_is_live_stays_open(page: Any, address: str) -> None:
    scripts: list[Any] = []
    page.route("**/frames.js", lambda route: scripts.append(route))  # noqa: PLW0108 - Playwright takes no built-in
    page.goto(f"{address}/traffic?line=silo&result=ok", wait_until="commit")  # scripts come before it is loaded
    row = page.locator("tr[data-fact]").first
    row.locator("summary").press("Enter")
    assert not page.get_by_role("button", name="Pause").is_visible()
    until(page, lambda: bool(scripts))
    scripts[0].continue_()
    until(page, lambda: "C4 0B\nCRC" in row.inner_text())


def test_the_form_chooses_and_the_address_has_the_choice(page: Any, address: str) -> None:
    live(page, f"{address}/traffic")
    page.locator("select[name=line]").select_option("motion")
    page.locator("select[name=result]").select_option("failed")
    page.get_by_role("button", name="Show").click()
    page.wait_for_url("**/traffic?*line=motion*")
    until(page, lambda: rows(page).count() > 3)
    assert set(page.locator("table.traffic tbody td:nth-child(2)").all_inner_texts()) == {"motion"}
    assert "line=motion" in page.locator("a[download]").get_attribute("href")
    page.get_by_role("link", name="Show all").click()
    page.wait_for_url("**/traffic")


def test_space_pauses(page: Any, address: str) -> None:
    live(page, f"{address}/traffic")
    page.keyboard.press(" ")
    page.get_by_role("button", name="Live").wait_for()
    page.keyboard.press(" ")
    page.get_by_role("button", name="Pause").wait_for()


def test_the_table_is_bounded(page: Any, address: str) -> None:
    live(page, f"{address}/traffic")
    page.evaluate("""() => {
        const body = document.querySelector("table.traffic tbody");
        for (let at = 0; at < 700; at++) body.append(body.rows[0].cloneNode(true));
    }""")
    until(page, lambda: rows(page).count() == 500)


@pytest.mark.parametrize("path", ["/events", "/health", "/clients", "/config"])
def test_a_page_outlives_its_renewal_without_a_complaint(page: Any, address: str, path: str) -> None:
    page.goto(f"{address}{path}?lang=zh")
    heading = page.locator("h1").inner_text()
    page.locator("h1").evaluate("(each) => each.dataset.old = 1")
    renew(page)
    until(page, lambda: page.locator("h1[data-old]").count() == 0)
    assert page.locator("h1").inner_text() == heading
    until(page, lambda: page.locator("main.stale").count() == 0)  # on a busy machine a renewal may be late
    assert page.locator(f'nav a[href="{path}"][aria-current=page]').count() == 1


@pytest.mark.parametrize("path", ["/events", "/traffic", "/health", "/clients", "/config"])
def test_a_page_fits_on_a_phone(address: str, browser: Any, path: str) -> None:
    page = browser.new_page(viewport={"width": 390, "height": 844})
    page.goto(f"{address}{path}")
    page.wait_for_timeout(1500)
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    page.close()


def test_without_javascript_all_of_it_is_there(address: str, browser: Any) -> None:
    context = browser.new_context(java_script_enabled=False)
    page = context.new_page()

    def has_rows() -> bool:
        page.goto(f"{address}/traffic?line=silo&result=ok")
        return rows(page).count() > 3

    until(page, has_rows)
    rows(page).first.locator("summary").click()
    assert "03 00 00 00 02" in rows(page).first.inner_text()
    for path, text in [("/health", "From normal traffic"), ("/clients", "127.0.0.1:"), ("/config", "[[line]]")]:
        page.goto(f"{address}{path}")
        assert text in page.locator("main").inner_text()
    context.close()


def test_rows_of_the_server_and_live_ones_are_written_in_one_way(page: Any, address: str) -> None:
    live(page, f"{address}/traffic?line=hall")
    until(page, lambda: rows(page).count() > 10)
    page.keyboard.press(" ")
    made = page.locator("table.traffic tbody tr").evaluate_all(
        "rows => rows.map((row) => [...row.cells].slice(4, 6).map((cell) => cell.textContent))"
    )
    assert len(made) > 10
    assert not [cells for cells in made if cells[0] == cells[1]]
    assert not [cells for cells in made if cells[1] in ("resting", "queue full")]


#: Those of some cells that are cut off.
CUT_OFF = """cells => cells.filter((each) => {
    return each.scrollWidth > each.clientWidth + 1 || each.getBoundingClientRect().right > innerWidth;
}).map((each) => each.textContent)"""


@pytest.mark.parametrize(
    ("path", "cells"),
    [
        ("/events", ".events td:not(.minor)"),
        ("/traffic", "table.traffic td"),
        ("/lines/hall", "table[data-trace] td"),
        ("/health", ".findings td"),
    ],
)
def test_on_a_phone_no_time_unit_or_cure_is_cut_off(address: str, browser: Any, path: str, cells: str) -> None:
    page = browser.new_page(viewport={"width": 390, "height": 844})
    page.goto(f"{address}{path}")
    page.wait_for_timeout(1500)
    assert page.locator(cells).evaluate_all(CUT_OFF) == []
    page.close()
