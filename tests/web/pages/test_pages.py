"""The pages as the server makes them: complete without JavaScript, and without a word of others in their markup."""

import asyncio
import json
import re
from socket import gethostname

import pytest

from gateway.version import DOCUMENTATION
from kit.browser import web_bench
from kit.device import SimulatedDevice, SimulatedLine
from kit.markup import Markup

CONFIG = """
[[line]]
name = "hall <script>"
port = "/dev/hall"
devices = [{ unit = 1, as = 41, name = "silo & co", profile = "weigher" }]

[[line]]
name = "panel"
port = "/dev/panel"
role = "server"
serves = [41]

[[image]]
unit = 200
name = "shift"
holding = 1

[[image]]
unit = 241
of = "silo & co"
read = [{ holding = "0-1", every = "1 s" }]

[[upstream]]
name = "plant"
to = "tcp://10.1.0.5"
units = [{ as = 37, unit = 1 }]
"""


@pytest.fixture
async def bench(tmp_path):
    async with web_bench(CONFIG, tmp_path) as bench:
        yield bench


async def test_the_first_page_shows_all_parts(bench):
    bench.inner.client()
    texts = Markup((await bench.browser().get("/")).text).texts
    for each in (
        "hall <script>",
        "silo & co",
        "panel",
        "plant",
        "shift",
        "mirror of silo & co",
        "RTU 19200 8E1",
    ):
        assert each in texts


TILE = re.compile(r'<a href="([^"]+)" class="tile (\w+)"[^>]*><b>([^<]+)</b> <span>([^<]+)</span>')


async def test_the_first_page_has_figures_that_lead_to_where_they_are_explained(bench):
    bench.inner.attach("hall", SimulatedLine("rtu", SimulatedDevice(1)))
    await asyncio.sleep(60)
    tiles = TILE.findall((await bench.browser().get("/")).text)
    assert [(link, state, name) for link, state, _, name in tiles] == [
        ("/#lines", "up", "lines up"),
        ("/#units", "up", "units answering"),
        ("/traffic", "known", "requests/s"),
        ("/units/silo%20%26%20co", "known", "worst p99: silo &amp; co"),
        ("/clients", "known", "clients"),
    ]
    assert [figure for _, _, figure, _ in tiles][:3] == ["3/3", "1/1", "1.0"]


async def test_units_that_do_not_answer_make_their_tile_red(bench):
    await asyncio.sleep(60)
    tiles = TILE.findall((await bench.browser().get("/")).text)
    assert tiles[1][:3] == ("/#units", "down", "0/1")


async def test_the_title_tells_how_many_things_are_wrong_on_which_page_of_which_site(bench):
    async def title(path, host="127.0.0.1"):
        page = await bench.browser(host).get(path)
        return re.search("<title>(.*)</title>", page.text)[1]

    bench.inner.attach("hall", SimulatedLine("rtu", SimulatedDevice(1)))
    await asyncio.sleep(60)
    overview = (await bench.browser().get("/")).text
    count = overview.partition("troubles")[2].partition("</ul>")[0].count("<li>")
    assert count
    assert await title("/clients") == f"{count} problems · Clients · {gethostname()}"
    assert await title("/login", "10.0.0.9") == "Log in · modbus-gateway"


async def test_the_connections_have_a_place_on_the_page_of_the_clients(bench):
    texts = Markup((await bench.browser().get("/clients")).text).texts
    assert "Connections of the gateway" in texts
    assert {"default", "0 of 32"} <= set(texts)


async def test_nothing_of_the_config_becomes_markup(bench):
    page = await bench.browser().get("/")
    assert "hall &lt;script&gt;" in page.text
    assert "<script>" not in page.text


@pytest.mark.parametrize("path", ["/", "/login", "/lines/hall%20%3Cscript%3E", "/lines/plant"])
async def test_a_page_has_no_inline_script_or_style_and_nothing_from_elsewhere(bench, path):
    browser = bench.browser()
    await browser.log_in("anna")
    markup = Markup((await browser.get(path)).text)
    for tag, attributes in markup.tags:
        assert tag != "style"
        assert tag != "script" or "src" in attributes
        assert not any(name.startswith("on") or name == "style" for name in attributes)
        if (tag, attributes.get("href")) == ("a", DOCUMENTATION):
            continue  # nothing of it is loaded
        for name in ("src", "href", "action"):
            assert attributes.get(name, "/").startswith(("/", "#"))
            assert not attributes.get(name, "/").startswith("//")


@pytest.mark.parametrize(
    ("path", "settings"),
    [("hall%20%3Cscript%3E", "RTU 19200 8E1"), ("panel", "RTU 19200 8E1"), ("plant", "Modbus TCP")],
)
async def test_each_line_has_a_page_that_the_first_one_links_to(bench, path, settings):
    assert f'href="/lines/{path}"' in (await bench.browser().get("/")).text
    page = await bench.browser().get(f"/lines/{path}")
    assert page.status == 200
    assert settings in page.text
    assert "<script>" not in page.text


async def test_a_page_of_no_line_is_not_found(bench):
    assert (await bench.browser().get("/lines/nothing")).status == 404


async def test_a_line_is_shown_to_those_who_may_read(bench):
    page = await bench.browser("10.0.0.9").get("/lines/panel")
    assert (page.status, page.headers["Location"]) == (303, "/login?next=/lines/panel")


async def test_the_login_is_shown_as_the_page_that_leads_to_it(bench):
    browser = bench.browser("10.0.0.9")
    page = await browser.get("/lines/panel?lang=zh&theme=dark")
    assert page.headers["Location"] == "/login?next=/lines/panel?lang%3Dzh%26theme%3Ddark&lang=zh&theme=dark"
    login = await browser.get(page.headers["Location"])
    assert '<html lang="zh-CN">' in login.text
    assert 'content="dark"' in login.text


async def test_the_last_transactions_are_on_the_page_without_javascript(bench):
    bench.inner.attach("hall", SimulatedLine("rtu", SimulatedDevice(1)))
    await asyncio.sleep(5)
    await bench.browser().get("/api/v1/units/41/holding/0-1")
    texts = Markup((await bench.browser().get("/lines/hall%20%3Cscript%3E")).text).texts
    assert "41 silo & co: read holding 0-1 (40001-40002)" in texts
    assert {"weight 0.00", "· 0 0"} <= set(texts)


async def test_a_script_gets_the_settings_of_each_line(bench):
    markup = Markup((await bench.browser().get("/")).text)
    lines = [attributes for tag, attributes in markup.tags if tag == "figure"]
    assert [each["data-line"] for each in lines] == ["hall <script>", "panel", "plant"]
    assert [each["data-baud"] for each in lines] == ["19200", "19200", "0"]
    assert json.loads(lines[0]["data-units"]) == [[41, "silo & co"]]


async def test_a_page_names_who_has_logged_in(bench):
    browser = bench.browser()
    assert "Log in" in (await browser.get("/")).text
    await browser.log_in("anna")
    text = (await browser.get("/")).text
    assert "anna (operator)" in text
    assert f'name="csrf" value="{browser.csrf}"' in text


async def test_a_user_name_that_is_markup_stays_text(bench):
    page = await bench.browser("10.0.0.9").get('/login?next=/"><script>alert(1)</script>')
    assert "<script>alert" not in page.text


async def test_without_users_the_login_says_so(tmp_path):
    async with web_bench(CONFIG, tmp_path, users=None, token="t") as bench:
        page = await bench.browser("10.0.0.9").get("/login")
        assert "Nobody can log in" in page.text
        assert "modbus-gateway user add NAME --role operator --file FILE" in page.text
        assert (await bench.browser().post("/login", {"user": "anna", "password": "correct horse"})).status == 401


async def test_files_are_kept_for_ever_under_the_name_of_their_version(bench):
    browser = bench.browser("10.0.0.9")
    addresses = re.findall(r'"(/static/[^"]+)"', (await browser.get("/login")).text)
    assert len(addresses) == 6
    for address in addresses:
        page = await browser.get(address)
        assert page.status == 200
        assert "immutable" in page.headers["Cache-Control"]
        plain = await browser.get(address.partition("?")[0])
        assert (plain.text, plain.headers["Cache-Control"]) == (page.text, "no-cache")
        assert (await browser.get(address, If_None_Match=page.headers["ETag"])).status == 304


async def test_modules_have_their_type(bench):
    assert (await bench.browser().get("/static/page.js")).headers["Content-Type"].startswith("text/javascript")


@pytest.mark.parametrize("path", ["/static/../pages.py", "/static/%2e%2e/pages.py", "/static/x", "/static//etc/passwd"])
async def test_no_other_file_is_given_away(bench, path):
    assert (await bench.browser().get(path)).status == 404


async def test_the_last_transactions_are_the_last_ones_however_many_there_were(bench):
    bench.inner.attach("hall", SimulatedLine("rtu", SimulatedDevice(1)))
    client = bench.inner.client()
    for address in range(400):
        await client.asks(41, f"03 {address:04X} 00 01")
    page = (await bench.browser().get("/lines/hall%20%3Cscript%3E")).text
    assert re.findall(r">41 [^:]*: read holding (\d+)", page)[:2] == ["399", "398"]


APART = """
[[listen]]
bind = "tcp://127.0.0.1:1502"
[[listen]]
bind = "tcp://127.0.0.1:1503"
name = "for the annex"
line = "annex"

[[line]]
name = "annex"
port = "/dev/annex"

[[line]]
name = "hall"
port = "/dev/hall"
devices = [{ unit = 1, name = "press" }]
"""


async def test_a_unit_of_the_same_number_on_a_line_apart_is_not_mistaken_for_it(tmp_path):
    async with web_bench(APART, tmp_path) as bench:
        bench.inner.attach("annex", SimulatedLine("rtu", SimulatedDevice(1)))
        await bench.inner.client(listener=1).asks(1, "03 00 00 00 01")
        browser = bench.browser()
        assert (await browser.get("/api/v1/units/1")).json["status"]["name"] == "press"
        assert (await browser.get("/api/v1/units/1/history")).json["unit"] == "press"
        assert (await browser.get("/api/v1/units/annex%2F1/history")).json["unit"] == "annex/1"


@pytest.mark.parametrize("page", ["/", "/lines/annex", "/lines/hall"])
async def test_every_link_to_a_unit_leads_to_a_page(tmp_path, page):
    async with web_bench(APART, tmp_path) as bench:
        client = bench.inner.client(listener=1)
        for _ in range(3):
            await client.asks(1, "03 00 00 00 01")
        browser = bench.browser()
        text = (await browser.get(page)).text
        assert ("annex/1" in text) == (page != "/lines/hall")
        assert ("/units/press" in text) == (page == "/lines/hall")
        for link in re.findall('href="(/units/[^"]*)"', text):
            assert (await browser.get(link)).status == 200


async def test_a_page_that_there_is_not_keeps_the_menu_and_the_user(bench):
    browser = bench.browser()
    await browser.log_in("anna")
    page = await browser.get("/nope", Accept="text/html")
    assert page.status == 404
    texts = Markup(page.text).texts
    assert "Overview" in texts
    assert "Log in" not in texts
    assert sum(text.lower() == "not found" for text in texts) == 1
