"""Add a line: port, search, names and profiles, the text to add. It writes nothing, and takes no port from a line."""

import asyncio
import re
import tomllib

import pytest

from gateway.config.load import parse
from gateway.hardware.listing import ListedPort
from gateway.ports.port import SerialSettings
from gateway.simulator.generic import Generic
from gateway.simulator.weigher import Weigher
from gateway.timing.characters import CharacterFormat
from gateway.tools.page_scans import LEFT
from gateway.web.pages.new_line import NewDevice, points_of, with_devices
from kit.browser import web_bench
from kit.device import SimulatedDevice, SimulatedLine
from kit.markup import Markup

CONFIG = """
[[line]]
name = "hall"
port = "/dev/hall"
timeout = "120 ms"
devices = [{ unit = 6, as = 3, name = "press" }]
"""
OTHER = CONFIG.replace("press", "mill")


def port(path, state="free", remark=""):
    return ListedPort(path, path, "FTDI <USB>", "ftdi_sio", state, remark)


@pytest.fixture
async def bench(tmp_path, monkeypatch):
    async with web_bench(CONFIG, tmp_path) as bench:
        ports = [port("/dev/hall"), port("/dev/new"), port("/dev/held", "in use", "by mbusd (pid 412)")]
        monkeypatch.setattr("gateway.web.pages.add_line.list_serial_ports", lambda: ports)
        for each in ("new", "held"):
            bench.inner._open(SerialSettings(f"/dev/{each}", 9600, CharacterFormat(8, "E", 1)))
        yield bench


async def operator(bench, name="anna"):
    browser = bench.browser()
    await browser.log_in(name)
    return browser


async def searched(browser, **fields):
    """Start a search, look at it once a second until it has ended, and return its last page."""
    page = await browser.post("/config/line/scans", {"units": "1-5", "mode": "rtu", "baud": "9600", **fields})
    assert page.status == 303, page.text
    return await followed(browser, page.headers["Location"])


async def followed(browser, path):
    for _ in range(300):
        page = await browser.get(path)
        assert page.status == 200, page.text
        if "End the search" not in page.text:
            return page
        await asyncio.sleep(1)
    raise AssertionError("the search does not end")


def fields_in(page):
    """The fields of the form with the devices, as a browser would send them."""
    named = re.findall(r'<input (?:type="hidden" )?name="([^"]+)"[^>]* value="([^"]*)"', page.text)
    fields = dict(named)
    for unit in re.findall(r'name="take-(\d+)" checked', page.text):
        fields[f"take-{unit}"] = "on"
    for unit, options in re.findall(r'<select name="profile-(\d+)".*?>(.*?)</select>', page.text):
        fields[f"profile-{unit}"] = re.search(r"<option selected>([^<]*)", options)[1]
    return fields


def text_in(page):
    return re.search(r'<pre class="text"[^>]*>(.*?)</pre>', page.text, re.DOTALL)[1].replace("&#34;", '"')


async def test_each_port_is_listed_with_who_has_it(bench):
    page = await bench.browser().get("/config/line")
    rows = [" | ".join(row) for row in Markup(page.text).rows()]
    assert "/dev/hall | FTDI <USB> ftdi_sio | has the line hall" in rows
    assert "/dev/new | FTDI <USB> ftdi_sio | free Choose" in rows
    assert "/dev/held | FTDI <USB> ftdi_sio | in use by mbusd (pid 412)" in rows


async def test_units_of_a_free_port_become_a_line_that_check_accepts(bench):
    bench.inner.attach_at_pace("new", Weigher(3), Generic(5))
    anna = await operator(bench)
    page = await searched(anna, port="/dev/new", format="8E1")
    assert "2 units have answered" in page.text
    fields = fields_in(page)
    assert (fields["as-3"], fields["name-3"], fields["profile-3"]) == ("1", "weigher-1", "weigher")  # 3 is taken
    assert (fields["as-5"], fields["name-5"], fields["profile-5"]) == ("5", "unit-5", "generic")
    page = await anna.post("/config/line/text", {**fields, "name": "roof"})
    assert page.status == 200, page.text
    assert "no errors, no warnings" in page.text
    added = text_in(page)
    (line,) = tomllib.loads(added)["line"]
    assert (line["name"], line["port"], line["baud"], line["format"]) == ("roof", "/dev/new", 9600, "8E1")
    assert line["devices"] == [
        {"unit": 3, "as": 1, "name": "weigher-1", "profile": "weigher"},
        {"unit": 5, "name": "unit-5"},
    ]
    whole = parse(f"{CONFIG}\n{added}", port_trouble=lambda _: None, real_path=str)
    assert whole.config is not None, whole.problems
    assert "weight" in page.text  # a point of the profile


async def test_the_rate_is_found_out(bench):
    bench.inner.lines["new"].is_virtual = False
    bench.inner.attach_at_pace("new", Generic(2))
    heard = bench.inner.lines["new"].on_write

    def only_at_19200(data):
        if bench.inner.opened["new"].baud == 19200 and str(bench.inner.opened["new"].format) == "8N1":
            heard(data)

    bench.inner.lines["new"].on_write = only_at_19200
    page = await searched(await operator(bench), port="/dev/new", baud="")
    assert "At 19200 baud, 8N1." in page.text
    assert fields_in(page)["baud"] == "19200"


async def test_nobody_answers_at_any_rate(bench):
    bench.inner.lines["new"].is_virtual = False
    page = await searched(await operator(bench), port="/dev/new", baud="")
    assert "No unit has answered" in page.text


async def test_a_line_that_exists_is_searched_for_units_that_are_not_configured(bench):
    bench.inner.attach_at_pace("hall", Weigher(6), Generic(4))
    anna = await operator(bench)
    page = await searched(anna, line="hall", units="1-10")
    assert "1 unit has answered" in page.text
    page = await anna.post("/config/line/text", fields_in(page))
    assert text_in(page) == '  { unit = 4, name = "unit-4" },\n'
    assert "no errors, no warnings" in page.text
    assert "Insert it at the devices" in page.text


@pytest.mark.parametrize(
    "devices",
    [
        'devices = [{ unit = 6, as = 3, name = "press" }]',
        'devices = [ # by the door\n  { unit = 6, as = 3, name = "press" },\n]\nbaud = 9600',
        '\n[[line.devices]]\nunit = 6\nas = 3\nname = "press"',
        "devices = []",
        "",
    ],
)
def test_devices_are_added_in_the_way_in_which_the_text_lists_them(devices):
    text = (
        f'[[line]]\nport = "/dev/a"\n\n[[line]]\nname = "hall"\nport = "/dev/hall"\n{devices}\n\n[web]\nwrite = true\n'
    )
    new = with_devices(text, "hall", [NewDevice(4, 4, "a", "generic"), NewDevice(5, 8, "b", "v80")])
    before, after = tomllib.loads(text), tomllib.loads(new.whole)
    added = [{"unit": 4, "name": "a"}, {"unit": 5, "as": 8, "name": "b", "profile": "v80"}]
    before["line"][1]["devices"] = added + before["line"][1].get("devices", [])
    assert after == before
    lines = new.whole.splitlines(keepends=True)
    assert "".join(lines[new.before :]).startswith(new.added)
    assert new.is_first is (devices == "")


def test_a_line_that_the_text_does_not_have_gets_no_devices():
    assert with_devices('[[line]]\nport = "/dev/a"\n', "hall", []) is None
    assert with_devices("[[line", "hall", []) is None


async def test_what_check_finds_stands_beside_the_line_of_the_new_text(bench):
    anna = await operator(bench)
    fields = {"port": "/dev/new", "baud": "9600", "format": "8N1", "name": "roof", "take-7": "on"}
    page = await anna.post("/config/line/text", {**fields, "name-7": "press", "profile-7": "no-such"})
    assert "cannot be used like this" in page.text
    rows = [" | ".join(row) for row in Markup(page.text).rows()]
    assert any(row.startswith("error | line 7 | ") and "no-such" in row for row in rows), rows
    assert "How to use it" not in page.text


async def test_names_cannot_bring_other_keys_or_commands_along(bench):
    anna = await operator(bench)
    name = "a\" }]\n[web]\nwrite = true # $(reboot) `x` 'END-OF-LINE'"
    fields = {"port": "/dev/new", "baud": "9600", "format": "8N1", "name": name, "take-7": "on", "name-7": name}
    page = await anna.post("/config/line/text", fields)
    assert "cannot be used like this" in page.text
    assert "<pre" in page.text
    assert set(tomllib.loads(text_in(page).replace("&gt;", ">").replace("&#39;", "'"))) == {"line"}


async def test_the_port_of_a_line_and_a_port_in_use_are_not_opened(bench):
    anna = await operator(bench)
    openings = {name: line.openings for name, line in bench.inner.lines.items()}
    for path, what in (("/dev/hall", "the line hall has /dev/hall"), ("/dev/held", "in use by mbusd")):
        page = await anna.post("/config/line/scans", {"port": path, "units": "1-5", "baud": "9600"})
        assert page.status == 409
        assert what in page.problem
    for path in ("/dev/null", "/etc/passwd", "rtu+tcp://10.1.0.9:4001", ""):
        assert (await anna.post("/config/line/scans", {"port": path, "units": "1-5"})).status == 404
    assert {name: line.openings for name, line in bench.inner.lines.items()} == openings


async def test_one_search_at_a_time(bench):
    anna = await operator(bench)
    form = {"port": "/dev/new", "units": "1-247", "baud": "9600"}
    first = await anna.post("/config/line/scans", form)
    assert first.status == 303
    page = await anna.post("/config/line/scans", form)
    assert page.status == 409
    assert "a scan of /dev/new for anna goes on: one at a time" in page.problem
    assert "A search on /dev/new, for anna, goes on" in (await bench.browser().get("/config/line")).text
    await anna.post(first.headers["Location"])
    page = await followed(anna, first.headers["Location"])
    assert "ended by anna" in page.text
    assert not bench.inner.lines["new"].is_open


async def test_a_search_ends_when_nobody_looks_at_it(bench):
    anna = await operator(bench)
    page = await anna.post("/config/line/scans", {"port": "/dev/new", "units": "1-247", "baud": "9600"})
    await asyncio.sleep(5)
    assert bench.inner.lines["new"].is_open
    await asyncio.sleep(LEFT)
    assert not bench.inner.lines["new"].is_open
    assert "nobody looked at its page any longer" in (await anna.get(page.headers["Location"])).text


async def test_a_reload_ends_a_search(bench, tmp_path):
    anna = await operator(bench)
    page = await anna.post("/config/line/scans", {"port": "/dev/new", "units": "1-247", "baud": "9600"})
    await asyncio.sleep(2)
    (tmp_path / "gateway.toml").write_text(OTHER)
    assert (await anna.post("/api/v1/reload")).status == 200
    await asyncio.sleep(1)
    assert not bench.inner.lines["new"].is_open
    assert "the config was reloaded" in (await anna.get(page.headers["Location"])).text


async def test_a_late_answer_to_a_search_is_none_to_a_new_line_on_that_port(bench, tmp_path):
    """A device is slow: its answer comes when the port belongs to a line. The line expects it, and rejects it."""
    device = SimulatedDevice(5)
    device.script.append([(1.5, bytes.fromhex("05 03 02 00 07 08 46"))])
    bench.inner.attach("new", SimulatedLine("rtu", device))
    anna = await operator(bench)
    await anna.post("/config/line/scans", {"port": "/dev/new", "units": "5,200-247", "baud": "9600"})
    await asyncio.sleep(0.5)
    new = '\n[[line]]\nname = "roof"\nport = "/dev/new"\nbaud = 9600\ndevices = [{ unit = 5 }]\n'
    await bench.inner.reload(CONFIG + new)
    await asyncio.sleep(0.4)
    (roof,) = [line for line in bench.running.gateway.lines if line.name == "roof"]
    assert roof.driver.line.ledger.count_late(asyncio.get_running_loop().time()) > 0


async def test_a_port_that_cannot_be_opened_is_told(bench):
    bench.inner.lines["new"].pull("/dev/new cannot be opened: it is held by ModemManager")
    page = await searched(await operator(bench), port="/dev/new")
    assert "held by ModemManager" in page.text


async def test_only_operators_search_and_make_texts(bench):
    vera = await operator(bench, "vera")
    form = {"port": "/dev/new", "units": "1-5", "baud": "9600"}
    assert (await vera.post("/config/line/scans", form)).status == 403
    assert (await vera.post("/config/line/text", {"take-1": "on"})).status == 403
    assert (await bench.browser().post("/config/line/scans", form)).status == 401
    assert "Operators can search for units here." in (await vera.get("/config/line?port=/dev/new")).text


async def test_others_do_not_see_what_was_found(bench):
    bench.inner.attach_at_pace("new", Generic(2))
    anna, again = await operator(bench), await operator(bench)
    page = await anna.post("/config/line/scans", {"port": "/dev/new", "units": "1-5", "baud": "9600"})
    assert (await again.get(page.headers["Location"])).status == 404
    assert (await again.post(page.headers["Location"])).status == 303
    assert "2 units" not in (await followed(anna, page.headers["Location"])).text


async def test_who_may_not_read_every_unit_does_not_search(tmp_path, monkeypatch):
    rows = '[[access]]\nlisten = ["web"]\nunits = 3\nallow = ["read"]\n'
    async with web_bench(CONFIG + rows, tmp_path) as bench:
        monkeypatch.setattr("gateway.web.pages.add_line.list_serial_ports", lambda: [port("/dev/new")])
        anna = await operator(bench)
        page = await anna.post("/config/line/scans", {"port": "/dev/new", "units": "1-5", "baud": "9600"})
        assert page.status == 404
        assert "[[access]] does not give the page the right to read every unit" in page.problem


@pytest.mark.parametrize(
    ("field", "value", "why"),
    [
        ("baud", "fast", 'baud: "fast" is no rate'),
        ("format", "9X1", "format: "),
        ("format", "7E1", "RTU needs 8 data bits"),
        ("units", "0-400", "units: unit 0 is outside"),
        ("units", "", "units: "),
    ],
)
async def test_a_field_that_is_wrong_is_named(bench, field, value, why):
    form = {"port": "/dev/new", "units": "1-5", "baud": "9600", "format": "8E1", field: value}
    page = await (await operator(bench)).post("/config/line/scans", form)
    assert page.status == 422
    assert why in page.problem


async def test_the_last_step_without_a_form_leads_to_the_first(bench):
    page = await bench.browser().get("/config/line/text?lang=zh")
    assert (page.status, page.headers["Location"]) == (303, "/config/line")


async def test_units_can_be_named_without_a_search(bench):
    anna = await operator(bench)
    page = await anna.get("/config/line/devices?port=/dev/new&mode=rtu&baud=19200&format=8N1&units=1-3,7")
    assert [f"take-{unit}" in page.text for unit in (1, 3, 7, 8)] == [True, True, True, False]
    text = text_in(await anna.post("/config/line/text", fields_in(page)))
    assert [device["unit"] for device in tomllib.loads(text)["line"][0]["devices"]] == [1, 2, 3, 7]


async def test_a_line_on_which_others_ask_is_only_listened_to(bench):
    anna = await operator(bench)
    assert "only listen" in (await anna.get("/config/line?port=/dev/new")).text
    page = await anna.get("/config/line/devices?port=/dev/new&mode=rtu&baud=19200&format=8N1&units=7&role=monitor")
    page = await anna.post("/config/line/text", fields_in(page))
    assert "no errors, no warnings" in page.text
    assert tomllib.loads(text_in(page))["line"][0]["role"] == "monitor"


def test_no_file_is_read_but_those_of_own_profiles(tmp_path):
    table = '[profile."{}"]\npoints = [{{ name = "flow", holding = 1 }}]\n'
    (tmp_path / "profiles").mkdir()
    (tmp_path / "profiles" / "own.toml").write_text(table.format("own"))
    (tmp_path / "other.toml").write_text(table.format("../other"))
    config = tmp_path / "gateway.toml"
    assert [each["name"] for each in points_of("own", config, "")] == ["flow"]
    assert points_of("../other", config, "") == []


async def test_devices_for_a_line_of_an_included_file_are_written_there(bench, tmp_path):
    (tmp_path / "conf.d").mkdir()
    (tmp_path / "conf.d" / "hall.toml").write_text(CONFIG)
    (tmp_path / "gateway.toml").write_text('include = ["conf.d/*.toml"]\n[trace]\n')
    anna = await operator(bench)
    await anna.post("/config/reload")
    page = await anna.post("/config/line/text", {"line": "hall", "take-4": "on", "as-4": "4", "profile-4": "generic"})
    assert "no errors, no warnings" in page.text
    assert "(conf.d/hall.toml:2)" in page.text
    assert f"{tmp_path}/conf.d/hall.toml\nmodbus-gateway check" in page.text
    page = await anna.post("/config/line/text", {"port": "/dev/new", "baud": "9600", "format": "8E1", "take-4": "on"})
    assert f"tee -a {tmp_path}/gateway.toml" in page.text
