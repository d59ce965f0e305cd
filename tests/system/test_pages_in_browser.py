"""Every page of the demo as a browser shows it: in each language, light and dark, with and without JavaScript."""

import re
import time
from urllib.parse import urlsplit

import pytest

from deploy.translations import all_catalogues
from gateway.web.text.languages import LANGUAGES
from kit.chromium import (
    EACH_LANGUAGE,
    NEEDS_BROWSER,
    axe_findings,
    in_language,
    look_at_a_desk,
    page_findings,
    phone_findings,
    until_scripts_run,
    watched,
)

pytestmark = NEEDS_BROWSER

#: What each page is called, and one of its kind in the demo.
PAGES = {
    "/": "/",
    "/login": "/login",
    "/lines/NAME": "/lines/silo",
    "/units/NAME": "/units/silo-1",
    "/events": "/events?since=24h",
    "/values": "/values",
    "/traffic": "/traffic?line=panel",
    "/health": "/health",
    "/clients": "/clients",
    "/config": "/config",
    "/config/change": "/config/change",
    "/config/line": "/config/line",
}
#: Those that the demo has none of.
OTHERS = ("/images/UNIT",)


@pytest.fixture(scope="module")
def plain_page(browser):
    """A page without JavaScript."""
    with watched(browser, java_script_enabled=False) as page:
        yield page


@pytest.fixture(scope="module")
def unscripted_page(browser):
    """A page that has none of its scripts; axe-core itself needs JavaScript."""
    with watched(browser) as page:
        page.route("**/*.js*", lambda route: route.fulfill(content_type="text/javascript", body=""))
        yield page


@pytest.mark.parametrize("language", EACH_LANGUAGE)
@pytest.mark.parametrize("path", PAGES.values())
def test_a_page_is_accessible_and_asks_nobody_else(browser, address, path, language):
    asked: list[str] = []
    began = time.monotonic()
    with watched(browser) as page:
        page.on("request", lambda request: asked.append(request.url))
        look_at_a_desk(page)
        page.goto(f"{address}{in_language(path, language)}")
        until_scripts_run(page)
        page.wait_for_timeout(1000)
        assert asked.count(page.url) <= 2 + (time.monotonic() - began) / 5  # it is renewed every five seconds
        assert page.locator("html").get_attribute("lang") == LANGUAGES[language].tag
        assert page.locator("h1").count() == 1
        assert left_in_english(page, language) == []
        assert (page_findings(page) if language == "en" else phone_findings(page)) == []  # all but places is the same


#: The texts of a page but those that are marked as English.
_TEXTS = """() => [...document.body.querySelectorAll("*:not([lang=en], [lang=en] *, textarea, pre, code)")]
    .flatMap((each) => [
        ...[...each.childNodes].filter((node) => node instanceof Text).map((node) => node.data.trim()),
        ...["title", "aria-label", "placeholder"].map((name) => each.getAttribute(name) ?? ""),
    ])"""


def left_in_english(page, language):
    """What a page shows of the texts that the language of it has, in English. Single words may be names."""
    english = [
        re.sub(r"%\\\(\w+\\\)s", ".+?", re.escape(text))
        for code, catalogue in all_catalogues()
        if code == language
        for message in catalogue
        for text in ([message.id] if isinstance(message.id, str) else message.id)
        if re.search("[a-z]{2}", re.sub(r"%\(.*?\)s|^\w+$", "", text)) and text not in message.string
    ]
    found = re.compile(rf"(?:^|[·,:;] )(?:{'|'.join(english)})(?=$|[·,:;] )") if english else re.compile("(?!)")
    return [text for text in page.evaluate(_TEXTS) if found.search(text)]


@pytest.mark.parametrize("path", PAGES.values())
def test_a_page_is_complete_without_javascript(plain_page, address, path):
    texts = []
    for language in LANGUAGES:
        plain_page.goto(f"{address}{in_language(path, language)}")
        assert plain_page.locator("html").get_attribute("lang") == LANGUAGES[language].tag
        texts.append(plain_page.locator("main").inner_text())
    assert all(texts)
    assert len(set(texts)) == len(texts)


@pytest.mark.search
@pytest.mark.parametrize("path", PAGES.values())
def test_a_page_is_accessible_without_javascript(plain_page, unscripted_page, address, path):
    plain_page.goto(address + path)
    unscripted_page.goto(address + path)
    text = plain_page.locator("main").inner_text()
    assert len(unscripted_page.locator("main").inner_text()) > len(text) / 2
    assert axe_findings(unscripted_page) == []


def test_each_page_that_another_leads_to_is_tested_here(plain_page, address):
    kinds = [re.compile(re.sub("[A-Z]+", "[^/]+", kind)) for kind in (*PAGES, *OTHERS)]
    found = set()
    for path in PAGES.values():
        plain_page.goto(address + path)
        addresses = plain_page.locator("a[href]:not([download])").evaluate_all(
            "all => all.map((each) => each.getAttribute('href'))"
        )
        found |= {urlsplit(link).path for link in addresses if link.startswith("/")}
    pages = {path for path in found if not path.startswith("/api/")}
    assert len(pages) > len(PAGES)
    assert sorted(path for path in pages if not any(kind.fullmatch(path) for kind in kinds)) == []
