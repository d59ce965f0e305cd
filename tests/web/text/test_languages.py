"""Each page in each language: which one it is, and that no text is missing."""

import ast
import json
import re
from functools import cache
from pathlib import Path
from typing import get_args, get_type_hints

import pytest
from jinja2 import Environment

import gateway.errors
from gateway.errors import RequestError
from gateway.operator.answers.status import LineStatus, UnitStatus
from gateway.operator.complaint import WHYS, exception_name
from gateway.trace.records import RESULTS
from gateway.web.access.guard import Role
from gateway.web.pages.assets import Assets
from gateway.web.pages.renderer import FOLDER as TEMPLATES
from gateway.web.pages.renderer import _templates
from gateway.web.text.languages import COOKIE, ENGLISH, FOLDER, LANGUAGES, Texts, preferred
from kit.browser import web_bench

STATIC = TEMPLATES.parent / "static"
OTHERS = [code for code in LANGUAGES if code != ENGLISH.code]
#: What stands on a page in every language.
NAMES = {"modbus-gateway", "API", "s"}
PLACEHOLDER = re.compile(r"%\(\w+\)s")
ENTRY = re.compile(r'(\w+|"[^"\n]*"):\s(?:\(([^)]*)\) =>|[{"`])')

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
        ("de-DE,de;q=0.9,zh;q=0.7,en;q=0.5", "zh"),
        ("de", "en"),
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
    assert Texts(LANGUAGES["zh"]).word(word) == chinese


def test_results_are_told_in_plain_english():
    english = Texts(ENGLISH)
    assert [english.word(each) for each in ("bad_frame", "timeout", "ok")] == ["broken frame", "time-out", "ok"]
    assert [each for each in RESULTS if "_" in english.word(each)] == []


@cache
def extracted(template: str) -> dict[str, frozenset[str]]:
    """The texts of a template, each with its placeholders."""
    source = (TEMPLATES / template).read_text()
    environment = Environment(extensions=["jinja2.ext.i18n"], autoescape=True)
    texts = {}
    for line, _, message in environment.extract_translations(source):
        text = message[1] if isinstance(message, tuple) else message  # of a singular and a plural, the plural
        assert text is not None, f"{template}:{line} translates what is no constant; word() does that"
        texts[text] = frozenset(PLACEHOLDER.findall(text))
    return texts


def translated(code: str, name: str) -> dict[str, str]:
    file = FOLDER / code / f"{name}.json"
    return json.loads(file.read_text()) if file.exists() else {}


def pages() -> list[str]:
    return sorted(file.stem for file in TEMPLATES.glob("*.html"))


def words(code: str) -> dict[str, str]:
    """What is translated, and is no text of a template."""
    found = {}
    for file in (FOLDER / code).glob("*.json"):
        if file.stem not in pages():
            found |= json.loads(file.read_text())
    return found


@pytest.mark.parametrize("code", OTHERS)
@pytest.mark.parametrize("page", pages())
def test_every_text_of_a_page_is_translated_and_nothing_else_is(code, page):
    wanted, there = extracted(f"{page}.html"), translated(code, page)
    assert sorted(there) == sorted(wanted)
    for english, text in there.items():
        assert text.strip()
        assert frozenset(PLACEHOLDER.findall(text)) == wanted[english], text
        assert "%" not in PLACEHOLDER.sub("", text).replace("%%", ""), text


@pytest.mark.parametrize("page", pages())
def test_a_page_has_no_text_that_cannot_be_translated(page):
    source = (TEMPLATES / f"{page}.html").read_text()
    source = re.sub(r"\{% trans.*?endtrans %\}|\{%.*?%\}|\{\{.*?\}\}|\{#.*?#\}", "", source, flags=re.DOTALL)
    shown = re.findall(r">([^<]*)<", source) + re.findall(r'(?:aria-label|title|placeholder|alt)="([^"]*)"', source)
    assert set(re.findall(r"[^\W\d_][\w-]*", " ".join(shown))) <= NAMES


@pytest.mark.parametrize("code", OTHERS)
def test_a_text_is_translated_in_one_way(code):
    known = {}
    for file in (FOLDER / code).glob("*.json"):
        for english, text in json.loads(file.read_text()).items():
            assert known.setdefault(english, text) == text, file.name


def words_of_the_gateway() -> set[str]:
    """States, results and roles."""
    states = {word for cls in (LineStatus, UnitStatus) for word in get_args(get_type_hints(cls)["state"])}
    errors = (each for each in vars(gateway.errors).values() if isinstance(each, type))
    results = {each.result for each in errors if issubclass(each, RequestError)}
    exceptions = {exception_name(code) for code in range(256)}
    return {*states, *results, *get_args(Role), *exceptions, *WHYS.values(), "ok", "exception"}


@pytest.mark.parametrize("code", OTHERS)
def test_every_word_of_the_gateway_is_translated(code):
    assert words_of_the_gateway() <= set(words(code))


@pytest.fixture(scope="module")
def constants() -> set[str]:
    """Every text in the source of the gateway."""
    return {
        node.value
        for file in Path(gateway.errors.__file__).parent.rglob("*.py")
        for node in ast.walk(ast.parse(file.read_text()))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    }


@pytest.mark.parametrize("code", LANGUAGES)
def test_no_word_is_translated_that_the_gateway_does_not_have(code, constants):
    assert sorted(set(words(code)) - constants) == []


def entries(file: Path) -> list[tuple[str, str]]:
    """The keys of a table of texts, in their order, each with the parameters of its function."""
    source = file.read_text()
    found = list(ENTRY.finditer(source))
    for match, following in zip(found, [*found[1:], None], strict=True):
        body = source[match.end() : following.start() if following else len(source)]
        for parameter in re.findall(r"\w+", match[2] or ""):
            assert re.search(rf"\b{parameter}\b", body), f"{file.name}: {match[1]} does not use {parameter}"
    return [(match[1], match[2] or "") for match in found]


def tables() -> list[str]:
    return sorted(file.name.removesuffix(".en.js") for file in (STATIC / "texts").glob("*.en.js"))


@pytest.mark.parametrize("code", OTHERS)
@pytest.mark.parametrize("name", tables())
def test_the_texts_of_a_script_are_the_same_in_each_language(code, name):
    assert entries(STATIC / "texts" / f"{name}.{code}.js") == entries(STATIC / "texts" / f"{name}.en.js")


@pytest.mark.parametrize("name", tables())
def test_a_script_uses_each_of_its_texts_and_no_others(name):
    scripts = [text for file in STATIC.glob("*.js") if f'textsOf("{name}")' in (text := file.read_text())]
    assert len(scripts) == 1
    table = (STATIC / "texts" / f"{name}.en.js").read_text()
    assert set(re.findall(r"\bTEXTS\.(\w+)", scripts[0])) == set(re.findall(r"^  (\w+):", table, re.MULTILINE))


def test_every_language_has_its_files_and_no_others():
    assert sorted(path.name for path in FOLDER.iterdir()) == sorted(LANGUAGES)
    for script in (STATIC / "texts").iterdir():
        assert script.name.split(".")[1:] in [[code, "js"] for code in LANGUAGES]


def test_only_the_first_of_many_languages_are_looked_at():
    assert preferred(f"{'fr,' * 31}zh").code == "zh"
    assert preferred(f"{'fr,' * 32}zh").code == "en"


def test_a_template_is_compiled_once_for_all_languages() -> None:
    assets = Assets()
    made = [_templates(language, assets).get_template("health.html") for language in LANGUAGES.values()]
    assert len({id(each.root_render_func.__code__) for each in made}) == 1
