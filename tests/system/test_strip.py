"""The line strip in a real browser, on the page of the demo."""

import re
import time
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from types import SimpleNamespace
from typing import Any
from urllib.parse import urlsplit

import pytest

from kit.chromium import CHROMIUM, MISSING, chromium, demo_page
from kit.process import PATIENCE

pytestmark = pytest.mark.skipif(not CHROMIUM.exists() or find_spec("playwright") is None, reason=MISSING)


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    with demo_page() as address:
        yield address


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as browser:
        yield browser


@pytest.fixture
def seen(address: str, browser: Any) -> Iterator[SimpleNamespace]:
    """A page, what it asks for, and what it complains of."""
    page = browser.new_page(viewport={"width": 1000, "height": 900})
    seen = SimpleNamespace(page=page, complaints=[], hosts=set())
    page.on("console", lambda message: seen.complaints.append(message.text))
    page.on("pageerror", lambda error: seen.complaints.append(str(error)))
    page.on("request", lambda request: seen.hosts.add(urlsplit(request.url).netloc))
    yield seen
    page.close()
    assert seen.complaints == []
    assert seen.hosts == {urlsplit(address).netloc}


def test_the_strip_shows_transactions_as_they_come(seen: SimpleNamespace, address: str) -> None:
    seen.page.goto(f"{address}/lines/hall")
    rows = seen.page.locator("table[data-trace] tbody tr")
    wait_for_rows(seen.page)
    first = rows.first.inner_text()
    until(seen.page, lambda: rows.first.inner_text() != first)
    assert drawn(seen.page) > 1000
    assert re.search(r"[\d.]+ requests/s", seen.page.locator(".summary").inner_text())
    assert "73 drive-73" in seen.page.locator(".legend").inner_text()


def until(page: Any, is_so: Callable[[], bool]) -> None:
    """Wait for what the page shows. (Playwright's own way needs `eval`, which the page forbids.)"""
    end = time.monotonic() + PATIENCE
    while not is_so():
        assert time.monotonic() < end
        page.wait_for_timeout(100)


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


def test_a_transaction_is_reached_by_keyboard_and_its_frames_are_decoded(seen: SimpleNamespace, address: str) -> None:
    page = seen.page
    page.goto(f"{address}/lines/silo")
    wait_for_rows(page)
    page.wait_for_timeout(1500)
    page.locator("figure canvas").first.focus()
    page.keyboard.press("ArrowLeft")
    text = page.locator(".detail").inner_text()
    for each in ("read holding 0-1", "00 02\ncount 2", "C4 0B\nCRC", "45 9C 3D 51", "FE 7D\nCRC", "limit"):
        assert each in text
    assert page.get_by_role("button", name="Live").is_visible()
    page.keyboard.press("End")
    assert page.get_by_role("button", name="Pause").is_visible()


def test_it_is_pointed_at_paused_and_zoomed(seen: SimpleNamespace, address: str) -> None:
    page = seen.page
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
    assert page.locator(".controls .span").inner_text() == "10 s"
    page.get_by_role("button", name="Zoom in").click()
    assert page.locator(".controls .span").inner_text() == "5 s"
    page.mouse.move(box["x"] + 500, box["y"] + 90)
    page.mouse.wheel(0, 300)
    assert page.locator(".controls .span").inner_text() == "6.3 s"


def test_each_line_of_the_overview_has_a_strip_that_outlives_the_renewal(seen: SimpleNamespace, address: str) -> None:
    page = seen.page
    page.goto(address)
    page.wait_for_selector("figure.strip canvas")
    assert page.locator("figure.strip canvas").count() == 7
    page.evaluate("document.querySelector('figure.strip canvas').id = 'kept'")
    page.evaluate("document.querySelector('h2#lines').parentElement.id = 'old'")
    until(page, lambda: page.locator("#old").count() == 0)
    assert page.locator("#kept").count() == 1


def test_without_javascript_the_last_transactions_are_there(address: str, browser: Any) -> None:
    context = browser.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto(f"{address}/lines/silo")
    assert page.locator("table[data-trace] tbody tr").count() > 3
    assert "03 00 00 00 02" in page.locator("table[data-trace]").inner_text()
    assert page.locator("figure.strip").is_hidden()
    context.close()
