"""Writes from pages: asked before, sent once, logged with the name of who has confirmed them."""

import asyncio
import re

import pytest

from gateway.modbus.rtu import with_crc
from gateway.operator.values.steps import Answer
from gateway.routing.access import READING, AccessRow
from gateway.routing.rights import Rights
from gateway.web.pages.questions import KEPT, MOST, PATIENCE
from kit.browser import web_bench
from kit.device import SimulatedDevice, SimulatedLine

CONFIG = """
[[line]]
name = "hall"
port = "/dev/hall"

[[line.devices]]
unit = 1
as = 41
name = "press"
points = [
    { name = "speed", holding = 0, scale = 0.1, decimals = 1, unit = "rpm", write = true },
    { name = "mode", holding = 1, labels = { 0 = "off", 1 = "auto" }, write = true },
    { name = "start", holding = 9, write = "only" },
    { name = "total", holding = 4 },
]

[[image]]
unit = 200
name = "shift"
holding = 20
coils = 8
"""
UNIT = "/units/press"


@pytest.fixture
def device():
    device = SimulatedDevice(1)
    device.holding[:2] = [120, 0]
    return device


@pytest.fixture
async def bench(tmp_path, device):
    async with web_bench(CONFIG, tmp_path) as bench:
        bench.inner.attach("hall", SimulatedLine("rtu", device))
        yield bench


@pytest.fixture
async def anna(bench):
    browser = bench.browser()
    await browser.log_in("anna")
    return browser


def written(device) -> list[str]:
    """The writes that have reached the device."""
    return [frame.pdu.hex() for frame in device.heard if frame.pdu[0] in (5, 6, 15, 16)]


async def asked(browser, unit: str = UNIT, **fields: str) -> str:
    """The address of the question after a form was sent."""
    page = await browser.post(f"{unit}/writes", fields)
    assert page.status == 303, page.text
    return page.headers["Location"]


def text(page) -> str:
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", page.text))


async def test_old_and_new_are_shown_and_nothing_is_written_before_a_yes(anna, device):
    question = await asked(anna, point="speed", value="12.5")
    page = await anna.get(question)
    assert "Write this?" in page.text
    assert "speed holding 0 (40001) 12.0 → 12.5 rpm" in text(page)
    assert "Function 06 (write register), request 06 00 00 00 7D" in page.text
    assert written(device) == []


async def test_a_confirmed_write_arrives_and_is_logged_with_its_user(anna, bench, device):
    question = await asked(anna, point="speed", value="12.5")
    page = await anna.post(question)
    assert (page.status, page.headers["Location"]) == (303, question)
    page = await anna.get(question)
    assert "It is written" in page.text
    assert "12.0 → 12.5 rpm 12.5" in text(page)
    assert written(device) == ["060000007d"]
    (audit,) = bench.events("write_audit")
    assert (audit.client, audit.listener, audit.unit, audit.result) == ("web:anna@127.0.0.1", "web", 41, "ok")


async def test_a_form_that_arrives_again_writes_nothing_again(anna, device):
    question = await asked(anna, point="speed", value="12.5")
    pages = await asyncio.gather(*(anna.post(question) for _ in range(5)))
    assert {page.status for page in pages} == {303}
    device.holding[0] = 1
    await anna.post(question)
    for _ in range(3):
        assert "It is written" in (await anna.get(question)).text
    assert len(written(device)) == 1


async def test_who_clicks_twice_and_so_leaves_the_first_answer_gets_the_write_all_the_same(anna, bench, device):
    device.delay = 0.9
    question = await asked(anna, point="speed", value="12.5")
    client = bench.inner.client()
    client.ask(41, "03 00 00 00 01")
    headers = {"Origin": f"http://{anna.name}", "X-CSRF-Token": anna.csrf}
    first = anna.open(question, method="POST", headers=headers)
    first.close()
    await asyncio.sleep(0.1)
    assert (await anna.post(question)).status == 303
    assert "It is written" in (await anna.get(question)).text
    assert len(written(device)) == 1


async def test_an_exception_of_the_unit_is_told_in_words(anna, device):
    question = await asked(anna, point="speed", value="12.5")
    device.refuses[6] = 3
    await anna.post(question)
    page = await anna.get(question)
    assert "Not written" in page.text
    assert "exception 03, illegal data value" in page.text


async def test_a_write_without_an_answer_is_not_sent_again(anna, device):
    question = await asked(anna, point="speed", value="12.5")
    device.silent = True
    await anna.post(question)
    await anna.post(question)
    page = (await anna.get(question)).text
    assert "exception 0B" in page
    assert "Not written" not in page
    assert "Perhaps written" in page
    assert "Read the value before you write it again" in page
    assert len(written(device)) == 1


async def test_values_are_understood_as_on_the_command_line(anna, device):
    for point, value in (("mode", "auto"), ("speed", "0x0A"), ("start", "1")):
        await anna.post(await asked(anna, point=point, value=value))
    assert written(device) == ["060001" + "0001", "060000" + "0064", "060009" + "0001"]
    question = await asked(anna, area="holding", address="20", value="1 2,3")
    assert "holding 20" in text(await anna.get(question))
    await anna.post(question)
    assert device.holding[20:23] == [1, 2, 3]
    await anna.post(await asked(anna, area="holding", address="0x20", type="float32", swap="words", value="-2.5"))
    assert device.holding[32:34] == [0x0000, 0xC020]
    await anna.post(await asked(anna, area="coils", address="3", value="on off 1"))
    assert device.coils[3:6] == [True, False, True]
    await anna.post(await asked(anna, area="holding", address="40", type="string", value="Hall 7"))
    assert b"".join(each.to_bytes(2, "big") for each in device.holding[40:43]) == b"Hall 7"


async def test_a_point_that_is_only_written_is_not_read_for_that(anna, device):
    question = await asked(anna, point="start", value="1")
    assert "\u2013 → 1" in text(await anna.get(question))
    await anna.post(question)
    assert [frame.pdu[0] for frame in device.heard] == [6]


async def test_without_the_old_value_the_page_says_why_and_still_asks(anna, device):
    device.refuses[3] = 4
    page = await anna.get(await asked(anna, point="speed", value="12.5"))
    assert "The old value could not be read:" in page.text
    assert "exception 04" in page.text
    assert "Write now" in page.text


async def test_what_reads_otherwise_afterwards_is_marked(anna, device):
    question = await asked(anna, point="speed", value="12.5")
    device.script.append([(0.01, bytes(with_crc(bytes.fromhex("01060000007d"))))])  # confirms, and forgets
    await anna.post(question)
    assert "differs" in (await anna.get(question)).text


@pytest.mark.parametrize(
    ("form", "status"),
    [
        ({"point": "speed", "value": "fast"}, 422),
        ({"point": "speed", "value": "7000"}, 422),
        ({"point": "total", "value": "1"}, 422),
        ({"point": "nothing", "value": "1"}, 404),
        ({"area": "input", "address": "0", "value": "1"}, 422),
        ({"area": "holding", "address": "70000", "value": "1"}, 400),
        ({"area": "holding", "address": "0", "value": ""}, 422),
        ({"area": "holding", "address": "0", "value": "1", "type": "bit"}, 400),
        ({"area": "holding", "address": "0", "value": " ".join(["1"] * 124)}, 422),
        ({}, 422),
    ],
)
async def test_what_does_not_fit_is_a_problem_at_once(anna, device, form, status):
    page = await anna.post(f"{UNIT}/writes", form, Accept="text/html")
    assert page.status == status
    assert "Nothing was written or changed." in page.text
    assert device.heard == []


async def test_a_viewer_sees_no_form_and_can_send_none(bench, device):
    vera = bench.browser()
    await vera.log_in("vera")
    page = (await vera.get(UNIT)).text
    assert "/writes" not in page
    assert "/writes" not in (await vera.get("/images/shift")).text
    assert (await vera.post(f"{UNIT}/writes", {"point": "speed", "value": "1"})).status == 403
    assert device.heard == []


async def test_who_has_not_logged_in_is_told_to(bench, device):
    browser = bench.browser()
    page = (await browser.get(UNIT)).text
    assert "/writes" not in page
    assert 'href="/login?next=/units/press"' in page
    page = await browser.post(f"{UNIT}/writes", {"point": "speed", "value": "1"}, Accept="text/html")
    assert page.status == 401
    assert "Nothing was written or changed." in page.text
    assert device.heard == []


async def test_without_write_in_the_config_there_is_no_form(tmp_path, device):
    async with web_bench(CONFIG, tmp_path, write=False) as bench:
        bench.inner.attach("hall", SimulatedLine("rtu", device))
        anna = bench.browser()
        await anna.log_in("anna")
        assert "Write" not in (await anna.get(UNIT)).text
        assert (await anna.post(f"{UNIT}/writes", {"point": "speed", "value": "1"})).status == 403


async def test_rows_of_access_decide_what_there_are_forms_for(tmp_path, device):
    rights = '[[access]]\nlisten = ["web"]\nfunctions = [1, 2, 3, 4, 5]\n'
    async with web_bench(CONFIG + rights, tmp_path) as bench:
        bench.inner.attach("hall", SimulatedLine("rtu", device))
        anna = bench.browser()
        await anna.log_in("anna")
        page = (await anna.get(UNIT)).text
        assert '<option value="coils">' in page
        assert "New value of speed" not in page
        refused = await anna.post(f"{UNIT}/writes", {"point": "speed", "value": "1"})
        assert (refused.status, refused.json["exception"]) == (403, 1)
        assert "[[access]] does not let web:anna@127.0.0.1 write holding" in refused.problem
        assert device.heard == []


async def test_a_right_that_was_lost_since_the_question_writes_nothing(anna, bench, device):
    question = await asked(anna, point="speed", value="1")
    bench.running.routers.web.rights = Rights(
        [AccessRow(READING, listeners=frozenset({"web"}))], bench.running.routers.web.entry
    )
    await anna.post(question)
    assert "exception 01, illegal function" in (await anna.get(question)).text
    assert written(device) == []
    assert [event.result for event in bench.events("write_audit")] == ["denied"]


async def test_a_forged_token_writes_nothing(anna, device):
    question = await asked(anna, point="speed", value="12.5")
    for headers in ({"X_CSRF_Token": "forged"}, {"X_CSRF_Token": None}, {"Origin": "http://evil.example"}):
        assert (await anna.post(question, **headers)).status == 403
        assert (await anna.post(f"{UNIT}/writes", {"point": "speed", "value": "1"}, **headers)).status == 403
    assert written(device) == []
    assert "Write this?" in (await anna.get(question)).text


async def test_a_question_of_somebody_else_is_neither_seen_nor_answered(anna, bench, device):
    question = await asked(anna, point="speed", value="12.5")
    other = bench.browser()
    await other.log_in("anna")
    assert (await other.get(question)).status == 404
    await other.post(question)
    assert (await bench.browser().get(question)).status == 404
    assert written(device) == []


async def test_a_session_that_has_ended_writes_nothing(anna, bench, device):
    question = await asked(anna, point="speed", value="12.5")
    await anna.post("/logout")
    page = await anna.post(question, Accept="text/html", Referer=f"http://{anna.name}{UNIT}")
    assert page.status == 401
    assert "/login?next=/units/press" in page.text
    assert written(device) == []


async def test_a_question_that_waits_too_long_is_not_answered_any_more(anna, device):
    question = await asked(anna, point="speed", value="12.5")
    await asyncio.sleep(PATIENCE + 1)
    await anna.post(question)
    page = await anna.get(question)
    assert page.status == 404
    assert "Nothing was written" in page.text
    assert written(device) == []


async def test_what_became_of_a_write_is_seen_for_a_while(anna):
    question = await asked(anna, point="speed", value="12.5")
    await anna.post(question)
    await asyncio.sleep(KEPT - 10)
    assert "It is written" in (await anna.get(question)).text
    await asyncio.sleep(20)
    assert (await anna.get(question)).status == 404


async def test_questions_are_bounded(anna):
    first = await asked(anna, "/units/200", area="holding", address="0", value="1")
    for _ in range(MOST):
        await asked(anna, "/units/200", area="holding", address="0", value="1")
    assert (await anna.get(first)).status == 404


async def test_an_image_is_written_the_same_way_and_knows_its_last_writer(anna, bench):
    question = await asked(anna, "/units/shift", area="holding", address="3", value="77")
    assert "0 → 77" in text(await anna.get(question))
    await anna.post(question)
    page = await anna.get("/images/shift")
    assert re.search(r'data-at="3"[^>]* title="web:anna@127.0.0.1">77<', page.text)
    assert "holding 3 web:anna@127.0.0.1 0 s ago" in text(page)
    assert 'href="/images/shift"' in (await anna.get(question)).text


async def test_points_are_read_anew_after_a_write(anna, device):
    await anna.post(f"{UNIT}/points")
    await anna.post(await asked(anna, point="speed", value="12.5"))
    assert "12.0" not in text(await anna.get(UNIT))


async def test_a_unit_that_has_moved_to_another_line_meanwhile_gets_nothing(bench, anna, device, tmp_path):
    question = await asked(anna, point="speed", value="12.5")
    other_line = CONFIG.replace('"hall"', '"annex"').replace("/dev/hall", "/dev/annex")
    (tmp_path / "gateway.toml").write_text(other_line)
    assert (await anna.post("/api/v1/reload")).status == 200
    other = SimulatedDevice(1)
    bench.inner.attach("annex", SimulatedLine("rtu", other))
    assert (await anna.post(question)).status == 303
    page = await anna.get(question)
    assert "Not written" in page.text
    assert "the config has changed" in page.text
    assert written(device) == written(other) == []


async def test_a_point_that_means_something_else_meanwhile_gets_nothing(anna, device, tmp_path):
    question = await asked(anna, point="speed", value="12.5")
    (tmp_path / "gateway.toml").write_text(CONFIG.replace("scale = 0.1, decimals = 1", "scale = 0.01, decimals = 2"))
    assert (await anna.post("/api/v1/reload")).status == 200
    await anna.post(question)
    assert "the config has changed" in (await anna.get(question)).text
    assert written(device) == []


async def test_a_unit_that_a_reload_has_removed_gets_nothing(anna, device, tmp_path):
    question = await asked(anna, point="speed", value="12.5")
    (tmp_path / "gateway.toml").write_text(CONFIG[CONFIG.index("[[image]]") :])
    assert (await anna.post("/api/v1/reload")).status == 200
    assert (await anna.post(question)).status == 303
    assert "the config has changed" in (await anna.get(question)).text
    assert written(device) == []


async def test_a_write_that_a_reload_has_left_alone_is_sent(anna, device, tmp_path):
    question = await asked(anna, point="speed", value="12.5")
    (tmp_path / "gateway.toml").write_text(CONFIG.replace('name = "shift"', 'name = "other"'))
    assert (await anna.post("/api/v1/reload")).status == 200
    await anna.post(question)
    assert "It is written" in (await anna.get(question)).text
    assert len(written(device)) == 1


async def test_a_write_that_was_not_sent_is_not_perhaps_written(anna, device):
    first, second = [await asked(anna, point="speed", value="12.5") for _ in range(2)]
    device.silent = True
    await anna.post(first)
    await anna.post(second)  # the response to the first one may still come
    page = (await anna.get(second)).text
    assert "exception 0B" in page
    assert "Not written" in page
    assert "Perhaps written" not in page
    assert len(written(device)) == 1


async def test_a_write_to_a_unit_that_rests_says_when_it_is_tried_again(anna, device):
    device.silent = True
    for _ in range(3):
        await anna.post(await asked(anna, point="speed", value="12.5"))
        await asyncio.sleep(2)
    question = await asked(anna, point="speed", value="12.5")
    await anna.post(question)
    said = "not sent: the unit has not answered and rests, next try in "
    assert re.search(rf"exception 0B, gateway target failed to respond: {said}\d+ s", text(await anna.get(question)))
    chinese = text(await anna.get(f"{question}?lang=zh"))
    assert re.search(r"异常响应 0B.网关目标设备未响应.未发送.该单元没有响应.暂停请求.\d+ 秒后重试", chinese)


def test_a_request_that_was_not_sent_says_so_and_why():
    assert str(Answer(b"\x86\x0b", 0.1, "resting").complaint) == (
        "exception 0B, gateway target failed to respond: not sent: the unit has not answered and rests"
    )
    assert str(Answer(b"\x86\x02", 0.1).complaint) == "exception 02, illegal data address"


async def test_who_writes_to_an_image_is_told_where_values_are_written(bench):
    anna = bench.browser()
    await anna.log_in("anna")
    page = await anna.put("/api/v1/images/shift/holding/0", [1])
    assert page.status == 405
    assert page.problem == "/api/v1/images/ is only read; values are written under /api/v1/units/"
