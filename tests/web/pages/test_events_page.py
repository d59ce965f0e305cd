"""The page of the events: what is wrong since when, and what the address chooses."""

import asyncio

import pytest

from gateway import events
from gateway.observe.last_events import OF_A_KIND_FOR
from gateway.operator.past.events import rfc_3339
from gateway.timing.history import STEP, LineUse, UnitUse
from gateway.web.pages.events import MOST_ROWS
from kit.browser import CLOCK, web_bench
from kit.markup import Markup

CONFIG = """
[[line]]
name = "hall <b>"
port = "/dev/hall"
timeout = "120 ms"
devices = [{ unit = 6, as = 46, name = "press" }, { unit = 7, as = 47, name = "oven" }]

[[line]]
name = "yard"
port = "/dev/yard"
devices = [{ unit = 6, as = 56, name = "crane" }]

[[image]]
unit = 200
name = "shift"
holding = 10
"""
SOME = [
    events.LineUp("hall <b>", "/dev/hall"),
    events.WriteAudit("10.2.0.7:5000", "scada", 46, 6, 1, 1, "ok", "", 4.0),
    events.RequestTimeout("hall <b>", 7, "oven", 3, 121.0, 120.0, ""),
    events.EchoHeard("yard", "", "set <echo>"),
    events.WebLogin("10.2.0.9", "anna"),
]


@pytest.fixture
async def bench(tmp_path):
    async with web_bench(CONFIG, tmp_path) as bench:
        await asyncio.sleep(1)
        for event in SOME:
            bench.fan_out.emit(event)
            await asyncio.sleep(60)
        yield bench


async def rows(bench, query: str = "") -> list[list[str]]:
    page = await bench.browser().get(f"/events{query}")
    assert page.status == 200, bench.events("part_failed")[-1].traceback
    return [row for row in Markup(page.text.partition('class="events"')[2]).rows() if len(row) == 6]


async def told(bench, query: str = "") -> list[str]:
    return [row[2].rpartition(" ")[2] for row in await rows(bench, query)]


async def test_the_newest_event_is_the_first(bench):
    assert await told(bench) == ["web_login", "echo_heard", "request_timeout", "write_audit", "line_up"]


async def test_a_row_says_what_has_happened_and_leads_to_line_unit_and_client(bench):
    *_, timeout, audit, _up = await rows(bench)
    assert timeout[1:] == [
        "warning",
        "oven did not answer function 3 within 120 ms request_timeout",
        "hall <b>",
        "oven",
        "",
    ]
    assert audit[1] == "info"
    assert audit[2].startswith("10.2.0.7:5000 wrote to unit 46, address 1, count 1 with function 6: ok")
    assert audit[3:] == ["", "press", "10.2.0.7"]
    text = (await bench.browser().get("/events")).text
    assert '<a href="/lines/hall%20%3Cb%3E">' in text
    assert '<a href="/units/oven">oven</a>' in text
    assert '<a href="/events?client=10.2.0.7">' in text
    assert "set &lt;echo&gt;" in text
    at = rfc_3339(bench.fan_out.last.all()[-1].last_at)
    assert at.startswith("2026-05-01T12:0")
    assert f'<time datetime="{at}" title="{at}">' in text


@pytest.mark.parametrize(
    ("query", "names"),
    [
        ("level=warning", ["echo_heard", "request_timeout"]),
        ("level=error", ["echo_heard"]),
        ("since=170s", ["web_login", "echo_heard"]),
        ("since=170s&level=warning", ["echo_heard"]),
        ("line=yard", ["echo_heard"]),
        ("line=hall+%3Cb%3E", ["request_timeout", "write_audit", "line_up"]),
        ("unit=46", ["write_audit"]),
        ("unit=press", ["write_audit"]),
        ("unit=47", ["request_timeout"]),
        ("unit=7", ["request_timeout"]),
        ("unit=99", []),
        ("client=10.2.0.7", ["write_audit"]),
        ("client=anna", ["web_login"]),
        ("client=10.2.0", []),
        ("line=&unit=&client=+10.2.0.9+&level=&since=&lang=en", ["web_login"]),
    ],
)
async def test_the_address_chooses(bench, query, names):
    assert await told(bench, f"?{query}") == names


@pytest.mark.parametrize(
    ("query", "why"),
    [
        ("since=1", "a duration needs a unit"),
        ("since=99999h", "since: "),
        ("level=bad", "one of info, warning, error"),
        ("line=nowhere", "there is no line &#34;nowhere&#34;"),
        ("unit=nobody", "nothing has the name &#34;nobody&#34;"),
    ],
)
async def test_what_is_not_understood_is_said(bench, query, why):
    page = await bench.browser().get(f"/events?{query}")
    assert page.status == 200
    assert why in page.text.partition('role="alert"')[2].partition("</p>")[0]


async def test_the_form_has_what_the_address_chooses(bench):
    text = (await bench.browser().get('/events?level=error&line=yard&unit=46&since=2h&client="><b>')).text
    for value in ("error", "yard", "46", "2h"):
        assert f'<option value="{value}" selected>' in text
    assert 'value="&#34;&gt;&lt;b&gt;"' in text


async def test_lines_and_units_of_earlier_configs_are_found_by_their_events(bench):
    bench.fan_out.emit(events.UnitResting("gone", 9, "lost", 2.0, ""))
    assert await told(bench, "?line=gone") == await told(bench, "?unit=lost") == ["unit_resting"]


async def test_a_long_list_is_cut(bench):
    for number in range(MOST_ROWS + 50):
        bench.fan_out.emit(events.ConfigWarning(f"problem {number}", ""))
        await asyncio.sleep(OF_A_KIND_FOR / 90)
    found = await rows(bench)
    assert len(found) == MOST_ROWS
    assert found[0][2].startswith(f"problem {MOST_ROWS + 49}")
    assert "and 55 earlier ones" in (await bench.browser().get("/events")).text


async def test_what_is_counted_is_told_with_its_number(bench):
    for _ in range(12):
        bench.fan_out.emit(events.RequestTimeout("hall <b>", 7, "oven", 3, 121.0, 120.0, ""))
        await asyncio.sleep(1)
    assert "9 times since" in (await rows(bench))[0][2]


async def test_who_may_not_read_does_not_see_events(tmp_path):
    async with web_bench(CONFIG, tmp_path) as bench:
        page = await bench.browser("10.2.0.7").get("/events", Accept="text/html")
        assert page.status in (302, 303)


# --- what is still wrong -----------------------------------------------------------------------------


async def wrong(bench) -> list[list[str]]:
    page = (await bench.browser().get("/events")).text
    return Markup(page.partition('class="wrong"')[2].partition("</table>")[0]).rows()


async def test_when_all_is_well_it_is_said(tmp_path):
    async with web_bench("[[image]]\nunit = 200\nholding = 10\n", tmp_path) as bench:
        assert "Nothing is wrong now." in (await bench.browser().get("/events")).text


async def test_a_line_is_down_since_it_was_lost(bench):
    bench.inner.lines["yard"].pull()
    await asyncio.sleep(1)
    bench.fan_out.emit(events.LineLost("yard", "/dev/yard", "unplugged"))
    at = bench.fan_out.last.all()[-1].last_at
    await asyncio.sleep(600)
    (row,) = [row for row in await wrong(bench) if row[2].startswith("yard")]
    assert row[1] == "down"
    assert f'datetime="{rfc_3339(at)}"' in (await bench.browser().get("/events")).text.partition("</table>")[0]


async def test_a_unit_fails_since_the_first_slot_of_the_history_in_which_it_did(bench):
    number = int(CLOCK // STEP)
    for at in range(number - 5, number + 1):
        use = UnitUse(requests=100, timeouts=50 if at >= number - 2 else 0, responses=50)
        bench.history.add(at * STEP + 1, {"hall <b>": LineUse(600.0)}, {"oven": use})
    (row,) = [row for row in await wrong(bench) if row[2].startswith("oven")]
    assert row[1] == "failing"
    since = f'datetime="{rfc_3339((number - 2) * STEP)}"'
    assert since in (await bench.browser().get("/events")).text.partition("</table>")[0]


async def test_a_rejected_config_is_wrong_until_another_one_is_applied(bench):
    bench.running.reload_succeeded = False
    bench.fan_out.emit(events.ConfigRejected("gateway.toml", "no"))
    await asyncio.sleep(60)
    (row,) = [row for row in await wrong(bench) if row[2] == "config"]
    assert row[1] == "to fix"
    assert row[0].startswith("2026-05-01")
    bench.running.reload_succeeded = True
    await asyncio.sleep(60)
    assert not [row for row in await wrong(bench) if row[2] == "config"]


async def test_the_pages_of_a_line_and_a_unit_lead_to_their_events(bench):
    assert '<a href="/events?line=hall%20%3Cb%3E">' in (await bench.browser().get("/lines/hall%20%3Cb%3E")).text
    assert '<a href="/events?unit=press">' in (await bench.browser().get("/units/press")).text
