"""The page of the events in a browser: in the browser's own time, fresh, and with its choices kept."""

from datetime import datetime
from typing import Any
from zoneinfo import ZoneInfo

import pytest

from kit.chromium import NEEDS_BROWSER, renew, until, until_scripts_run, watched

pytestmark = NEEDS_BROWSER
ZONE = "Asia/Shanghai"


@pytest.fixture
def page(browser: Any, address: str) -> Any:
    with watched(browser, timezone_id=ZONE) as page:
        page.goto(f"{address}/events")
        until_scripts_run(page)
        yield page


def times(page: Any) -> list[tuple[str, str, str]]:
    """Each time: what is shown, its title, and what machines read."""
    return page.locator("main time").evaluate_all(
        "all => all.map((each) => [each.textContent, each.title, each.dateTime])"
    )


def as_there(text: str) -> str:
    return f"{datetime.fromisoformat(text).astimezone(ZoneInfo(ZONE)):%Y-%m-%d %H:%M:%S}"


def test_times_are_those_of_the_browser_and_stay_so(page: Any) -> None:
    for _ in range(2):
        found = times(page)
        assert len(found) > 5
        assert all(shown == as_there(exact) and title == exact for shown, title, exact in found)
        page.locator("h1").evaluate("(each) => each.dataset.old = 1")
        renew(page)
        until(page, lambda: page.locator("h1[data-old]").count() == 0)


def test_a_choice_outlives_a_renewal_and_is_in_the_address(page: Any) -> None:
    page.locator("select[name=level]").select_option("warning")
    page.locator("h1").evaluate("(each) => each.dataset.old = 1")
    renew(page)
    until(page, lambda: page.locator("h1[data-old]").count() == 0)
    assert page.locator("select[name=level]").input_value() == "warning"
    page.locator("form.choices button").click()
    until(page, lambda: "level=warning" in page.url)
    assert page.locator(".events td:nth-child(2)").all_inner_texts()
    assert set(page.locator(".events td:nth-child(2) .state").all_inner_texts()) <= {"warning", "error"}


def test_what_is_wrong_stands_above_and_says_since_when(page: Any) -> None:
    until(page, lambda: (page.reload(), page.locator(".wrong tr", has_text="resting").count() > 0)[1])
    assert page.locator(".wrong tr", has_text="resting").first.locator("time").count() == 1
