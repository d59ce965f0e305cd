"""Who is let in at the web page, and who may change something. In virtual time, without sockets."""

import asyncio
import socket
import ssl
from ipaddress import ip_network
from urllib.parse import urlsplit

import pytest

from gateway.web.access.sessions import FAILURES_COUNT_FOR, IDLE_TIME, LONGEST_SESSION, MOST_FAILURES
from kit.browser import CHEAP_HASH, HOST, Wire, web_bench

CONFIG = """
[[image]]
unit = 200
name = "shift"
holding = 10
"""
PLACE = "/api/v1/units/200/holding/3"
AFAR = "10.2.0.7"


@pytest.fixture
async def bench(tmp_path):
    async with web_bench(CONFIG, tmp_path) as bench:
        yield bench


async def written(bench) -> list[str]:
    return [each.client for each in bench.events("write_audit")]


async def test_this_machine_reads_without_a_password(bench):
    page = await bench.browser().get("/api/v1/status")
    assert page.status == 200
    assert (await bench.browser("::1").get("/")).status == 200
    assert (await bench.browser("::ffff:127.0.0.1").get("/")).status == 200


@pytest.mark.parametrize("path", ["/api/v1/status", PLACE, "/api/v1/events", "/metrics", "/api/v1/openapi.json"])
async def test_others_need_a_login_to_read(bench, path):
    page = await bench.browser(AFAR).get(path)
    assert (page.status, page.headers["WWW-Authenticate"]) == (401, "Bearer")


async def test_a_page_leads_others_to_the_login_and_back(bench):
    browser = bench.browser(AFAR)
    page = await browser.get("/?kiosk&a=%C3%A9")
    assert page.status == 303
    assert urlsplit(page.headers["Location"]).path == "/login"
    assert 'value="/?kiosk&amp;a=%C3%A9"' in (await browser.get(page.headers["Location"])).text
    page = await browser.post("/login", {"user": "vera", "password": "correct horse", "next": "/?kiosk"})
    assert (page.status, page.headers["Location"]) == (303, "/?kiosk")
    assert (await browser.get("/")).status == 200


@pytest.mark.parametrize("target", ["https://evil.example", "//evil.example", "/\\evil.example", "javascript:x", ""])
async def test_no_login_leads_elsewhere(bench, target):
    browser = bench.browser(AFAR)
    page = await browser.post("/login", {"user": "vera", "password": "correct horse", "next": target})
    assert page.headers["Location"] == "/"


@pytest.mark.parametrize(
    "header",
    [
        *("X-Forwarded-For", "X-Forwarded-User", "X-Forwarded-Host", "X-Forwarded-Proto"),
        *("X-Real-IP", "Forwarded", "Via"),
    ],
)
async def test_who_comes_through_a_proxy_is_not_this_machine(bench, header):
    assert (await bench.browser().get("/api/v1/status", **{header: "10.0.0.9"})).status == 401


@pytest.mark.parametrize(
    "name",
    [
        *("evil.example", "evil.example:8502", "127.0.0.1.evil.example", ""),
        *(
            "evil@localhost",
            "a:b@127.0.0.1",
            "evil.example\\@localhost",
            "\tlocalhost\tevil",
            "localhost/evil",
            "localhost?x",
        ),
        *(
            "localhost#x",
            "localhost:x",
            "localhost:",
            "127.0.0.1:80:80",
            "[::1]evil.example",
            "[v1.a]",
            "[::1",
            "127.1",
        ),
    ],
)
async def test_other_names_get_no_answer(bench, name):
    assert (await bench.browser(name=name).get("/api/v1/status")).status == 421


@pytest.mark.parametrize("name", ["LOCALHOST", "[::1]:8502", "10.0.0.7", "[fe80::1]"])
async def test_addresses_and_localhost_are_ours(bench, name):
    assert (await bench.browser(name=name).get("/api/v1/status")).status == 200


@pytest.mark.parametrize("host", ["", "Host: localhost\r\nHost: evil.example\r\n"])
async def test_a_request_without_a_host_or_with_two_gets_no_answer_and_no_look_up(bench, monkeypatch, host):
    monkeypatch.setattr(socket, "getfqdn", lambda: pytest.fail("asks a name server"))
    wire = Wire(bench.connect(None), "127.0.0.1")
    wire.arrive(f"GET /api/v1/status HTTP/1.0\r\n{host}\r\n".encode())
    await asyncio.sleep(1)
    assert wire.received.partition(b"\r\n")[0][9:12] in (b"400", b"421")


async def test_pages_of_other_sites_do_not_make_a_browser_ask_devices(bench):
    assert (await bench.browser().get(PLACE, Sec_Fetch_Site="cross-site")).status == 403
    assert (await bench.browser().get(PLACE, Sec_Fetch_Site="same-origin")).status == 200


async def test_an_operator_writes_once_and_by_name(bench):
    browser = bench.browser(AFAR)
    assert (await browser.log_in("anna")).json["may_write"] is True
    page = await browser.put(PLACE, [77])
    assert page.json["values"] == [{"address": 3, "reference": "40004", "value": 77, "registers": [77]}]
    assert (await browser.get(PLACE)).json["values"][0]["value"] == 77
    (audit,) = bench.events("write_audit")
    assert (audit.client, audit.listener, audit.unit, audit.address, audit.result) == (
        "web:anna@10.2.0.7",
        "web",
        200,
        3,
        "ok",
    )


async def test_a_viewer_only_reads(bench):
    browser = bench.browser(AFAR)
    assert (await browser.log_in("vera")).json["may_write"] is False
    assert (await browser.get(PLACE)).status == 200
    assert "needs the role operator" in (await browser.put(PLACE, [77])).problem
    assert (await browser.post("/api/v1/reload")).status == 403
    assert await written(bench) == []


async def test_this_machine_needs_a_login_to_write_too(bench):
    assert (await bench.browser().put(PLACE, [77])).status == 401
    assert (await bench.browser().post("/api/v1/reload")).status == 401
    assert await written(bench) == []


async def test_nothing_is_written_unless_the_config_says_so(tmp_path):
    async with web_bench(CONFIG, tmp_path, write=False) as bench:
        browser = bench.browser()
        assert (await browser.log_in("anna")).json["may_write"] is False
        assert "write = true" in (await browser.put(PLACE, [77])).problem
        assert (await browser.post("/api/v1/reload")).status == 200
        assert await written(bench) == []


@pytest.mark.parametrize(
    ("rows", "may_read", "may_write"),
    [
        ('[[access]]\nlisten = ["web"]\nallow = ["read"]\n', 200, 403),
        ('[[access]]\nlisten = ["web"]\nfrom = ["10.2.0.7"]\nallow = ["read", "write"]\n', 200, 200),
        ('[[access]]\nlisten = ["web"]\nfrom = ["10.9.0.0/24"]\nallow = ["read", "write"]\n', 403, 403),
        ('[[access]]\nlisten = ["default"]\nallow = ["read"]\n', 200, 200),
    ],
)
async def test_rows_of_access_that_name_web_count(tmp_path, rows, may_read, may_write):
    async with web_bench(CONFIG + rows, tmp_path) as bench:
        browser = bench.browser(AFAR)
        await browser.log_in("anna")
        assert (await browser.get(PLACE)).status == may_read
        page = await browser.put(PLACE, [77])
        assert page.status == may_write
        if may_write == 403:
            assert (page.json["exception"], page.json["result"]) == (1, "denied")


@pytest.mark.parametrize(
    "forged",
    [
        {"Origin": None},
        {"Origin": "null"},
        {"Origin": "http://evil.example"},
        {"Origin": "http://127.0.0.1:9000"},
        {"Origin": f"ftp://{HOST}"},
        {"X_CSRF_Token": None},
        {"X_CSRF_Token": "forged"},
        {"X_CSRF_Token": "\xe9"},
    ],
)
async def test_what_a_page_of_somebody_else_sends_is_refused(bench, forged):
    browser = bench.browser()
    await browser.log_in("anna")
    assert (await browser.put(PLACE, [77], **forged)).status == 403
    assert (await browser.post("/api/v1/reload", **forged)).status == 403
    assert (await browser.post("/logout", **forged)).status == 403
    if "Origin" in forged:
        assert (
            await bench.browser().post("/login", {"user": "anna", "password": "correct horse"}, **forged)
        ).status == 403
    assert await written(bench) == []
    assert (await browser.get("/api/v1/session")).json["user"] == "anna"


async def test_the_token_of_another_session_is_none(bench):
    anna, vera = bench.browser(), bench.browser()
    await anna.log_in("anna")
    await vera.log_in("vera")
    anna.csrf = vera.csrf
    assert (await anna.put(PLACE, [77])).status == 403


@pytest.mark.parametrize(("user", "password", "known"), [("anna", "wrong", "anna"), ("nobody", "correct horse", "")])
async def test_a_wrong_password_lets_nobody_in(bench, user, password, known):
    browser = bench.browser(AFAR)
    page = await browser.post("/login", {"user": user, "password": password})
    assert page.status == 401
    assert "User or password is wrong" in page.text
    assert "Set-Cookie" not in page.headers
    assert (await browser.get("/api/v1/status")).status == 401
    (failed,) = bench.events("web_login_failed")
    assert (failed.client, failed.user) == ("web@10.2.0.7", known)
    assert password not in repr(bench.inner.events)


async def test_who_guesses_must_wait(bench):
    browser = bench.browser(AFAR)
    for _ in range(MOST_FAILURES):
        assert (await browser.log_in("anna", "wrong")).status == 401
    page = await browser.log_in("anna")
    assert (page.status, int(page.headers["Retry-After"])) == (429, FAILURES_COUNT_FOR)
    assert (await bench.browser("10.2.0.8").log_in("anna")).status == 200
    await asyncio.sleep(FAILURES_COUNT_FOR)
    assert (await browser.log_in("anna")).status == 200


async def test_a_customer_of_ipv6_has_one_address(bench):
    for number in range(MOST_FAILURES):
        assert (await bench.browser(f"2001:db8::{number}").log_in("anna", "wrong")).status == 401
    assert (await bench.browser("2001:db8::99").log_in("anna")).status == 429


@pytest.mark.parametrize("way", ["idle", "long", "logout", "removed", "password"])
async def test_a_session_ends(bench, way):
    browser = bench.browser(AFAR)
    await browser.log_in("anna")
    if way == "idle":
        await asyncio.sleep(IDLE_TIME + 1)
    elif way == "long":
        for _ in range(int(LONGEST_SESSION / IDLE_TIME) + 1):
            assert (await browser.get("/api/v1/status")).status == 200
            await asyncio.sleep(IDLE_TIME)
    elif way == "logout":
        assert (await browser.post("/logout", {"csrf": browser.csrf}, X_CSRF_Token=None)).status == 303
    elif way == "removed":
        bench.users.write_text(f"vera:viewer:{CHEAP_HASH}\n")
        await asyncio.sleep(6)
    else:
        bench.users.write_text(bench.users.read_text().replace("AAAA==", "BAAA=="))
        await asyncio.sleep(6)
    assert (await browser.get("/api/v1/status")).status == 401
    assert (await browser.put(PLACE, [77])).status == 401
    assert await written(bench) == []


async def test_a_file_that_breaks_while_it_runs_is_told_once_and_those_before_stay(bench):
    bench.users.write_text("nonsense\n")
    await asyncio.sleep(30)
    (rejected,) = bench.events("web_users_rejected")
    assert f"{bench.users}:1" in rejected.reason
    assert (await bench.browser().log_in("anna")).status == 200
    bench.users.write_text(f"otto:viewer:{CHEAP_HASH}\n")
    await asyncio.sleep(6)
    assert (await bench.browser().log_in("anna")).status == 401
    assert (await bench.browser().log_in("otto")).status == 200


async def test_a_file_that_others_may_read_is_not_used_any_more(bench):
    bench.users.chmod(0o644)
    await asyncio.sleep(6)
    assert "chmod o=,g-w" in bench.events("web_users_rejected")[0].reason


async def test_the_token_reads_and_does_nothing_else(tmp_path):
    async with web_bench(CONFIG, tmp_path, token="s3cret") as bench:
        scraper = bench.browser(AFAR)
        bearer = {"Authorization": "Bearer s3cret"}
        assert (await scraper.get("/metrics", **bearer)).status == 200
        assert (await scraper.get(PLACE, **bearer)).status == 200
        assert (await scraper.put(PLACE, [77], **bearer)).status == 401
        assert (await scraper.get(PLACE, Authorization="Bearer wrong")).status == 401
        assert (await bench.browser().get("/metrics")).status == 401
        assert (await bench.browser().get("/api/v1/status")).status == 200


async def test_a_proxy_names_the_user_and_nobody_else_does(tmp_path):
    async with web_bench(CONFIG, tmp_path, proxy=(ip_network("10.0.0.2"),), hosts=("gw.plant.local",)) as bench:
        proxy, other = bench.browser("10.0.0.2"), bench.browser("10.0.0.3")
        assert (await other.get(PLACE, X_Forwarded_User="anna")).status == 401
        assert (await proxy.get(PLACE)).status == 401
        assert (await proxy.get("/api/v1/session", X_Forwarded_User="stranger")).json["role"] == "viewer"
        anna = (await proxy.get("/api/v1/session", X_Forwarded_User="anna")).json
        assert (anna["role"], anna["may_write"]) == ("operator", True)
        named = {"X_Forwarded_User": "anna", "Origin": "https://gw.plant.local"}
        assert (await proxy.put(PLACE, [77], **named)).status == 403
        assert (await proxy.put(PLACE, [77], **named, X_CSRF_Token=anna["csrf"])).status == 200
        assert await written(bench) == ["web:anna@10.0.0.2"]


async def test_a_proxy_on_this_machine_must_name_somebody(tmp_path):
    async with web_bench(CONFIG, tmp_path, proxy=(ip_network("127.0.0.0/8"),)) as bench:
        assert (await bench.browser().get(PLACE)).status == 401
        assert (await bench.browser().get(PLACE, X_Forwarded_User="vera")).status == 200


async def test_the_cookie_is_for_this_site_only(bench, tmp_path):
    page = await bench.browser().log_in("anna")
    assert {"HttpOnly", "SameSite=Strict", "Path=/"} <= set(page.headers["Set-Cookie"].split("; "))
    assert "Secure" not in page.headers["Set-Cookie"]


async def test_with_https_the_cookie_is_secure(tmp_path):
    async with web_bench(CONFIG, tmp_path, tls=ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)) as bench:
        page = await bench.browser().log_in("anna")
        assert page.headers["Set-Cookie"].startswith("__Host-mbgw=")
        assert "Secure" in page.headers["Set-Cookie"].split("; ")


@pytest.mark.parametrize(("tls", "cookie"), [(None, "mbgw"), (ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER), "__Host-mbgw")])
async def test_the_document_of_the_api_names_the_cookie_that_is_sent(tmp_path, tls, cookie):
    async with web_bench(CONFIG, tmp_path, tls=tls) as bench:
        document = (await bench.browser().get("/api/v1/openapi.json")).json
        assert document["components"]["securitySchemes"]["session"]["name"] == cookie


@pytest.mark.parametrize("path", ["/", "/login", "/static/page.css", "/api/v1/status", "/healthz", "/nothing"])
async def test_each_response_says_what_a_browser_may_do_with_it(bench, path):
    headers = (await bench.browser().get(path)).headers
    policy = headers["Content-Security-Policy"].split("; ")
    assert "default-src 'self'" in policy
    assert "frame-ancestors 'none'" in policy
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert headers["Referrer-Policy"] == "same-origin"
    assert "aiohttp" not in headers["Server"]
