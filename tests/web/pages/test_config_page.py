"""The page of the config: what is in use, what check says of the file now, what a reload would change."""

import pytest

from kit.browser import web_bench
from kit.markup import Markup
from kit.pki import listener

CONFIG = """
[[line]]
name = "hall"
port = "/dev/hall"
devices = [{ unit = 6, as = 46, name = "press <b>" }]  # by the door
# password = "geheim"
"""


@pytest.fixture
async def bench(tmp_path):
    async with web_bench(CONFIG, tmp_path) as bench:
        yield bench


@pytest.fixture
def file(tmp_path):
    return tmp_path / "gateway.toml"


async def operator(bench):
    browser = bench.browser()
    await browser.log_in("anna")
    return browser


async def shown(bench):
    page = await bench.browser().get("/config")
    assert page.status == 200, page.text
    return page.text


async def test_the_config_in_use_is_shown_without_secrets(bench, file):
    text = await shown(bench)
    assert "[[line]]" in text
    assert "press &lt;b&gt;" in text
    assert "by the door" not in text
    assert "geheim" not in text
    assert str(file) in text
    assert "It is the config in use." in text


async def test_what_is_wrong_with_the_file_now_is_shown_with_its_place(bench, file):
    file.write_text(CONFIG.replace('"/dev/hall"', '"/dev/hall"\nbaud = "fast"'))
    page = Markup(await shown(bench))
    (row,) = [row for row in page.rows() if row[0] == "error"]
    assert row[1].startswith("5:")
    assert "line[0].baud" in row[2]
    assert "cannot be used" in page.texts


async def test_what_is_wrong_with_the_file_of_a_profile_is_shown_with_that_file(bench, file, tmp_path):
    profile = tmp_path / "profiles" / "meter.toml"
    profile.parent.mkdir()
    profile.write_text("[profile.meter]\nmargin = 0\n")
    file.write_text(CONFIG.replace('"/dev/hall"', '"/dev/hall"\nprofile = "meter"'))
    (row,) = [row for row in Markup(await shown(bench)).rows() if row[0] == "error"]
    assert row[1:] == [f"{profile}:2:10", "profile.meter.margin: must be at least 1"]


async def test_certificates_that_cannot_be_used_are_warnings(bench, file):
    file.write_text(CONFIG + listener().replace("server.crt", "gone.crt"))
    (row,) = [row for row in Markup(await shown(bench)).rows() if "gone.crt" in " ".join(row)]
    assert row[0] == "warning"
    assert "cannot be used" in row[2]


async def test_a_file_that_is_gone_is_an_error(bench, file):
    file.unlink()
    assert "there is no such file" in await shown(bench)


async def test_what_a_reload_would_change_is_shown(bench, file):
    file.write_text(CONFIG.replace("as = 46", "as = 47") + '[[image]]\nunit = 200\nname = "shift"\nholding = 1\n')
    page = Markup(await shown(bench))
    assert "line hall" in page.texts
    assert "image shift" in page.texts
    assert not any("geheim" in text for text in page.texts)


@pytest.mark.parametrize(("user", "sees_lines"), [("", False), ("vera", False), ("anna", True)])
async def test_only_an_operator_sees_the_lines_that_differ(bench, file, user, sees_lines):
    file.write_text(CONFIG.replace("as = 46", "as = 47") + "# a comment\n")
    browser = bench.browser()
    if user:
        await browser.log_in(user)
    page = Markup((await browser.get("/config")).text)
    assert "line hall" in page.texts
    assert any(text.startswith("+devices = [{ unit = 6, as = 47") for text in page.texts) is sees_lines
    assert any("# a comment" in text or "as = 47" in text for text in page.texts) is sees_lines


async def test_another_space_changes_nothing_that_the_gateway_does(bench, file):
    file.write_text(CONFIG.replace("name =", "name  ="))
    assert "Nothing that the gateway does." in await shown(bench)


@pytest.mark.parametrize(
    "line", ["password hunter2", "password =\n'hunter2'", '"pass word" = hunter2', "name_ = hunter2"]
)
async def test_of_a_file_that_is_no_toml_no_line_is_shown(bench, file, line):
    """A remedy may repeat a value, and is for operators: who knows what a key with a slip was to be?"""
    file.write_text(f"{CONFIG}{line}\n")
    anna = await operator(bench)
    assert (await anna.post("/config/reload")).status == 303
    page = await shown(bench)
    assert "cannot be used" in page
    assert "rejected" in page
    assert "hunter2" not in page
    assert ("hunter2" in (await anna.get("/config")).text) is line.startswith("name_")


async def test_what_needs_a_restart_is_told(bench, file):
    file.write_text(CONFIG + '[log]\nlevel = "debug"\n')
    page = Markup(await shown(bench))
    assert "Applies after a restart" in page.texts
    assert "log" in page.texts


async def test_an_operator_reloads_it_and_is_told_the_outcome(bench, file):
    anna = await operator(bench)
    file.write_text(CONFIG.replace("as = 46", "as = 47"))
    page = await anna.post("/config/reload")
    assert (page.status, page.headers["Location"]) == (303, "/config")
    assert list(bench.running.gateway.lines[0].devices) == [47]
    text = await shown(bench)
    assert "applied" in text
    assert "as = 47" in text
    assert "It is the config in use." in text


async def test_a_file_with_errors_changes_nothing_and_is_told(bench, file):
    anna = await operator(bench)
    file.write_text("line = 3")
    assert (await anna.post("/config/reload")).status == 303
    text = await shown(bench)
    assert "rejected: the config before it is still in use" in text
    assert "is a list of tables" in text
    assert "as = 46" in text


@pytest.mark.parametrize("user", ["", "vera"])
async def test_nobody_else_reloads_it(bench, user):
    browser = bench.browser()
    if user:
        await browser.log_in(user)
    assert "Operators can reload it here." in (await browser.get("/config")).text
    assert (await browser.post("/config/reload")).status == (403 if user else 401)


async def test_a_reload_needs_the_token_of_the_session_and_our_origin(bench):
    anna = await operator(bench)
    assert (await anna.post("/config/reload", X_CSRF_Token="forged")).status == 403
    assert (await anna.post("/config/reload", Origin="http://evil.example")).status == 403
    assert bench.events("config_applied") == []


async def test_a_long_comparison_is_cut(bench, file):
    file.write_text(CONFIG + "\n" * 10_000)
    text = await shown(bench)
    assert len(text) < 30_000


async def test_it_is_shown_to_those_who_may_read(bench):
    assert (await bench.browser("10.0.0.9").get("/config")).status == 303


async def test_a_gateway_that_is_no_service_is_told_to_reload_without_sudo(bench, file):
    text = Markup(await shown(bench)).texts
    assert f"modbus-gateway check {file}" in " ".join(text)
    assert "sudo" not in " ".join(text)
