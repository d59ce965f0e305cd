"""The diagnostics bundle over HTTP: for operators, with the rights of the door."""

import io
import json
import tarfile

import pytest

from gateway.events import LineLost
from kit.browser import web_bench
from kit.bundles import documents_in
from kit.device import SimulatedDevice, SimulatedLine

CONFIG = """
[[line]]
name = "hall"
port = "/dev/hall"
devices = [{ unit = 6, as = 46, name = "press" }, { unit = 7, as = 47, name = "oven" }]

[[access]]
listen = ["web"]
units = 46
allow = ["read"]

[[access]]
allow = ["read", "write"]
listen = ["default"]
"""
FORM = "application/x-www-form-urlencoded"


@pytest.fixture
async def bench(tmp_path, monkeypatch):
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))
    async with web_bench(CONFIG, tmp_path) as bench:
        bench.inner.attach("hall", SimulatedLine("rtu", SimulatedDevice(6), SimulatedDevice(7)))
        yield bench


async def fetched(browser, path="/api/v1/support"):
    """The answer as bytes: a page of text would not be one."""
    body = f"csrf={browser.csrf}".encode()
    wire = browser.open(
        path,
        method="POST",
        body=body,
        headers={"Connection": "close", "Origin": f"http://{browser.name}", "Content-Type": FORM},
    )
    await wire.closed.wait()
    head, _, content = bytes(wire.received).partition(b"\r\n\r\n")
    if b"chunked" in head:
        content = _unchunked(content)
    return int(head.split()[1]), head.decode(), content


def _unchunked(data):
    stream, parts = io.BytesIO(data), []
    while size := int(stream.readline(), 16):
        parts.append(stream.read(size))
        stream.readline()
    return b"".join(parts)


async def test_an_operator_gets_a_file_by_a_form_and_nobody_else_does(bench):
    anna, vera = bench.browser(), bench.browser()
    await anna.log_in("anna")
    await vera.log_in("vera")
    status, head, content = await fetched(anna)
    assert status == 200
    assert 'attachment; filename="modbus-gateway.tar.gz"' in head
    assert {"README.txt", "status.json", "config/gateway.toml", "check.txt", "ports.json"} <= set(documents_in(content))
    assert (await fetched(vera))[0] == 403
    assert (await fetched(bench.browser()))[0] == 401


async def test_values_of_units_that_the_door_does_not_let_read_are_not_in_it(bench):
    client = bench.inner.client()
    await client.asks(46, "03 00 00 00 01")
    await client.asks(47, "03 00 00 00 01")
    anna = bench.browser()
    await anna.log_in("anna")
    _, _, content = await fetched(anna)
    traced = [json.loads(each) for each in documents_in(content)["trace.jsonl"].splitlines()]
    assert {each["name"]: each["request"] for each in traced if each["kind"] == "exchange"} == {
        "press": "03 00 00 00 01",
        "oven": None,
    }


async def test_the_last_events_are_in_it(bench):
    bench.running.emit(LineLost("hall", "/dev/hall", "/dev/hall does not exist"))
    anna = bench.browser()
    await anna.log_in("anna")
    _, _, content = await fetched(anna)
    events = [json.loads(each) for each in documents_in(content)["events.jsonl"].splitlines()]
    assert "line_lost" in {each["event"] for each in events}


async def test_it_can_be_without_the_trace(bench):
    anna = bench.browser()
    await anna.log_in("anna")
    _, _, content = await fetched(anna, "/api/v1/support?trace=false")
    with tarfile.open(fileobj=io.BytesIO(content), mode="r:gz") as archive:
        assert not [each for each in archive.getnames() if each.endswith("trace.jsonl")]
