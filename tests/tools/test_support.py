"""What a running gateway tells for a diagnostics bundle. In virtual time."""

import asyncio
import json

from kit.asking import answers
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import gateway_bench

CONFIG = """
[[line]]
name = "hall"
port = "/dev/hall"
timeout = "100 ms"
devices = [{ unit = 6, as = 46, name = "press" }, { unit = 7, as = 47, name = "oven" }]
"""


async def told(bench, **asked):
    found: dict[str, str] = {}
    missing: dict[str, str] = {}
    for each in await answers(bench.running, {"verb": "support", **asked}):
        assert len(each.get("text", "")) <= 200_000
        if each.get("missing"):
            missing[each["name"]] = each["missing"]
        else:
            found[each["name"]] = found.get(each["name"], "") + each.get("text", "")
    return found, missing


async def test_all_documents_are_there_and_nothing_is_sent_for_them():
    async with gateway_bench(CONFIG) as bench:
        bench.attach("hall", SimulatedLine("rtu", SimulatedDevice(6)))
        await bench.client().asks(46, "03 00 00 00 01")
        before = bench.running.ring.added
        found, missing = await told(bench)
        assert bench.running.ring.added == before
        assert missing == {}
        assert json.loads(found["status.json"])["lines"][0]["name"] == "hall"
        assert json.loads(found["inventory.json"])["devices"][0]["name"] == "press"
        assert json.loads(found["doctor.json"])["findings"]
        assert "events.jsonl" in found
        assert "modbus_gateway_requests_total" in found["metrics.txt"]
        assert json.loads(found["trace.jsonl"].splitlines()[-1])["request"] == "03 00 00 00 01"


async def test_the_trace_is_that_of_five_minutes_and_failures_are_kept_longer():
    async with gateway_bench(CONFIG) as bench:
        bench.attach("hall", SimulatedLine("rtu", SimulatedDevice(6)))
        assert await bench.client().asks(47, "03 00 00 00 09") == "83 0B"
        await asyncio.sleep(301)
        await bench.client().asks(46, "03 00 00 00 01")
        found, _ = await told(bench)
        (traced,) = [json.loads(each) for each in found["trace.jsonl"].splitlines()]
        assert traced["name"] == "press"
        (failed,) = [json.loads(each) for each in found["failures.jsonl"].splitlines()]
        assert (failed["name"], failed["result"]) == ("oven", "timeout")


async def test_without_the_trace_there_are_no_values():
    async with gateway_bench(CONFIG) as bench:
        bench.attach("hall", SimulatedLine("rtu", SimulatedDevice(6)))
        await bench.client().asks(46, "03 00 00 00 01")
        await bench.client().asks(47, "03 00 00 00 01")
        found, missing = await told(bench, trace=False)
        assert set(missing) == {"trace.jsonl", "failures.jsonl"}
        assert not any("03 00 00 00 01" in text for text in found.values())


async def test_a_gateway_that_keeps_no_trace_says_so_and_tells_the_rest():
    async with gateway_bench(f'{CONFIG}[trace]\nring = "0"\n') as bench:
        found, missing = await told(bench)
        assert missing == {"trace.jsonl": "the config keeps no trace"}
        assert found["failures.jsonl"] == ""
