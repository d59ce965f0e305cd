"""Debian's Chromium, and the demo for it to look at. As a command it makes the pictures of the docs:

PYTHONPATH=.:tests .venv/bin/python tests/kit/chromium.py docs/pictures
"""

import os
import re
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from urllib.parse import urlsplit

from kit.process import PATIENCE, started

#: The browser without windows is a third of the other one.
CHROMIUM = next(
    (path for path in (Path("/usr/bin/chromium-headless-shell"), Path("/usr/bin/chromium")) if path.exists()),
    Path("/usr/bin/chromium"),
)
MISSING = "Chromium is not installed (apt install chromium-headless-shell)"


@contextmanager
def demo_page() -> Iterator[str]:
    """The address of the page of a demo that runs."""
    said, its_output = os.pipe()
    with os.fdopen(said) as output, TemporaryDirectory() as folder:
        try:
            demo = started(["demo"], os.environ | {"RUNTIME_DIRECTORY": folder}, stdout=its_output)
        finally:
            os.close(its_output)
        try:
            shown = "".join(iter(output.readline, "Ctrl-C ends everything.\n"))
            match = re.search(r"^  page +(http://\S+)$", shown, re.MULTILINE)
            assert match is not None, shown
            yield match[1]
        finally:
            demo.send_signal(signal.SIGINT)
            demo.wait(PATIENCE)


class PatientBrowser:
    """A browser of Playwright, whose pages have as long for each step as processes have."""

    def __init__(self, browser: Any) -> None:
        self._browser = browser

    def new_context(self, **settings: Any) -> Any:
        return self._patient(self._browser.new_context(**settings))

    def new_page(self, **settings: Any) -> Any:
        return self._patient(self._browser.new_page(**settings))

    @staticmethod
    def _patient(made: Any) -> Any:
        made.set_default_timeout(1000 * PATIENCE)
        return made


@contextmanager
def chromium() -> Iterator[PatientBrowser]:
    """A browser that ends with the context."""
    from playwright.sync_api import sync_playwright  # noqa: PLC0415 - it is not installed everywhere

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=str(CHROMIUM), args=["--no-sandbox"])
        try:
            yield PatientBrowser(browser)
        finally:
            browser.close()


@contextmanager
def watched(browser: Any, **settings: Any) -> Iterator[Any]:
    """A page in a browser of its own. At the end it must have reported no error, and have asked nobody else."""
    context = browser.new_context(**settings)
    page = context.new_page()
    complaints: list[str] = []
    hosts: set[str] = set()
    page.on("console", lambda message: complaints.append(message.text))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("request", lambda request: hosts.add(urlsplit(request.url).netloc))
    yield page
    own = urlsplit(page.url).netloc
    context.close()
    assert complaints == [], complaints
    assert hosts == {own}


def axe_findings(page: Any, *rules: str) -> list[str]:
    """What axe-core finds by these rules, or by all: the rule, and the elements that break it."""
    from axe_playwright_python.base import AXE_SCRIPT  # noqa: PLC0415 - with playwright

    if not page.evaluate("'axe' in window"):
        page.evaluate(AXE_SCRIPT)
    options = {"resultTypes": ["violations"], **({"runOnly": rules} if rules else {})}
    return [
        f"{each['id']}: {'; '.join(str(node['html']) for node in each['nodes'][:3])}"
        for each in page.evaluate("async (options) => (await axe.run(options)).violations", options)
    ]


def in_language(path: str, language: str) -> str:
    return f"{path}{'&' if '?' in path else '?'}lang={language}"


def page_findings(page: Any) -> list[str]:
    """What is wrong with a page: light, dark, and on a telephone."""
    found = axe_findings(page)
    page.emulate_media(color_scheme="dark")
    found += axe_findings(page, "color-contrast")
    page.set_viewport_size({"width": 390, "height": 844})
    page.wait_for_timeout(200)
    found += axe_findings(page, "scrollable-region-focusable", "target-size", "color-contrast")
    if (width := page.evaluate("document.documentElement.scrollWidth")) > 390:
        found.append(f"{width} pixels wide")
    return found


def until(page: Any, is_so: Callable[[], bool]) -> None:
    """Wait for what the page shows. (Playwright's own way needs `eval`, which the page forbids.)"""
    end = time.monotonic() + PATIENCE
    while not is_so():
        assert time.monotonic() < end
        page.wait_for_timeout(100)


def take_pictures(folder: Path) -> None:
    """The page of a line with a transaction that is pointed at, and the overview."""
    folder.mkdir(parents=True, exist_ok=True)
    with demo_page() as address, chromium() as browser:
        page = browser.new_page(viewport={"width": 1120, "height": 1000}, color_scheme="light")
        page.goto(f"{address}/lines/hall")
        page.wait_for_timeout(11_000)
        page.get_by_role("button", name="Zoom in").click(click_count=2, delay=100)
        page.locator("figure canvas").first.focus()
        for _ in range(40):
            page.keyboard.press("ArrowLeft")
            if "read holding 0-9" in page.locator(".detail").inner_text():
                break
        page.wait_for_timeout(600)
        _take(page, page.locator("figure.strip"), folder / "line.png")
        page.goto(address)
        page.wait_for_timeout(11_000)
        _take(page, page.locator("section[data-keep=strips]"), folder / "overview.png")


def _take(page: Any, part: Any, file: Path) -> None:
    """A picture of a part of a page, with a margin."""
    box, margin = part.bounding_box(), 12
    clip = {"x": box["x"] - margin, "y": box["y"] - margin}
    page.screenshot(path=file, clip={**clip, "width": box["width"] + 2 * margin, "height": box["height"] + 2 * margin})


if __name__ == "__main__":
    take_pictures(Path(sys.argv[1]))
