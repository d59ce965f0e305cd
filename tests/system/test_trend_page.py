"""The trend of a point in a real browser, on the page of a unit of the demo, whose day is made up."""

from datetime import UTC, datetime, timedelta
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


#: How many of the pixels are painted in the colour of the line, between the axes.
LINE = """canvas => {
  const accent = getComputedStyle(document.documentElement).getPropertyValue("--accent").trim();
  const [red, green, blue] = [1, 3, 5].map((at) => parseInt(accent.slice(at, at + 2), 16));
  const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  let count = 0;
  for (let at = 0; at < data.length; at += 4)
    if ([red, green, blue].every((each, place) => Math.abs(each - data[at + place]) < 10)) count++;
  return count;
}"""


def test_a_slot_between_gaps_is_drawn(browser: Any, address: str) -> None:
    """A point that is polled every five minutes has a value in each fifth slot."""
    now = datetime.now(UTC).replace(second=0, microsecond=0)
    times = [(now - timedelta(minutes=each)).isoformat() for each in (20, 15, 10)]
    slots = [{"time": time, "min": 5.0, "mean": 5.0, "max": 5.0} for time in times]
    with watched(browser, viewport={"width": 1280, "height": 900}) as page:
        page.route("**/history?*", lambda route: route.fulfill(json={"step_s": 60, "slots": slots}))
        page.goto(f"{address}/units/silo-1?trend=weight&span=hour")
        until_scripts_run(page)
        until(page, lambda: page.locator("#trend .uplot canvas").count() == 1)
        until(page, lambda: page.locator("#trend .uplot canvas").evaluate(LINE) >= 3 * 10)


def test_without_javascript_there_is_a_picture_and_a_table(browser: Any, address: str) -> None:
    with watched(browser, java_script_enabled=False, viewport={"width": 390, "height": 844}) as page:
        page.goto(f"{address}/units/silo-1?span=hour")
        assert page.locator("#trend svg path.mean").get_attribute("d")
        page.locator("#trend-table summary").click()
        assert "4999.66" in page.locator("#trend-table tbody tr").first.inner_text()
        page.get_by_role("link", name="day", exact=True).click()
        assert spans(page) == ["day"]
