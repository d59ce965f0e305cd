"""Programs with a token of their own: what it is good for, and what attackers try with it. In virtual time."""

import asyncio
import io
import json
import tarfile
from ipaddress import ip_network

import pytest

from gateway.readconfig.page_users import new_token, token_hash
from gateway.web.access.sessions import FAILURES_COUNT_FOR, IDLE_TIME, MOST_FAILURES
from kit.browser import PASSWORD, USERS, web_bench

CONFIG = """
[[image]]
unit = 200
name = "shift"
holding = 10
"""
PLACE = "/api/v1/units/200/holding/3"
AFAR = "10.2.0.7"
MES, WALL = new_token(), new_token()
WRONG = {
    "another": new_token(),
    "shorter": MES[:-1],
    "longer": MES + "A",
    "in capitals": MES.upper(),
    "without its beginning": MES.removeprefix("mbgw_"),
    "with its name": f"mes:{MES}",
    "its hash": token_hash(MES),
    "not ASCII": "\xe9",
    "only its beginning": "mbgw_",
}
#: Nothing of this machine, and no page of ours, is in what a program sends.
BARE = {"Origin": None, "X_CSRF_Token": None}


def entries(*programs: tuple[str, str, str]) -> str:
    return USERS + "".join(f"{name}:{role}:{token_hash(token)}\n" for name, role, token in programs)


def bearer(token: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {token}"}


async def with_programs(bench) -> None:
    bench.users.write_text(entries(("mes", "operator", MES), ("wall", "viewer", WALL)))
    await asyncio.sleep(6)


@pytest.fixture
async def bench(tmp_path, monkeypatch):
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))
    async with web_bench(CONFIG, tmp_path) as bench:
        await with_programs(bench)
        yield bench


def written(bench) -> list[str]:
    return [each.client for each in bench.events("write_audit")]


async def test_an_operators_token_reads_writes_and_reloads_without_cookie_origin_or_csrf_token(bench):
    program = bench.browser(AFAR)
    page = await program.put(PLACE, [77], **BARE, **bearer(MES))
    assert page.json["values"][0]["value"] == 77
    assert (await program.get(PLACE, **bearer(MES))).json["values"][0]["value"] == 77
    assert (await program.get("/metrics", **bearer(MES))).status == 200
    assert (await program.post("/api/v1/reload", **BARE, **bearer(MES))).status == 200
    assert program.cookies == {}
    assert written(bench) == ["web:mes@10.2.0.7"]


async def test_a_viewers_token_reads_and_does_nothing_else(bench):
    program = bench.browser(AFAR)
    assert (await program.get(PLACE, **bearer(WALL))).status == 200
    told = (await program.get("/api/v1/session", **bearer(WALL))).json
    assert (told["user"], told["role"], told["may_write"]) == ("wall", "viewer", False)
    for page in (
        await program.put(PLACE, [77], **bearer(WALL)),
        await program.post("/api/v1/reload", **bearer(WALL)),
        await program.post("/api/v1/support", **bearer(WALL)),
        await program.put("/api/v1/config/check", "", **bearer(WALL)),
    ):
        assert page.status in (403, 405)
    assert "wall is a viewer" in (await program.put(PLACE, [77], **bearer(WALL))).problem
    denied = bench.events("web_denied")[-1]
    assert (denied.client, denied.role, denied.method) == ("web:wall@10.2.0.7", "viewer", "PUT")
    assert denied.path.startswith("/api/v1/units/{unit}/")
    assert written(bench) == []


async def test_a_token_writes_nothing_unless_the_config_says_so(tmp_path):
    async with web_bench(CONFIG, tmp_path, write=False) as bench:
        await with_programs(bench)
        assert "write = true" in (await bench.browser().put(PLACE, [77], **BARE, **bearer(MES))).problem
        assert written(bench) == []


@pytest.mark.parametrize(
    ("rows", "may_read", "may_write"),
    [
        ('[[access]]\nlisten = ["web"]\nallow = ["read"]\n', 200, 403),
        ('[[access]]\nlisten = ["web"]\nfrom = ["10.9.0.0/24"]\nallow = ["read", "write"]\n', 403, 403),
    ],
)
async def test_rows_of_access_that_name_web_count_for_tokens(tmp_path, rows, may_read, may_write):
    async with web_bench(CONFIG + rows, tmp_path) as bench:
        await with_programs(bench)
        program = bench.browser(AFAR)
        assert (await program.get(PLACE, **bearer(MES))).status == may_read
        assert (await program.put(PLACE, [77], **bearer(MES))).status == may_write
        assert all(audit.result == "denied" for audit in bench.events("write_audit"))


@pytest.mark.parametrize("host", [AFAR, "127.0.0.1"])
@pytest.mark.parametrize("shown", list(WRONG.values()), ids=list(WRONG))
async def test_a_wrong_token_is_no_token_on_this_machine_either(bench, host, shown):
    program = bench.browser(host)
    for path in ("/api/v1/status", "/metrics", "/", PLACE):
        page = await program.get(path, **bearer(shown))
        assert page.status == 401, path
        assert page.headers["WWW-Authenticate"].startswith("Bearer")
    assert (await program.put(PLACE, [77], **BARE, **bearer(shown))).status == 401
    assert (await program.get("/healthz", **bearer(shown))).status == 200
    assert written(bench) == []


@pytest.mark.parametrize("name", ["access_token", "token", "bearer", "Authorization"])
async def test_a_token_in_the_address_counts_nothing(bench, name):
    program = bench.browser(AFAR)
    assert (await program.get(f"/api/v1/status?{name}={MES}")).status == 401
    assert (await program.put(f"{PLACE}?{name}={MES}", [77])).status == 401
    assert written(bench) == []


@pytest.mark.parametrize(
    "headers",
    [
        {"Authorization": f"Basic {MES}"},
        {"Authorization": MES},
        {"Authorization": f"Token {MES}"},
        {"Authorization": f"Bearer, Bearer {MES}"},
        {"Cookie": f"mbgw={MES}"},
        {"X_CSRF_Token": MES},
        {"X_Forwarded_User": "mes"},
    ],
    ids=["basic", "bare", "token", "twice", "cookie", "csrf", "proxy"],
)
async def test_a_token_elsewhere_counts_nothing(bench, headers):
    program = bench.browser(AFAR)
    assert (await program.get("/api/v1/status", **headers)).status == 401
    assert (await program.put(PLACE, [77], **headers)).status == 401
    assert written(bench) == []


async def test_a_page_of_another_site_gains_nothing_by_asking_to_send_a_token(bench):
    page = await bench.browser().ask(
        "OPTIONS",
        PLACE,
        headers={
            "Origin": "http://evil.example",
            "Access-Control-Request-Method": "PUT",
            "Access-Control-Request-Headers": "authorization",
        },
    )
    assert page.status == 405
    assert not [name for name in page.headers if name.lower().startswith("access-control")]
    assert (await bench.browser(name="evil.example").put(PLACE, [77], **bearer(MES))).status == 421


@pytest.mark.parametrize("missing", [{"Origin": None}, {"X_CSRF_Token": None}])
@pytest.mark.parametrize("token", [MES, WALL, new_token()], ids=["operator", "viewer", "wrong"])
async def test_a_session_beside_a_token_still_needs_the_proofs_of_a_page(bench, missing, token):
    browser = bench.browser(AFAR)
    await browser.log_in("anna")
    assert (await browser.put(PLACE, [77], **missing, **bearer(token))).status == 403
    assert written(bench) == []


async def test_a_program_without_its_token_is_told_that_it_needs_one(bench):
    page = await bench.browser().put(PLACE, [77], **BARE)
    assert (page.status, "a program sends its token" in page.text) == (403, True)


async def test_a_wrong_csrf_token_or_origin_does_not_matter_to_a_program(bench):
    page = await bench.browser(AFAR).put(PLACE, [5], Origin="http://localhost:3000", X_CSRF_Token="x", **bearer(MES))
    assert page.status == 200


@pytest.mark.parametrize(("site", "status"), [("cross-site", 403), ("same-site", 403), ("same-origin", 200)])
async def test_a_proxy_that_adds_a_token_opens_no_way_for_pages_of_other_sites(bench, site, status):
    page = await bench.browser(AFAR).put(PLACE, [5], **BARE, **{"Sec-Fetch-Site": site}, **bearer(MES))
    assert page.status == status


async def test_nobody_logs_in_with_a_token(bench):
    browser = bench.browser(AFAR)
    assert (await browser.log_in("mes", MES)).status == 401
    assert browser.cookies == {}
    (failed,) = bench.events("web_login_failed")
    assert failed.user == ""


async def test_pages_answer_a_program_as_they_answer_a_user(bench):
    program = bench.browser(AFAR)
    page = await program.get("/", **bearer(MES))
    assert page.status == 200
    assert "mes (operator)" in " ".join(page.text.split())
    assert 'action="/logout"' not in page.text
    assert (await program.post("/logout", **BARE, **bearer(MES))).status == 303
    assert (await program.get("/", **bearer(MES))).status == 200


@pytest.mark.parametrize(
    "left",
    [entries(("wall", "viewer", WALL)), entries(("mes", "operator", new_token())), USERS, ""],
    ids=["removed", "replaced", "only users", "nobody"],
)
async def test_a_token_that_was_removed_or_replaced_ends_without_a_restart(bench, left):
    program = bench.browser("127.0.0.1")
    events = program.open("/api/v1/events", headers={"Connection": "close", **bearer(MES)})
    await asyncio.sleep(1)
    assert events.received.startswith(b"HTTP/1.1 200")
    bench.users.write_text(left)
    await asyncio.sleep(30)
    assert events.is_closing()
    assert (await program.get("/api/v1/status", **bearer(MES))).status == 401
    assert (await program.put(PLACE, [77], **BARE, **bearer(MES))).status == 401
    assert written(bench) == []


async def test_a_role_that_was_changed_counts_from_then_on(bench):
    bench.users.write_text(entries(("mes", "viewer", MES)))
    await asyncio.sleep(6)
    assert (await bench.browser(AFAR).put(PLACE, [77], **bearer(MES))).status == 403


async def test_who_sends_wrong_tokens_must_wait_and_locks_nobody_out(bench):
    program = bench.browser(AFAR)
    for _ in range(MOST_FAILURES):
        assert (await program.get(PLACE, **bearer(new_token()))).status == 401
    for _ in range(20):
        page = await program.get(PLACE, **bearer(new_token()))
        assert (page.status, int(page.headers["Retry-After"])) == (429, FAILURES_COUNT_FOR)
    assert len(bench.events("web_login_failed")) == MOST_FAILURES
    assert (await program.get(PLACE, **bearer(MES))).status == 200
    assert (await program.log_in("anna")).status == 200
    await asyncio.sleep(FAILURES_COUNT_FOR)
    assert (await bench.browser(AFAR).get(PLACE, **bearer(new_token()))).status == 401


async def test_wrong_passwords_do_not_keep_a_program_out(bench):
    browser = bench.browser(AFAR)
    for _ in range(MOST_FAILURES + 1):
        await browser.log_in("mes", "wrong")
    assert (await browser.get(PLACE, **bearer(MES))).status == 200


async def test_the_log_tells_when_a_program_begins_to_ask_and_from_where(bench):
    here, afar = bench.browser(), bench.browser(AFAR)
    for _ in range(3):
        await here.get("/api/v1/status", **bearer(WALL))
        await afar.get("/api/v1/status", **bearer(WALL))
        await asyncio.sleep(IDLE_TIME - 1)
    told = [(each.client, each.user) for each in bench.events("web_login")]
    assert told == [("web@127.0.0.1", "wall"), ("web@10.2.0.7", "wall")]
    await asyncio.sleep(2)
    await here.get("/api/v1/status", **bearer(WALL))
    assert len(bench.events("web_login")) == 3


async def test_the_token_of_the_config_stays_what_it_is(tmp_path):
    async with web_bench(CONFIG, tmp_path, token="s3cret") as bench:
        await with_programs(bench)
        program = bench.browser(AFAR)
        assert (await program.get(PLACE, **bearer("s3cret"))).status == 200
        assert (await program.put(PLACE, [77], **bearer("s3cret"))).status == 401
        assert (await program.get("/metrics", **bearer(WALL))).status == 200
        assert bench.events("web_login")[0].user == "wall"


async def test_a_proxy_that_names_a_program_gets_no_role_of_it(tmp_path):
    async with web_bench(CONFIG, tmp_path, proxy=(ip_network("10.0.0.2"),)) as bench:
        await with_programs(bench)
        proxy = bench.browser("10.0.0.2")
        assert (await proxy.get("/api/v1/session", X_Forwarded_User="mes")).json["role"] == "viewer"
        assert (await proxy.get("/api/v1/session", **bearer(MES))).json["role"] == "operator"


async def test_a_token_stands_nowhere_but_with_its_program(bench):
    program = bench.browser(AFAR)
    wrong = new_token()
    await program.put(PLACE, [77], **bearer(MES))
    await program.get(f"/api/v1/status?access_token={MES}", **bearer(MES))
    await program.get(PLACE, **bearer(wrong))
    bench.users.write_text(entries(("mes", "operator", MES)) + "broken\n")
    await asyncio.sleep(6)
    texts = [(await program.get(path, **bearer(MES))).text for path in _TELLING]
    texts += [await _bundle(program), *(str(each) for each in bench.inner.events), repr(bench.inner.events)]
    for text in texts:
        for secret in (MES, wrong, token_hash(MES).rpartition("$")[2]):
            assert secret not in text


_TELLING = (
    *("/", "/config", "/clients", "/events", "/metrics", "/api/v1/config", "/api/v1/status", "/api/v1/session"),
    *("/api/v1/inventory", "/api/v1/events/last", "/api/v1/openapi.json"),
)


async def _bundle(program) -> str:
    wire = program.open(
        "/api/v1/support", method="POST", headers={"Connection": "close", "Content-Length": "0", **bearer(MES)}
    )
    await wire.closed.wait()
    head, _, body = bytes(wire.received).partition(b"\r\n\r\n")
    assert head.split()[1] == b"200"
    lines, parts = io.BytesIO(body), []
    while size := int(lines.readline(), 16):
        parts.append(lines.read(size))
        lines.readline()
    with tarfile.open(fileobj=io.BytesIO(b"".join(parts))) as bundle:
        files = [bundle.extractfile(each) for each in bundle if each.isfile()]
        return "\n".join(each.read().decode(errors="replace") for each in files if each is not None)


async def test_a_wrong_token_is_told_as_a_problem_that_programs_can_read(bench):
    page = await bench.browser(AFAR).get("/api/v1/status", **bearer(new_token()))
    assert page.problem == "the token is wrong, or was removed"
    assert json.loads(page.text)["title"] == "Unauthorized"


async def test_a_password_that_looks_like_a_token_is_a_password(bench):
    assert (await bench.browser(AFAR).get(PLACE, **bearer(PASSWORD))).status == 401
