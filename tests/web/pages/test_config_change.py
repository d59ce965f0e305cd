"""The page where a change is prepared: it checks a text, says what it would change, and writes nothing."""

import asyncio
import json
import re
from html import unescape
from pathlib import Path
from types import SimpleNamespace

import pytest

from gateway.config.reading.masking import MASK
from gateway.operator.config import check as config_check
from gateway.readconfig.text_reader import look_at
from kit.browser import web_bench
from kit.markup import Markup

CONFIG = """
[[line]]
name = "hall"
port = "/dev/hall"
devices = [{ unit = 6, as = 46, name = "press <b>" }]  # by the door
[trace]
ring = "8 MiB"
[log]
level = "info"
[profile.bypass]
source = "geheim"
"""
PAGE, API = "/config/change", "/api/v1/config/check"
MIB = 1 << 20


@pytest.fixture(autouse=True)
def checked(monkeypatch):
    """What was checked, in this process: that it is one of its own has tests of its own."""
    texts = []

    def check(file, text, in_use):
        texts.append(text)
        return look_at(text, in_use, file)

    monkeypatch.setattr(config_check, "check_text", check)
    return texts


@pytest.fixture
async def bench(tmp_path):
    async with web_bench(CONFIG, tmp_path) as bench:
        yield bench


@pytest.fixture
async def anna(bench):
    browser = bench.browser()
    await browser.log_in("anna")
    return browser


async def ask(browser, text, **headers):
    return await browser._change("POST", API, json.dumps({"text": text}).encode(), "application/json", headers)


def text_in(page):
    return unescape(re.search(r"<textarea[^>]*>\n(.*)</textarea>", page, re.DOTALL)[1])


async def test_the_form_begins_with_the_config_in_use_without_its_secrets(anna):
    page = await anna.get(PAGE)
    text = text_in(page.text)
    assert text.startswith('[[line]]\nname = "hall"')
    assert f'source = "{MASK}"' in text
    assert "geheim" not in page.text
    assert "by the door" not in page.text


async def test_that_text_cannot_be_applied_by_mistake(anna):
    page = await anna.post(PAGE, {"text": text_in((await anna.get(PAGE)).text)})
    assert "this is the mask, which the page shows in place of the value" in page.text
    assert "install" not in page.text


async def test_problems_stand_with_their_lines(anna):
    page = Markup((await anna.post(PAGE, {"text": CONFIG.replace("unit = 6", "unit = 999")})).text)
    (row,) = [row for row in page.rows() if row[0] == "error" and "999" in row[2]]
    assert row[1] == "5:21"
    assert row[2].startswith("devices = [{ unit = 999")


async def test_what_is_not_toml_is_shown_again_to_its_writer(anna):
    page = await anna.post(PAGE, {"text": "<b>\r\n</textarea>"})
    assert text_in(page.text) == "<b>\n</textarea>"
    assert "cannot be used" in page.text


async def test_the_difference_and_the_commands_are_shown_and_nothing_is_written(bench, anna, tmp_path):
    good = CONFIG.replace("as = 46", "as = 47")
    page = Markup((await anna.post(PAGE, {"text": good})).text)
    assert "line hall" in page.texts
    assert any(each.startswith("+devices = [{ unit = 6, as = 47") for each in page.texts)
    told = " ".join(page.texts)
    new = f"{tmp_path / 'gateway.toml'}.new"
    assert f"install -m 644 gateway.toml {new}" in told
    assert f"modbus-gateway check {new} && mv {new} {tmp_path / 'gateway.toml'} && modbus-gateway reload" in told
    assert (tmp_path / "gateway.toml").read_text() == CONFIG
    assert bench.events("config_applied") == []


async def test_only_the_result_is_returned_to_a_script(anna):
    page = await anna.post(PAGE, {"text": "site = 3", "only_result": ""})
    assert text_in(page.text) == ""
    assert "site" in page.text


async def test_the_text_can_be_downloaded(anna):
    page = await anna.post(f"{PAGE}/text", {"text": 'site = "ü"\r\n# kept\r\n'})
    assert page.text == 'site = "ü"\n# kept\n'
    assert page.headers["Content-Disposition"] == 'attachment; filename="gateway.toml"'


@pytest.mark.parametrize("path", [PAGE, f"{PAGE}/text"])
async def test_what_is_no_form_is_refused(bench, anna, checked, path):
    page = await anna._change("POST", path, b'{"text": ""}', "application/json", {})
    assert page.status == 415
    assert checked == bench.events("part_failed") == []


@pytest.mark.parametrize("user", ["", "vera"])
async def test_nobody_else_may_have_a_text_checked(bench, checked, user):
    browser = bench.browser()
    if user:
        await browser.log_in(user)
    status = 403 if user else 401
    assert "Operators can check a text here." in (await browser.get(PAGE)).text
    assert (await browser.post(PAGE, {"text": ""})).status == status
    assert (await browser.post(f"{PAGE}/text", {"text": ""})).status == status
    assert (await ask(browser, "")).status == status
    assert (await bench.browser("10.0.0.9").get(PAGE)).status == 303
    assert checked == []


@pytest.mark.parametrize("path", [PAGE, f"{PAGE}/text", API])
async def test_it_needs_the_token_of_the_session_and_our_origin(anna, checked, path):
    body, kind = (
        (b'{"text": ""}', "application/json") if path == API else (b"text=", "application/x-www-form-urlencoded")
    )
    for headers in ({"X-CSRF-Token": "forged"}, {"X-CSRF-Token": None}, {"Origin": "http://evil.example"}):
        assert (await anna._change("POST", path, body, kind, headers)).status == 403
    assert checked == []


async def test_the_token_may_be_in_a_form_of_any_size(anna):
    for size in (10, 100_000):
        form = {"csrf": anna.csrf, "text": "#" * size}
        assert (await anna.post(PAGE, form, X_CSRF_Token=None)).status == 200
        assert (await anna.post(PAGE, form | {"csrf": "forged"}, X_CSRF_Token=None)).status == 403


async def test_a_program_gets_problems_with_places_changes_and_notes(anna):
    told = (await ask(anna, '[[line]]\nname = "hall"\nport = "/dev/hall"\nbuad = 3\n')).json
    assert told["ok"] is False
    assert told["commands"] == []
    (problem,) = told["problems"]
    assert (problem["severity"], problem["line"], problem["column"], problem["path"]) == (
        "error",
        4,
        1,
        "line[0].buad",
    )
    assert problem["message"].startswith("unknown key")
    assert problem["help"]
    told = (await ask(anna, '[[line]]\nname = "press"\nport = "/dev/hall"\ndevices = [{ unit = 1 }]\n')).json
    assert told["ok"] is True
    assert told["changes"] == {"added": ["line press"], "removed": ["line hall"], "changed": ["trace"], "restart": []}
    assert any(each.startswith("not looked at: ") for each in told["notes"])
    assert "geheim" not in str(told)


async def test_the_config_in_use_is_told_without_secrets(bench, tmp_path):
    told = (await bench.browser().get("/api/v1/config")).json
    assert told["file"] == str(tmp_path / "gateway.toml")
    assert f'source = "{MASK}"' in told["text"]
    assert "geheim" not in told["text"]
    assert (await bench.browser("10.0.0.9").get("/api/v1/config")).status == 401


async def test_a_text_of_one_mebibyte_comes_through_both_ways(anna, checked):
    text = CONFIG + "#=&%\n" * ((MIB - len(CONFIG)) // 5)
    assert (await ask(anna, text)).status == 200
    assert (await anna.post(PAGE, {"text": text, "only_result": ""})).status == 200
    assert checked == [text, text]


async def test_a_body_that_is_too_long_is_refused(anna, checked):
    assert (await ask(anna, "#" * 4 * MIB)).status == 413
    assert checked == []


async def test_a_long_body_is_taken_only_of_an_operator(bench, checked):
    """Memory is given to nobody whose request is refused anyway."""
    wire = bench.browser().open(
        API,
        method="POST",
        headers={"Origin": "http://127.0.0.1:8502", "Content-Length": str(3 * MIB), "Content-Type": "application/json"},
    )
    await asyncio.sleep(1)
    assert wire.received.startswith(b"HTTP/1.1 401")


async def test_other_bodies_are_no_longer_than_before(anna):
    assert (await anna.post("/config/reload", {"text": "#" * 100_000})).status == 413


async def test_one_text_is_checked_at_a_time_with_a_rest(monkeypatch):
    began, loop = [], asyncio.get_running_loop()

    async def slow(*_):
        began.append(loop.time())
        await asyncio.sleep(2)
        return look_at("", "", "x")

    checks = config_check.TextChecks()

    operator = SimpleNamespace(reloader=SimpleNamespace(text="", file=Path("gateway.toml")))
    monkeypatch.setattr(loop, "run_in_executor", slow)
    await asyncio.gather(*(checks.check(operator, "", lambda: True) for _ in range(3)))
    assert [round(each - began[0], 3) for each in began] == [0, 4, 8]


async def test_more_than_some_do_not_wait(anna, monkeypatch):
    statuses = []
    monkeypatch.setattr(config_check, "MOST_WAITING", 1)
    monkeypatch.setattr(config_check.TextChecks, "_check", lambda *_: asyncio.sleep(5, look_at("", "", "x")))

    async def one():
        statuses.append((await ask(anna, "")).status)

    await asyncio.gather(one(), one())
    assert sorted(statuses) == [200, 503]


async def test_a_text_that_takes_too_long_is_a_problem(anna, monkeypatch):
    def hang(*_):
        raise config_check.ConfigError("the text: cannot be read within 30 s")

    monkeypatch.setattr(config_check, "check_text", hang)
    told = (await ask(anna, "")).json
    assert (told["ok"], told["problems"][0]["message"]) == (False, "the text: cannot be read within 30 s")


async def test_whoever_leaves_in_the_middle_of_a_long_body_does_no_harm(bench, anna, checked):
    head = {"Origin": "http://127.0.0.1:8502", "Content-Type": "application/json", "X-CSRF-Token": anna.csrf}
    wires = [
        anna.open(API, method="POST", body=b'{"text": "' + b"#" * 50_000, headers={**head, "Content-Length": str(MIB)})
        for _ in range(3)
    ]
    await asyncio.sleep(1)
    for wire in wires:
        wire.close()
    assert (await ask(anna, "")).status == 200
    assert bench.events("part_failed") == []
    assert checked == [""]


async def test_a_long_body_that_takes_too_long_gives_way_to_others(anna):
    head = {"Origin": "http://127.0.0.1:8502", "Content-Type": "application/json", "X-CSRF-Token": anna.csrf}
    wire = anna.open(API, method="POST", body=b'{"text": "', headers={**head, "Content-Length": str(MIB)})
    await asyncio.sleep(61)
    assert wire.received.startswith(b"HTTP/1.1 408")
    assert (await ask(anna, "")).status == 200
