"""The page of the clients: who is connected, who was rejected, and what the rights say."""

import asyncio

import pytest

from kit.browser import web_bench
from kit.device import SimulatedDevice, SimulatedLine
from kit.markup import Markup
from kit.pki import listener

CONFIG = """
[[listen]]
name = "plant"
bind = "tcp://127.0.0.1:5020"

[[listen]]
name = "hmi"
bind = "tcp://127.0.0.1:5021"

[[line]]
name = "hall"
port = "/dev/hall"
devices = [{ unit = 6, as = 46, name = "press" }]

[[access]]
from = ["10.2.0.0/24"]
listen = ["plant"]
units = [46]
allow = ["read"]

[[access]]
from = ["10.2.0.7"]
allow = ["read", "write"]
"""


@pytest.fixture
async def bench(tmp_path):
    async with web_bench(CONFIG, tmp_path) as bench:
        yield bench


async def rows(bench, path="/clients"):
    page = await bench.browser().get(path)
    assert page.status == 200, page.text
    return [" | ".join(row) for row in Markup(page.text).rows()]


async def test_nobody_is_connected_and_nobody_was_rejected(bench):
    text = (await bench.browser().get("/clients")).text
    assert "No client is connected." in text
    assert "No client was rejected." in text


async def test_a_client_is_shown_with_what_it_has_asked(bench):
    bench.inner.attach("hall", SimulatedLine("rtu", SimulatedDevice(6)))
    client = bench.inner.client("10.2.0.8:5000", host="10.2.0.8")
    listener = bench.running.gateway.listeners[0]
    listener.connections.enter(client.session, asyncio.get_running_loop().time())
    await client.asks(46, "03 00 00 00 01")
    await client.asks(46, "03 00 00 00 01")
    client.ask(46, "03 00 00 00 01")
    await asyncio.sleep(0)
    assert "10.2.0.8:5000 | plant | 3 | 1 | 0 s ago" in await rows(bench)
    await client.answer()
    await asyncio.sleep(2)
    status = await bench.browser().get("/api/v1/status")
    (told,) = status.json["clients"]
    assert (told["requests"], told["in_progress"]) == (3, 0)


async def test_who_was_rejected_is_shown_with_the_reason(bench):
    listener = bench.running.gateway.listeners[1]
    listener.rejected("192.168.1.9:1000", "too many")
    await asyncio.sleep(5)
    listener.rejected("192.168.1.9:1001", "no right")
    listener.rejected("[2001:db8::1]:1001", "too many")
    await asyncio.sleep(7)
    shown = await rows(bench)
    assert "192.168.1.9 | hmi | 2 | 7 s ago | no right" in shown
    assert "2001:db8::1 | hmi | 1 | 7 s ago | too many" in shown


async def test_requests_without_a_right_are_shown(bench):
    client = bench.inner.client("10.2.0.8:5000", host="10.2.0.8")
    await client.asks(46, "06 00 00 00 01")
    assert "10.2.0.8:5000 | 46 press | through plant" in await rows(bench)


async def test_the_rows_are_shown_in_words(bench):
    shown = await rows(bench)
    assert "10.2.0.0/24 | plant | 46 | read | gateway.toml:15" in shown
    assert "10.2.0.7 | any listener | all | read, write | gateway.toml:21" in shown
    assert any(row.startswith("all else |  |  | nothing") for row in shown)


@pytest.mark.parametrize(
    ("host", "listener", "unit", "function", "verdict", "row"),
    [
        ("10.2.0.7", "plant", 46, 3, "allowed", "gateway.toml:15"),
        ("10.2.0.7", "plant", 46, 6, "not allowed", "gateway.toml:15"),
        ("10.2.0.7", "hmi", 46, 6, "allowed", "gateway.toml:21"),
        ("10.2.0.8", "hmi", 46, 3, "not allowed", ""),
        ("10.2.0.8", "plant", 46, 43, "allowed", "gateway.toml:15"),
        ("::ffff:10.2.0.7", "hmi", 46, 3, "allowed", "gateway.toml:21"),
    ],
)
async def test_the_form_tells_whether_a_client_may_do_something_and_by_which_row(
    bench, host, listener, unit, function, verdict, row
):
    query = f"from={host}&listener={listener}&unit={unit}&function={function}"
    page = await bench.browser().get(f"/clients?{query}")
    markup = Markup(page.text)
    at = next(at for at, (_, attributes) in enumerate(markup.tags) if attributes.get("role") == "status")
    assert markup.tags[at + 1][1]["class"] == ("state up" if verdict == "allowed" else "state down")
    assert any(text.startswith(verdict) for text in markup.texts)
    deciding = [each[-1] for each in markup.rows()][len(await rows(bench)) :]
    assert deciding == ([row] if row else [])
    assert ("No row applies to it." in page.text) == (not row)
    client = bench.inner.client(f"{host}:1", host=host, listener=["plant", "hmi"].index(listener))
    bench.inner.attach("hall", SimulatedLine("rtu", SimulatedDevice(6)))
    pdu = {3: "03 00 00 00 01", 6: "06 00 00 00 01", 43: "2B 0E 01 00"}[function]
    assert ((await client.asks(unit, pdu))[3:] == "01") is (verdict != "allowed" or function == 43)


@pytest.mark.parametrize(("role", "verdict"), [("operator", "allowed"), ("viewer", "not allowed"), ("", "not allowed")])
async def test_the_form_asks_for_a_role(tmp_path, role, verdict):
    row = '[[access]]\nlisten = ["remote"]\nrole = "operator"\nallow = ["read", "write"]\n'
    async with web_bench(CONFIG + listener() + row, tmp_path) as bench:
        query = f"from=10.9.0.7&listener=remote&role={role}&unit=46&function=6"
        page = Markup((await bench.browser().get(f"/clients?{query}")).text)
    assert any(text.startswith(verdict) for text in page.texts)
    assert [tag["value"] for _, tag in page.tags if tag.get("name") == "role"] == [role]


async def test_a_client_without_any_right_is_rejected(bench):
    text = (await bench.browser().get("/clients?from=10.2.0.8&listener=hmi&unit=46&function=3")).text
    assert "not allowed: the client is rejected" in text
    assert "the client gets exception" not in text


async def test_a_unit_that_is_not_there_gives_one_exception_only(tmp_path):
    readers = '[[access]]\nallow = ["read"]\n'
    async with web_bench(CONFIG.partition("[[access]]")[0] + readers, tmp_path) as bench:
        text = (await bench.browser().get("/clients?from=10.2.0.7&listener=plant&unit=9&function=6")).text
    assert "the client gets exception 0A" in text
    assert "the client gets exception 01" not in text


async def test_a_unit_that_is_not_there_is_told(bench):
    text = (await bench.browser().get("/clients?from=10.2.0.7&listener=hmi&unit=9&function=3")).text
    assert "there is no such unit" in text


@pytest.mark.parametrize(
    ("query", "why"),
    [
        ("from=somebody&listener=hmi&unit=1&function=3", "not an IP address"),
        ("from=10.2.0.7&listener=x&unit=1&function=3", "no listener"),
        ("from=10.2.0.7&listener=hmi&unit=256&function=3", "no unit"),
        ("from=10.2.0.7&listener=hmi&unit=&function=3", "no unit"),
        ("from=10.2.0.7&listener=hmi&unit=²&function=3", "no unit"),
        ("from=10.2.0.7&listener=hmi&unit=1&function=0", "no function"),
    ],
)
async def test_what_makes_no_sense_is_told_on_the_page(bench, query, why):
    page = await bench.browser().get(f"/clients?{query}".replace("²", "%C2%B2"))
    assert page.status == 200
    assert why in page.text


async def test_it_is_shown_to_those_who_may_read(bench):
    assert (await bench.browser("10.0.0.9").get("/clients")).status == 303
