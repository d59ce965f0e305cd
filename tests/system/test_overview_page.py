"""The overview and the plot of a line in a real browser, on the page of the demo: what a script adds to them."""

import re
import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from types import SimpleNamespace
from typing import Any
from urllib.parse import urlsplit

import pytest

from gateway.cli.demo.past import STOPPED
from gateway.timing.history import UNIT_SLOTS
from kit.chromium import NEEDS_BROWSER
from kit.process import PATIENCE

pytestmark = NEEDS_BROWSER
TIME = r"\d\d:\d\d\D*"
NUMBERS = re.compile(
    rf"^silo-1, {TIME}\N{{EN DASH}}{TIME}: \d+ requests?\b.* · answer in [\d.]+ ms on average, [\d.]+ % of the limit"
)


@pytest.fixture
def seen(address: str, browser: Any) -> Iterator[SimpleNamespace]:
    """A page, what it asks for, and what it complains of."""
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    seen = SimpleNamespace(page=page, complaints=[], hosts=set())
    page.on("console", lambda message: seen.complaints.append(message.text))
    page.on("pageerror", lambda error: seen.complaints.append(str(error)))
    page.on("request", lambda request: seen.hosts.add(urlsplit(request.url).netloc))
    yield seen
    page.close()
    assert seen.complaints == []
    assert seen.hosts == {urlsplit(address).netloc}


def until(page: Any, is_so: Callable[[], Any]) -> Any:
    """What `is_so` says once it says something."""
    end = time.monotonic() + PATIENCE
    while not (found := is_so()):
        assert time.monotonic() < end
        page.wait_for_timeout(200)
    return found


def shown_row(page: Any) -> Any:
    """The row of a unit that has answered since the demo began."""
    row = page.locator("tr[data-unit=silo-1]")
    until(page, lambda: row.locator("path.fine").count() == 1)
    return row


def width_of(picture: Any) -> float:
    """Its width in pixels; it has none while its table is made anew."""
    return float(until(picture.page, picture.bounding_box)["width"])


def point(row: Any, from_right: float) -> None:
    """Point at a place in the picture of a row, so many pixels from its right edge."""
    picture = row.locator("svg.map")
    picture.hover(position={"x": width_of(picture) - from_right, "y": 5}, force=True)


def point_until(page: Any, row: Any, from_right: float, is_told: Callable[[str], object]) -> None:
    """Point at a place until its numbers are told: the table moves when something above it is drawn or made anew."""

    def is_so() -> object:
        page.mouse.move(0, 0)
        point(row, from_right)
        return is_told(reading(page))

    until(page, is_so)


def reading(page: Any) -> str:
    return page.locator("[data-reading]").inner_text()


def test_pointing_at_a_column_tells_its_numbers(seen: SimpleNamespace, address: str) -> None:
    page = seen.page
    page.goto(address)
    row = shown_row(page)
    until(page, lambda: reading(page).startswith("Point at a place"))
    point_until(page, row, 1, NUMBERS.match)
    assert row.locator("rect.mark").get_attribute("x") == "143"
    gap = width_of(row.locator("svg.map")) * STOPPED.ago / UNIT_SLOTS
    point_until(page, row, gap, lambda told: told.endswith(": the gateway did not run"))


def test_the_numbers_stay_when_the_page_is_made_anew(seen: SimpleNamespace, address: str) -> None:
    page = seen.page
    page.goto(address)
    point_until(page, shown_row(page), 1, NUMBERS.match)
    page.locator("[data-reading]").evaluate("(each) => each.dataset.old = 1")
    until(page, lambda: page.locator("[data-reading][data-old]").count() == 0)
    until(page, lambda: NUMBERS.match(reading(page)) is not None)
    assert page.locator("rect.mark").count() == 1


def test_the_keyboard_tells_the_same(seen: SimpleNamespace, address: str) -> None:
    page = seen.page
    page.goto(address)
    link = shown_row(page).get_by_role("link", name="silo-1")

    def tells_the_last_slot() -> bool:
        link.focus()  # again: the server makes the table anew now and then
        page.keyboard.press("ArrowRight")
        return NUMBERS.match(reading(page)) is not None

    until(page, tells_the_last_slot)
    for _ in range(STOPPED.ago):
        page.keyboard.press("ArrowLeft")
    until(page, lambda: reading(page).endswith(": the gateway did not run"))


def test_a_unit_leads_to_its_page(seen: SimpleNamespace, address: str) -> None:
    seen.page.goto(address)
    shown_row(seen.page).get_by_role("link", name="silo-1").click()
    seen.page.wait_for_url("**/units/silo-1")


def test_the_busy_share_is_drawn_over_a_day_and_a_week(seen: SimpleNamespace, address: str) -> None:
    page = seen.page
    until(page, lambda: is_drawn(page, f"{address}/lines/hall", "figure.busy + details tbody tr"))
    plot = page.locator("figure.busy canvas")
    until(page, lambda: plot.count() == 1)
    day = page.get_by_role("button", name="24 hours")
    assert day.get_attribute("aria-pressed") == "true"
    page.get_by_role("button", name="7 days").click()
    until(page, lambda: day.get_attribute("aria-pressed") == "false")
    page.locator("summary").first.click()
    assert page.locator("figure.busy + details tbody tr").first.is_visible()


def test_without_javascript_both_pictures_are_there(browser: Any, address: str) -> None:
    page = browser.new_page(java_script_enabled=False)
    until(page, lambda: is_drawn(page, address, "tr[data-unit=silo-1] svg.map path"))
    until(page, lambda: is_drawn(page, f"{address}/lines/hall", "figure.busy svg.busy path"))
    page.close()


def is_drawn(page: Any, address: str, picture: str) -> bool:
    """Whether a page comes with a picture, which needs a unit that has answered."""
    page.goto(address)
    return page.locator(picture).count() > 0


def test_on_a_desk_every_column_is_whole_and_times_stand_apart(seen: SimpleNamespace, address: str) -> None:
    seen.page.goto(address)
    shown_row(seen.page)
    cut = "[...document.querySelectorAll('section')].filter((each) => each.scrollWidth > each.clientWidth).length"
    until(seen.page, lambda: seen.page.evaluate(cut) == 0)  # a busy machine may still be drawing
    text = (
        "(each) => { const range = new Range(); range.selectNodeContents(each); return range.getBoundingClientRect(); }"
    )
    shown = "[...document.querySelectorAll('th .ticks span')].filter((each) => each.checkVisibility())"
    places = seen.page.evaluate(f"{shown}.map({text}).map((each) => [each.top, each.left, each.right])")
    assert len(places) > 3
    pairs = [(one, other) for one, other in pairwise(places) if one[0] == other[0]]
    assert all(other[1] - one[2] > 4 for one, other in pairs if other[1] > one[1])
