"""The overview on a wall panel: what it shows is never old without saying so, and it follows the gateway by itself."""

import re
import signal
from pathlib import Path
from typing import Any

import pytest

from kit.chromium import NEEDS_BROWSER, axe_findings, renew, until, until_scripts_run, watched
from kit.free_port import free_port
from kit.process import GatewayProcess

pytestmark = NEEDS_BROWSER

CONFIG = """
[[listen]]
bind = "tcp://127.0.0.1:0"

[[image]]
unit = 200
holding = 1

[web]
bind = "http://127.0.0.1:{port}"
"""
LINE = """
[[line]]
name = "{line}"
port = "/nowhere/{line}"
devices = [{{ unit = 1, as = {unit} }}]
"""


def config(port: int, *lines: str) -> str:
    return CONFIG.format(port=port) + "".join(LINE.format(line=line, unit=ord(line[0])) for line in lines)


def test_a_panel_says_when_the_gateway_cannot_be_reached_and_comes_back_by_itself(browser: Any, tmp_path: Path) -> None:
    port = free_port()
    page = browser.new_page(color_scheme="dark")
    told = page.get_by_role("alert")
    with GatewayProcess(tmp_path, config(port, "hall")):
        page.goto(f"http://127.0.0.1:{port}/?kiosk&lang=zh")
        assert page.locator("header, nav, footer").count() == 0
        assert page.locator("h1").inner_text() == "概览"
        assert told.count() == 0
        until_scripts_run(page)
    until(page, lambda: told.count() == 1)
    assert re.fullmatch(r"无法连接网关。所示为 \d\d:\d\d:\d\d 的状态。", told.inner_text())
    page.evaluate("window.isOld = true")
    until(page, lambda: "连接中断" in page.locator(".summary").inner_text())
    with GatewayProcess(tmp_path, config(port, "hall")):
        until(page, lambda: told.count() == 0)
        until(page, lambda: "连接中断" not in page.locator(".summary").inner_text())
        assert page.locator("html").get_attribute("lang") == "zh-CN"
        assert page.evaluate("window.isOld && matchMedia('(prefers-color-scheme: dark)').matches")
    page.context.close()


def test_the_links_of_a_panel_lead_to_pages_of_a_panel(browser: Any, tmp_path: Path) -> None:
    port = free_port()
    with GatewayProcess(tmp_path, config(port, "hall")), watched(browser) as page:
        page.goto(f"http://127.0.0.1:{port}/?kiosk")
        until_scripts_run(page)
        page.get_by_role("link", name="hall").first.click()
        page.wait_for_url("**/lines/hall*")
        assert page.locator("h1").inner_text() == "Line hall"
        assert page.locator("header, nav, footer").count() == 0


def renewed_names(page: Any) -> list[str] | None:
    """Those of the lines that are drawn once the page is renewed, None while it is on its way to another."""
    from playwright.sync_api import Error  # noqa: PLC0415 - it is not installed everywhere

    strips = page.locator("figure.strip:has(canvas)")  # a page that is loaded again has no pictures at first
    try:
        renew(page)
        return strips.evaluate_all("all => all.map((each) => each.dataset.line)")
    except Error:
        return None


def test_strips_follow_a_reload(browser: Any, tmp_path: Path) -> None:
    port = free_port()
    with GatewayProcess(tmp_path, config(port)) as gateway, watched(browser) as page:
        page.goto(f"http://127.0.0.1:{port}/")

        def reload(*lines: str) -> None:
            gateway.config.write_text(config(port, *lines))
            gateway.signal(signal.SIGHUP)
            until(page, lambda: renewed_names(page) == list(lines))

        with page.expect_event("load"):  # a page with its first line has other parts
            reload("hall")
        reload("press", "hall")
        page.evaluate("document.querySelectorAll('figure.strip canvas')[1].id = 'kept'")
        reload("silo", "press", "hall", "mill")
        assert page.locator("figure.strip[data-line=hall] #kept").count() == 1
        reload("hall")


#: Elements of the page that are cut off: by the screen, or by what they stand in.
CUT_OFF = """() => [...document.querySelectorAll("li, figure, canvas, figcaption a, tr, td, th, p")].filter((each) => {
    const box = each.getBoundingClientRect(), room = each.closest("section").getBoundingClientRect();
    const bottom = Math.min(room.bottom, innerHeight), right = Math.min(room.right, innerWidth);
    return box.height === 0 || box.bottom > bottom + 1 || box.right > right + 1;
}).map((each) => each.outerHTML)"""


@pytest.mark.parametrize(
    ("width", "height", "language"),
    [
        (1280, 800, "en"),
        (1080, 1920, "zh"),
        pytest.param(1920, 1080, "zh", marks=pytest.mark.search),
        pytest.param(1024, 768, "en", marks=pytest.mark.search),
    ],
)
def test_a_panel_needs_no_scrolling(browser: Any, tmp_path: Path, width: int, height: int, language: str) -> None:
    port = free_port()
    lines = [f"{letter}-line" for letter in "ABCDEFGHIJKLMNOPQRSTUVWXYZ"]
    viewport = {"width": width, "height": height}
    with GatewayProcess(tmp_path, config(port, *lines)), watched(browser, viewport=viewport) as page:
        page.goto(f"http://127.0.0.1:{port}/?kiosk&lang={language}")
        until(page, lambda: page.locator("figure.strip canvas").count() == 10)
        page.wait_for_timeout(1000)
        until(page, lambda: page.locator("table.heat tbody tr").count() == 12)
        assert page.evaluate("document.documentElement.scrollHeight") <= height
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        assert page.evaluate(CUT_OFF) == []
        assert axe_findings(page) == []


def test_the_state_of_a_line_on_a_panel_is_renewed(browser: Any, tmp_path: Path) -> None:
    port = free_port()
    with GatewayProcess(tmp_path, config(port, "hall")), watched(browser) as page:
        page.goto(f"http://127.0.0.1:{port}/?kiosk")
        page.evaluate("document.querySelector('.now').textContent = 'old'")
        until(page, lambda: "down" in page.locator("figure .now").inner_text())
