"""The line strip in a real browser, on the page of the demo."""

import re
from collections.abc import Iterator
from typing import Any

import pytest

from kit.chromium import MOVING, NEEDS_BROWSER, renew, until, watched

pytestmark = NEEDS_BROWSER


@pytest.fixture
def page(browser: Any) -> Iterator[Any]:
    with watched(browser, viewport={"width": 1000, "height": 900}, **MOVING) as page:
        yield page


def test_the_strip_shows_transactions_as_they_come(page: Any, address: str) -> None:
    page.goto(f"{address}/lines/hall")
    rows = page.locator("table[data-trace] tbody tr")
    wait_for_rows(page)
    first = rows.first.inner_text()
    until(page, lambda: rows.first.inner_text() != first)
    until(page, lambda: drawn(page) > 1000)
    until(page, lambda: re.search(r"[\d.]+ requests/s", page.locator(".summary").inner_text()))
    until(page, lambda: "73 drive-73" in page.locator(".legend:not(.heat)").inner_text())


def wait_for_rows(page: Any) -> None:
    until(page, lambda: "read holding" in page.locator("table[data-trace]").inner_text())


def drawn(page: Any) -> int:
    """How many pixels of the strip have the colours of units."""
    return page.evaluate("""() => {
        const canvas = document.querySelector("figure.strip .plot > canvas");
        const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
        let count = 0;
        for (let at = 0; at < data.length; at += 4) {
            const [most, least] = [Math.max(...data.slice(at, at + 3)), Math.min(...data.slice(at, at + 3))];
            if (data[at + 3] > 200 && most - least > 90) count++;
        }
        return count;
    }""")


def test_a_transaction_is_reached_by_keyboard_and_its_frames_are_decoded(page: Any, address: str) -> None:
    page.goto(f"{address}/lines/silo")
    wait_for_rows(page)
    page.wait_for_timeout(1500)
    page.locator("figure.strip .plot > canvas").focus()  # another plot may be there before it

    def is_decoded() -> bool:
        page.keyboard.press("ArrowLeft")  # again: on a busy machine some get no answer
        text = page.locator(".detail").inner_text()
        parts = ("read holding 0-1", "00 02\ncount 2", "C4 0B\nCRC", "45 9C 3D 51", "FE 7D\nCRC", "limit")
        return all(each in text for each in parts)

    until(page, is_decoded)
    page.get_by_role("button", name="Live").wait_for()
    page.keyboard.press("End")
    page.get_by_role("button", name="Pause").wait_for()


def test_it_is_pointed_at_paused_and_zoomed(page: Any, address: str) -> None:
    page.goto(f"{address}/lines/hall")
    wait_for_rows(page)
    page.wait_for_timeout(3000)
    page.get_by_role("button", name="Pause").click()
    box = page.locator("figure .plot > canvas").bounding_box()
    for x in range(int(box["width"]) - 4, 100, -3):
        page.mouse.move(box["x"] + x, box["y"] + 90)
        if "read holding" in page.locator(".detail").inner_text():
            break
    page.mouse.click(box["x"] + x, box["y"] + 90)
    page.mouse.move(5, 5)
    assert "read holding" in page.locator(".detail").inner_text()
    spans(page, "10 s")
    page.get_by_role("button", name="Zoom in").click()
    spans(page, "5 s")
    page.mouse.move(box["x"] + 500, box["y"] + 90)
    page.mouse.wheel(0, 300)
    spans(page, "6.3 s")


def spans(page: Any, time: str) -> None:
    """Wait until the strip shows so much."""
    until(page, lambda: page.locator(".controls .span").inner_text() == time)


def test_fingers_move_and_pinch_it(browser: Any, address: str) -> None:
    with watched(browser, has_touch=True, viewport={"width": 800, "height": 900}) as page:
        page.goto(f"{address}/lines/hall")
        wait_for_rows(page)
        box = page.locator("figure .plot > canvas").bounding_box()
        send = page.context.new_cdp_session(page).send

        def touch(kind: str, *places: float) -> None:
            points = [{"x": box["x"] + x, "y": box["y"] + 100, "id": finger} for finger, x in enumerate(places)]
            send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

        span = page.locator(".controls .span")
        spans(page, "10 s")
        page.get_by_role("button", name="Pause").wait_for()
        touch("touchStart", 300)
        for x in range(300, 500, 20):
            touch("touchMove", x)
        touch("touchEnd")
        page.get_by_role("button", name="Live").wait_for()
        touch("touchStart", 300, 400)
        for x in range(0, 100, 10):
            touch("touchMove", 300 - x, 400 + x)
        touch("touchEnd")
        until(page, lambda: 3 < float(span.inner_text().removesuffix(" s")) < 4.5)


def test_keys_move_it(page: Any, address: str) -> None:
    page.goto(f"{address}/lines/hall")
    wait_for_rows(page)
    page.locator("figure.strip .plot > canvas").focus()  # another plot may be there before it
    page.keyboard.press("PageUp")
    page.get_by_role("button", name="Live").wait_for()
    page.keyboard.press("+")
    spans(page, "5 s")
    page.keyboard.press(" ")
    page.get_by_role("button", name="Pause").wait_for()


def test_each_line_of_the_overview_has_a_strip_that_outlives_the_renewal(page: Any, address: str) -> None:
    page.goto(address)
    until(page, lambda: page.locator("figure.strip canvas").count() == 8)
    page.evaluate("document.querySelector('figure.strip canvas').id = 'kept'")
    page.evaluate("document.querySelector('h2#lines').parentElement.id = 'old'")
    renew(page)
    until(page, lambda: page.locator("#old").count() == 0)
    assert page.locator("#kept").count() == 1


def test_without_javascript_the_last_transactions_are_there(address: str, browser: Any) -> None:
    context = browser.new_context(java_script_enabled=False)
    page = context.new_page()

    def has_rows() -> bool:
        page.goto(f"{address}/lines/silo")
        return page.locator("table[data-trace] tbody tr").count() > 3

    until(page, has_rows)
    assert "read holding 0-1" in page.locator("table[data-trace]").inner_text()
    assert page.locator("figure.strip").is_hidden()
    context.close()
