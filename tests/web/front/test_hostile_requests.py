"""Requests that no browser sends for a page of ours: none of them is a defect, none leads to somebody else."""

import asyncio
import gzip

import pytest

from kit.browser import web_bench

CONFIG = """
[[image]]
unit = 200
name = "shift"
holding = 20
"""
FORM = "application/x-www-form-urlencoded"
CHUNKED = {"Transfer-Encoding": "chunked", "Content-Length": None}
LONG = "1" * 1900
PARTS = b'--x\r\nContent-Disposition: form-data; name="user"; filename="a"\r\n\r\nanna\r\n--x--\r\n'


@pytest.fixture
async def bench(tmp_path):
    async with web_bench(CONFIG, tmp_path) as bench:
        yield bench
        assert not bench.events("part_failed")


@pytest.mark.parametrize("more", [f"unit={LONG}&function=3", f"unit=1&function={LONG}"])
async def test_a_number_of_any_length_is_no_unit_and_no_function(bench, more):
    page = await bench.browser().get(f"/clients?from=10.0.0.7&listener=web&{more}")
    assert page.status == 200
    assert "is no " in page.text


@pytest.mark.parametrize("path", ["/login", "/units/shift/writes"])
async def test_a_form_in_parts_is_refused(bench, path):
    anna = bench.browser()
    await anna.log_in("anna")
    kind = {"Content-Type": "multipart/form-data; boundary=x", "X-CSRF-Token": anna.csrf}
    page = await anna.ask("POST", path, PARTS, {"Origin": f"http://{anna.name}", **kind})
    assert page.status == 415


async def test_the_other_language_is_at_the_same_place(bench):
    page = await bench.browser().get("//evil.example/x?y=1", Accept="text/html")
    assert page.status == 404
    assert 'href="/evil.example/x?y=1&amp;lang=zh"' in page.text
    assert 'href="//' not in page.text


@pytest.mark.parametrize(("method", "path"), [("GET", "/healthz"), ("POST", "/login"), ("GET", "/nothing")])
async def test_a_body_in_chunks_is_refused_and_the_connection_closed(bench, method, path):
    """Chunks of one byte cost a microsecond each, before any login."""
    wire = bench.browser().open(path, method=method, headers=CHUNKED, body=b"1\r\na\r\n")
    await asyncio.sleep(0.1)
    assert wire.received.startswith(b"HTTP/1.1 411 ")
    assert wire.is_closing()


async def test_a_body_that_nobody_wants_is_not_waited_for(bench):
    wire = bench.browser().open("/nothing", method="POST", headers={"Content-Length": "32000"})
    await asyncio.sleep(0.1)
    assert wire.received.startswith(b"HTTP/1.1 404 ")
    assert wire.is_closing()


@pytest.mark.parametrize("path", ["/" * 7900, "/login?" + "a" * 7900])
async def test_a_long_address_is_refused_before_a_route_is_looked_for(bench, path):
    """For 7900 slashes that took 9 ms."""
    assert (await bench.browser().get(path)).status == 400


@pytest.mark.parametrize(
    ("form", "kind", "encoding"),
    [
        (gzip.compress(b"user=anna&password=correct+horse", mtime=0), FORM, "gzip"),
        (b"user=anna&password=\xff", FORM, None),
        (b"&".join(b"a" for _ in range(10_000)), FORM, None),
    ],
)
async def test_what_is_no_form_is_refused_and_nothing_is_unpacked(bench, form, kind, encoding):
    anna = bench.browser()
    headers = {"Origin": f"http://{anna.name}", "Content-Type": kind, "Content-Encoding": encoding}
    assert (await anna.ask("POST", "/login", form, headers)).status in (400, 413)


@pytest.mark.parametrize("charset", ["punycode", "idna", "none", "utf-7", "latin-1", '"punycode"'])
@pytest.mark.parametrize("kind", [FORM, "application/json"])
async def test_only_utf_8_is_decoded(bench, charset, kind, monkeypatch):
    """Python decodes 32 KiB of punycode in most of a second, during which no line is served."""
    monkeypatch.setattr("aiohttp.web.Request.post", None)
    anna = bench.browser()
    headers = {"Origin": f"http://{anna.name}", "Content-Type": f"{kind}; charset={charset}"}
    page = await anna.ask("POST", "/login", b"b" * 32_000, headers)
    assert (page.status, page.problem) == (415, "what is sent must be UTF-8")


@pytest.mark.parametrize("charset", ["utf-8", "UTF-8", '"utf8"'])
async def test_utf_8_may_be_named(bench, charset):
    anna = bench.browser()
    headers = {"Origin": f"http://{anna.name}", "Content-Type": f"{FORM}; charset={charset}"}
    assert (await anna.ask("POST", "/login", b"user=anna&password=correct+horse", headers)).status == 303


@pytest.mark.parametrize("headers", [{}, {"Accept": "text/html"}])
@pytest.mark.parametrize("path", ["/login", "/healthz", "/", "/nothing"])
async def test_a_query_with_many_parameters_is_refused_before_it_is_looked_at(bench, path, headers, monkeypatch):
    """8 KiB of them took 20 ms, without a login."""
    monkeypatch.setattr("aiohttp.web.Request.query", None)
    assert (await bench.browser().ask("GET", f"{path}?{'a&' * 1000}", headers=headers)).status == 414


async def test_a_session_is_found_among_other_cookies_without_parsing_all_of_them(bench, monkeypatch):
    """As aiohttp parses them, 8 KiB took 25 ms."""
    monkeypatch.setattr("aiohttp.web.Request.cookies", None)
    anna = bench.browser()
    await anna.log_in("anna")
    ours = f"mbgw={anna.cookies['mbgw']}"
    many = f"{'a=b;' * 900} {ours}; mbgw-lang=zh;{'c=d;' * 900}"
    page = await anna.ask("GET", "/", headers={"Cookie": many, "Accept": "text/html"})
    assert page.status == 200
    assert 'lang="zh-CN"' in page.text
    assert "anna" in page.text
    assert (await anna.ask("GET", "/api/v1/session", headers={"Cookie": f"x{ours}"})).json["user"] == ""
