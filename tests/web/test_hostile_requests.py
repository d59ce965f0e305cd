"""Requests that no browser sends for a page of ours: none of them is a defect, none leads to somebody else."""

import gzip

import pytest

from kit.browser import web_bench

CONFIG = """
[[image]]
unit = 200
name = "shift"
holding = 20
"""
LONG = "1" * 5000
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
    assert 'href="?y=1&amp;lang=zh"' in page.text
    assert 'href="//' not in page.text


async def test_what_is_packed_is_not_unpacked(bench):
    anna = bench.browser()
    form = gzip.compress(b"user=anna&password=correct+horse")
    kind = {"Content-Type": "application/x-www-form-urlencoded", "Content-Encoding": "gzip"}
    page = await anna.ask("POST", "/login", form, {"Origin": f"http://{anna.name}", **kind})
    assert page.status == 401
