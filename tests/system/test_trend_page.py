"""The trend of a point in a real browser, on the page of a unit of the demo, whose day is made up."""

from typing import Any

from kit.chromium import NEEDS_BROWSER, axe_findings, renew, until, until_scripts_run, watched

pytestmark = NEEDS_BROWSER


def spans(page: Any) -> list[str]:
    return page.locator("#trend a[aria-current]").all_inner_texts()


def test_hours_and_points_are_chosen_without_leaving_the_place(browser: Any, address: str) -> None:
    with watched(browser, viewport={"width": 1280, "height": 900}) as page:
        page.goto(f"{address}/units/silo-1?trend=weight#trend")
        until_scripts_run(page)
        until(page, lambda: page.locator("#trend .uplot canvas").count() == 1)
        assert axe_findings(page) == []
        page.get_by_role("link", name="hour", exact=True).click()
        until(page, lambda: spans(page) == ["hour"])
        assert "span=hour" in page.url
        renew(page)
        assert page.locator("#trend .uplot canvas").count() == 1
        page.locator("#trend").get_by_label("Point").select_option("baud")
        until(page, lambda: "Trend of baud" in page.locator("#trend-title").inner_text())
        until_scripts_run(page)
        assert spans(page) == ["hour"]


def test_without_javascript_there_is_a_picture_and_a_table(browser: Any, address: str) -> None:
    with watched(browser, java_script_enabled=False, viewport={"width": 390, "height": 844}) as page:
        page.goto(f"{address}/units/silo-1?span=hour")
        assert page.locator("#trend svg path.mean").get_attribute("d")
        page.locator("#trend-table summary").click()
        assert "4999.66" in page.locator("#trend-table tbody tr").first.inner_text()
        page.get_by_role("link", name="day", exact=True).click()
        assert spans(page) == ["day"]
