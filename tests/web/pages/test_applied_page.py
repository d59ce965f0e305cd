"""Configs that were in use are listed, shown without secrets, and can be taken back."""

import pytest

from kit.browser import web_bench
from kit.markup import Markup

CONFIG = """
[[line]]
name = "hall"
port = "/dev/hall"
profile = "meter"
devices = [{ unit = 6, as = 46 }]  # geheim
"""


@pytest.fixture
async def bench(tmp_path):
    (tmp_path / "profiles").mkdir()
    (tmp_path / "profiles" / "meter.toml").write_text("[profile.meter]\nmargin = 2\n# geheim\n")
    async with web_bench(CONFIG.replace('profile = "meter"\n', ""), tmp_path) as bench:
        yield bench


@pytest.fixture
def file(tmp_path):
    return tmp_path / "gateway.toml"


async def reloaded(bench, file, *texts):
    anna = bench.browser()
    await anna.log_in("anna")
    for text in texts:
        file.write_text(text)
        await anna.post("/config/reload")
    return anna


def rows(page):
    return [row for row in Markup(page.text).rows() if row[0].startswith("20")]


def links(page):
    return [part.partition('"')[0] for part in page.text.split('href="/config/applied/')[1:]]


async def test_each_config_that_was_in_use_is_listed_with_what_it_changed(bench, file):
    anna = await reloaded(bench, file, CONFIG, CONFIG.replace("46", "47"), CONFIG.replace("46", "47") + "[trace]\n")
    page = await anna.get("/config")
    assert [row[1:] for row in rows(page)] == [
        ["+1 \u22120", "in use"],
        ["+1 \u22121", ""],
        ["\u2013", ""],
    ]


async def test_a_file_that_is_rejected_is_not_kept(bench, file):
    anna = await reloaded(bench, file, CONFIG, "line = 3", CONFIG)
    assert len(rows(await anna.get("/config"))) == 1


async def test_one_is_shown_with_its_differences_and_the_way_back(bench, file, tmp_path):
    anna = await reloaded(bench, file, CONFIG, CONFIG.replace("46", "47"), CONFIG.replace("46", "48"))
    second = links(await anna.get("/config"))[1]
    page = await anna.get(f"/config/applied/{second}")
    texts = Markup(page.text).texts
    assert any("-devices = [{ unit = 6, as = 47" in each for each in texts)
    assert any("+devices = [{ unit = 6, as = 48" in each for each in texts)
    assert any("-devices = [{ unit = 6, as = 46" in each for each in texts)
    kept = tmp_path / "state" / "configs" / second / "gateway.toml"
    assert f"install -m 644 {kept} {file}.new" in " ".join(texts)
    assert kept.read_text() == CONFIG.replace("46", "47")
    assert "geheim" not in page.text
    assert "meter" in texts
    assert (kept.parent / "profiles" / "meter.toml").exists()


async def test_another_text_of_a_profile_is_another_config(bench, file, tmp_path):
    anna = await reloaded(bench, file, CONFIG)
    (tmp_path / "profiles" / "meter.toml").write_text("[profile.meter]\nmargin = 3\n")
    await anna.post("/config/reload")
    assert len(rows(await anna.get("/config"))) == 2


@pytest.mark.parametrize(("user", "status"), [("", 403), ("vera", 403), ("anna", 200)])
async def test_only_operators_see_one(bench, file, user, status):
    anna = await reloaded(bench, file, CONFIG)
    (name,) = links(await anna.get("/config"))
    browser = bench.browser()
    if user:
        await browser.log_in(user)
    assert (await browser.get(f"/config/applied/{name}")).status == status
    assert bool(links(await browser.get("/config"))) is (user == "anna")
    assert (await bench.browser("10.0.0.9").get(f"/config/applied/{name}")).status == 303


@pytest.mark.parametrize("name", ["000009-20260501T120000Z", "..%2f..%2fusers", "000001-20260501T120000Z%2f..", "x"])
async def test_what_is_not_kept_is_not_found(bench, file, name):
    anna = await reloaded(bench, file, CONFIG)
    assert (await anna.get(f"/config/applied/{name}")).status == 404


async def test_a_folder_that_cannot_be_written_changes_nothing_else(bench, file, tmp_path):
    (tmp_path / "state").write_text("no folder")
    anna = await reloaded(bench, file, CONFIG.replace("46", "47"))
    page = await anna.get("/config")
    assert "None is kept yet." in page.text
    assert "applied" in page.text
    assert list(bench.running.gateway.lines[0].devices) == [47]
    assert len(bench.events("state_not_kept")) == 1


async def test_included_files_are_kept_and_taken_back_too(bench, file, tmp_path):
    folder = tmp_path / "conf.d"
    folder.mkdir()
    (folder / "a.toml").write_text(CONFIG)
    (folder / "b.toml").write_text("[trace]\n")
    anna = await reloaded(bench, file, 'include = ["conf.d/*.toml"]\n')
    (folder / "a.toml").write_text(CONFIG.replace("46", "47"))
    (folder / "c.toml").write_text("[log]\n")
    await anna.post("/config/reload")
    assert [row[1:] for row in rows(await anna.get("/config"))] == [["+3 \u22121", "in use"], ["\u2013", ""]]
    first = links(await anna.get("/config"))[1]
    texts = " ".join(Markup((await anna.get(f"/config/applied/{first}")).text).texts)
    kept = tmp_path / "state" / "configs" / first / "include" / "conf.d%2Fa.toml"
    assert f"install -D -m 644 {kept} {folder}/a.toml" in texts
    assert f"mv {folder}/c.toml {folder}/c.toml.before" in texts
    assert f"{folder}/b.toml" not in texts
    assert kept.read_text() == CONFIG
    assert "geheim" not in texts


async def test_the_config_page_sees_a_change_of_an_included_file(bench, file, tmp_path):
    (tmp_path / "b.toml").write_text(CONFIG)
    anna = await reloaded(bench, file, 'include = ["b.toml"]\n')
    assert "as = 47" not in (await anna.get("/config")).text
    (tmp_path / "b.toml").write_text(CONFIG.replace("46", "47"))
    assert "as = 47" in (await anna.get("/config")).text
