"""Debian's Chromium, and the demo for it to look at. As a command it makes the pictures of the docs:

PYTHONPATH=.:tests .venv/bin/python tests/kit/chromium.py docs/pictures
"""

import os
import re
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from itertools import takewhile
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from urllib.parse import urlsplit

import pytest

from gateway.web.text.languages import LANGUAGES
from kit.process import PATIENCE, started
from kit.programs import find

NEEDS_BROWSER = [
    pytest.mark.needs("chromium"),
    pytest.mark.skipif(find_spec("playwright") is None, reason="there is no playwright for this kind of machine"),
]
#: What depends on the language is the text. So CI looks at pages in each of them, whoever tests in between in English.
EACH_LANGUAGE = [pytest.param(each, marks=() if each == "en" else pytest.mark.search) for each in LANGUAGES]


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
            shown = "".join(takewhile(lambda line: line != "Ctrl-C ends everything.\n", output))
            match = re.search(r"^  page +(http://\S+)$", shown, re.MULTILINE)
            assert match is not None, shown
            yield match[1]
        finally:
            demo.send_signal(signal.SIGINT)
            demo.wait(PATIENCE)


#: For pages that draw as often as for most readers. All others draw once a second, which takes a third of the time.
MOVING = {"reduced_motion": "no-preference"}
_CALM = {"reduced_motion": "reduce"}


class PatientBrowser:
    """A browser of Playwright, whose pages have as long for each step as processes have. They are not MOVING."""

    def __init__(self, browser: Any) -> None:
        self._browser = browser

    def new_context(self, **settings: Any) -> Any:
        return self._patient(self._browser.new_context(**(_CALM | settings)))

    def new_page(self, **settings: Any) -> Any:
        return self._patient(self._browser.new_page(**(_CALM | settings)))

    @staticmethod
    def _patient(made: Any) -> Any:
        made.set_default_timeout(1000 * PATIENCE)
        return made


@contextmanager
def chromium() -> Iterator[PatientBrowser]:
    """A browser that ends with the context."""
    from playwright.sync_api import sync_playwright  # noqa: PLC0415 - it is not installed everywhere

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=find("chromium"), args=["--no-sandbox"])
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


#: What axe-core finds by these rules, or by all but contrast.
_FIND = """async (rules) => {
    const chosen = rules.length ? { runOnly: rules } : { rules: { "color-contrast": { enabled: false } } };
    return (await axe.run({ resultTypes: ["violations"], ...chosen })).violations;
}"""
#: What it finds of contrast. It looks at every word, which takes four times as long as all other rules together:
#: so it is shown one element for each combination of colours and fonts.
_FIND_CONTRAST = """async () => {
    const looks = new Map();
    const hasText = (each) => [...each.childNodes].some((node) => node instanceof Text && node.data.trim());
    for (const each of document.body.querySelectorAll("*")) {
        if (!each.matches("input, select") && !hasText(each)) continue;
        if (!each.checkVisibility({ visibilityProperty: true })) continue;
        const { color, fontSize, fontWeight, textShadow } = getComputedStyle(each);
        const look = [color, fontSize, fontWeight, textShadow];
        for (let under = each; under; under = under.parentElement) {
            const { backgroundColor, backgroundImage, opacity } = getComputedStyle(under);
            look.push(backgroundColor, backgroundImage, opacity);
        }
        if (!looks.has(look.join())) looks.set(look.join(), each);
    }
    const chosen = { resultTypes: ["violations"], runOnly: ["color-contrast"] };
    return (await axe.run({ include: [...looks.values()] }, chosen)).violations;
}"""


def axe_findings(page: Any, *rules: str, contrast: bool = True) -> list[str]:
    """What axe-core finds by these rules, or by all, and of contrast: the rule, and the elements that break it."""
    found = _found(page, _FIND, [*rules])
    return found + contrast_findings(page) if contrast else found


def contrast_findings(page: Any) -> list[str]:
    """Words that can hardly be read for their colours."""
    return _found(page, _FIND_CONTRAST)


def _found(page: Any, by: str, rules: Sequence[str] = ()) -> list[str]:
    from axe_playwright_python.base import AXE_SCRIPT  # noqa: PLC0415 - with playwright

    if not page.evaluate("'axe' in window"):
        page.evaluate(AXE_SCRIPT)
    found = page.evaluate(by, rules)
    return [f"{each['id']}: {'; '.join(str(node['html']) for node in each['nodes'][:3])}" for each in found]


def in_language(path: str, language: str) -> str:
    return f"{path}{'&' if '?' in path else '?'}lang={language}"


def look_at_a_desk(page: Any) -> None:
    """Show pages light, and as large as a desk has them."""
    page.emulate_media(color_scheme="light")
    page.set_viewport_size({"width": 1280, "height": 900})


def page_findings(page: Any) -> list[str]:
    """What is wrong with a page: as it is shown, then dark, and on a telephone."""
    found = axe_findings(page)
    page.emulate_media(color_scheme="dark")
    found += contrast_findings(page)
    return found + phone_findings(page)


def phone_findings(page: Any) -> list[str]:
    """What is wrong with where things are on a telephone, which depends on the language."""
    page.set_viewport_size({"width": 390, "height": 844})
    until(page, lambda: page.evaluate("innerWidth") == 390)
    page.evaluate(
        "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
    )  # what observes sizes has been called
    found = axe_findings(page, "scrollable-region-focusable", "target-size", contrast=False)  # colours are the same
    if (width := page.evaluate("document.documentElement.scrollWidth")) > 390:
        found.append(f"{width} pixels wide")
    return found


def until(page: Any, is_so: Callable[[], bool]) -> None:
    """Wait for what the page shows. (Playwright's own way needs `eval`, which the page forbids.)"""
    end = time.monotonic() + PATIENCE
    while not is_so():
        assert time.monotonic() < end
        page.wait_for_timeout(100)


def until_scripts_run(page: Any) -> None:
    """Wait until the page's scripts have run. They wait for their texts, which may come after the load event."""
    page.evaluate("Promise.all([...document.querySelectorAll('script[type=module]')].map((each) => import(each.src)))")


def renew(page: Any) -> None:
    """Have the page renewed now, as when its tab is shown again, and not within five seconds."""
    page.evaluate("document.dispatchEvent(new Event('visibilitychange'))")


#: Devices whose values the picture of all values shows.
_SHOWN = ("meter-lab", "climate")


def take_pictures(folder: Path) -> None:
    """The page of a line with a transaction that is pointed at, the values of all devices, and those of a unit."""
    folder.mkdir(parents=True, exist_ok=True)
    with demo_page() as address, chromium() as browser:
        page = browser.new_page(viewport={"width": 1120, "height": 1000}, color_scheme="light", **MOVING)
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
        page.goto(f"{address}/values")
        page.wait_for_timeout(11_000)
        for device in page.locator("main details[open] > summary").element_handles():
            if device.inner_text().split()[0] not in _SHOWN:
                device.click()
        page.wait_for_timeout(600)
        page.screenshot(path=folder / "page.png", clip={"x": 0, "y": 0, "width": 1120, "height": 828})
        page.goto(f"{address}/units/meter-hall?trend=active-power")
        page.wait_for_timeout(3_000)
        top = page.locator("h1").bounding_box()["y"] - 12
        page.screenshot(path=folder / "values.png", clip={"x": 0, "y": top, "width": 1120, "height": 780})


def _take(page: Any, part: Any, file: Path) -> None:
    """A picture of a part of a page, with a margin."""
    box, margin = part.bounding_box(), 12
    clip = {"x": box["x"] - margin, "y": box["y"] - margin}
    page.screenshot(path=file, clip={**clip, "width": box["width"] + 2 * margin, "height": box["height"] + 2 * margin})


if __name__ == "__main__":
    take_pictures(Path(sys.argv[1]))
