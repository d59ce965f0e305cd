"""Each page in each language: which one it is, and that words of the gateway are told in it. See test_catalogues."""

import pytest

from gateway.trace.records import RESULTS
from gateway.web.pages.assets import Assets
from gateway.web.pages.renderer import _templates
from gateway.web.text.languages import COOKIE, ENGLISH, LANGUAGES, preferred, texts_of, word_of
from kit.browser import web_bench

CONFIG = """
[[line]]
name = "hall"
port = "/dev/hall"
devices = [{ unit = 1, name = "silo" }]
"""


@pytest.fixture
async def browser(tmp_path):
    async with web_bench(CONFIG, tmp_path) as bench:
        yield bench.browser()


@pytest.mark.parametrize(
    ("header", "code"),
    [
        ("", "en"),
        ("zh-CN,zh;q=0.9,en;q=0.8", "zh"),
        ("en-US,en;q=0.9,zh;q=0.8", "en"),
        ("la-VA,la;q=0.9,zh;q=0.7,en;q=0.5", "zh"),
        ("la", "en"),
        ("ZH-hant", "zh"),
        ("zh;q=0", "en"),
        ("zh;q=x, *;q=0.5", "en"),
        ("zh; q=0.3, en ; Q=0.2", "zh"),
        (";;,=,zh=", "en"),
    ],
)
def test_the_browser_says_which_language_it_prefers(header, code):
    assert preferred(header) is LANGUAGES[code]


async def test_the_address_wins_over_the_cookie_and_the_cookie_over_the_browser(browser):
    assert '<html lang="en">' in (await browser.get("/")).text
    assert '<html lang="zh-CN">' in (await browser.get("/", Accept_Language="zh")).text
    assert COOKIE not in browser.cookies
    page = await browser.get("/?lang=zh")
    assert '<html lang="zh-CN">' in page.text
    assert browser.cookies[COOKIE] == "zh"
    assert ">概览</h1>" in (await browser.get("/")).text
    assert '<html lang="en">' in (await browser.get("/?lang=en", Accept_Language="zh")).text
    assert '<html lang="en">' in (await browser.get("/", Accept_Language="zh")).text


@pytest.mark.parametrize("code", ["", "xx", "../zh", "zh-CN"])
async def test_a_language_that_there_is_not_changes_nothing(browser, code):
    assert '<html lang="en">' in (await browser.get(f"/?lang={code}")).text
    assert browser.cookies == {}


async def test_a_page_is_never_kept_for_somebody_with_another_language(browser):
    page = await browser.get("/")
    assert page.headers["Vary"] == "Accept-Language, Cookie"
    assert page.headers["Cache-Control"] == "no-store"


async def test_a_page_leads_to_itself_in_the_other_language(browser):
    page = await browser.get("/lines/hall?seconds=5&lang=en")
    assert '<a href="/lines/hall?seconds=5&amp;lang=zh" lang="zh-CN" hreflang="zh-CN">中文</a>' in page.text
    assert ">English</a>" in (await browser.get("/lines/hall?seconds=5&lang=zh")).text


async def test_a_panel_has_nothing_but_the_content(browser):
    page = await browser.get("/?kiosk")
    assert '<html lang="en" class="kiosk">' in page.text
    for part in ("<header", "<nav", "<footer"):
        assert part not in page.text


async def test_a_wrong_password_is_told_in_the_language_of_the_page(browser):
    page = await browser.post("/login", {"user": "anna", "password": "wrong"}, Accept_Language="zh")
    assert "用户名或密码错误。" in page.text


async def test_states_of_the_gateway_are_translated(browser):
    assert '<span class="state up">在线</span>' in (await browser.get("/lines/hall?lang=zh")).text


@pytest.mark.parametrize(
    ("word", "chinese"),
    [
        ("not tried", "未尝试"),
        ("exception 02", "异常响应 02"),
        ("exception 0A", "异常响应 0A"),
        ("news", "news"),
        ("", ""),
    ],
)
def test_a_word_may_have_a_number(word, chinese):
    assert word_of(texts_of(LANGUAGES["zh"]))(word) == chinese


def test_results_are_told_in_plain_english():
    word = word_of(texts_of(ENGLISH))
    assert [word(each) for each in ("bad_frame", "timeout", "ok")] == ["broken frame", "time-out", "ok"]
    assert [each for each in RESULTS if "_" in word(each)] == []


def test_only_the_first_of_many_languages_are_looked_at():
    assert preferred(f"{'la,' * 31}zh").code == "zh"
    assert preferred(f"{'la,' * 32}zh").code == "en"


def test_a_template_is_compiled_once_for_all_languages() -> None:
    assets = Assets()
    made = [_templates(language, assets).get_template("health.html") for language in LANGUAGES.values()]
    assert len({id(each.root_render_func.__code__) for each in made}) == 1
