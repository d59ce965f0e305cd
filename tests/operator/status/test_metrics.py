"""What a scrape tells of a gateway."""

import asyncio

import pytest

from gateway.observe.families import Family, Spread
from gateway.operator.status.metrics import read
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import GatewayBench, gateway_bench

CONFIG = """
[[listen]]
name = "scada"
bind = "tcp://127.0.0.1:5021"
unit0 = "broadcast"

[[line]]
name    = "hall-a"
port    = "/dev/hall-a"
timeout = "200 ms"
devices = [{ unit = 1, as = 41, name = "silo" }, { unit = 6, name = "press" }]

[[upstream]]
name = "plant-1"
to = "tcp://10.1.0.5"
units = [{ as = 37, unit = 7 }]

[[image]]
unit = 241
name = "silo-mirror"
of   = "silo"
read = [{ coils = "0-7", every = "10 s" }]
"""
READ = "03 00 00 00 01"


async def scrape(bench: GatewayBench) -> dict[str, Family]:
    return {family.name: family for family in await read(bench.running)}


async def values(bench: GatewayBench, name: str) -> dict[tuple[str, ...], float | Spread]:
    """Those that are not 0."""
    found = (await scrape(bench))[name].values
    return {labels: value for labels, value in found if value}


def attach(bench: GatewayBench) -> SimulatedDevice:
    device = SimulatedDevice(1)
    bench.attach("hall-a", SimulatedLine("rtu", device))
    return device


async def test_requests_by_what_became_of_them() -> None:
    async with gateway_bench(CONFIG) as bench:
        device, client = attach(bench), bench.client()
        await client.asks(41, READ)
        device.refuses[6] = 2
        await client.asks(41, "06 00 01 00 05")
        await client.asks(41, "65")
        await client.asks(6, READ)
        await client.asks(99, READ)
        await bench.client(host="10.0.0.9").asks(41, "06 00 01 00 05")
        client.ask(0, "06 00 01 00 05")
        await asyncio.sleep(1.0)
        requests = await values(bench, "requests")
        assert requests["hall-a", "41", "3", "ok"] == 1
        assert requests["hall-a", "41", "6", "exception"] == 1
        assert requests["hall-a", "6", "3", "timeout"] == 1
        assert requests["hall-a", "0", "6", "broadcast"] == 1
        assert {labels[2] for labels in requests} >= {"other", "1"}
        assert requests["", "", "", "no_route"] == 1
        assert requests["", "", "", "denied"] == 1
        assert (await values(bench, "exceptions"))["hall-a", "41", "02"] == 1


async def test_results_that_may_come_are_there_from_the_first_request_on() -> None:
    async with gateway_bench(CONFIG) as bench:
        attach(bench)
        await bench.client().asks(41, READ)
        told = {
            labels[3] for labels, _ in (await scrape(bench))["requests"].values if labels[:3] == ("hall-a", "41", "3")
        }
        assert told == {"ok", "exception", "timeout", "bad_frame"}


async def test_histograms_count_up_to_each_bound() -> None:
    async with gateway_bench(CONFIG) as bench:
        attach(bench)
        for _ in range(5):
            await bench.client().asks(41, READ)
        for name in ("request_duration_seconds", "device_response_seconds", "queue_wait_seconds", "budget_used_ratio"):
            spread = (await values(bench, name))["hall-a", "41", "3"]
            counts = [count for _, count in spread.buckets]
            assert counts == sorted(counts)
            assert (counts[-1], spread.count) == (5, 5)
        assert [bound for bound, _ in spread.buckets] == [0.25, 0.5, 0.75, 0.8, 0.9, 1.0]


async def test_lines_units_and_upstreams() -> None:
    async with gateway_bench(CONFIG) as bench:
        attach(bench)
        await asyncio.sleep(10.0)
        client = bench.client()
        await client.asks(41, READ)
        await client.asks(6, READ)
        assert await values(bench, "line_up") == {("hall-a",): 1}
        assert set(await values(bench, "line_busy_seconds")) == {
            ("hall-a", each) for each in ("request", "wait", "response", "gap")
        }
        assert await values(bench, "unit_up") == {("hall-a", "41"): 1}
        assert (await values(bench, "unit_timeout_limit_seconds"))["hall-a", "41"] == pytest.approx(0.2, abs=0.05)
        assert await values(bench, "upstream_up") == {("plant-1",): 1}
        assert 0 < (await values(bench, "image_age_seconds"))["241",] <= 10
        assert await values(bench, "config_last_reload_successful") == {(): 1}
        bench.lines["hall-a"].pull("it was pulled")
        await asyncio.sleep(1.0)
        assert await values(bench, "line_up") == {}
        assert await values(bench, "unit_up") == {}
        bench.lines["hall-a"].plug()
        await asyncio.sleep(5.0)
        assert await values(bench, "line_reopens") == {("hall-a",): 1}


async def test_a_mirror_without_values_has_no_age() -> None:
    async with gateway_bench(CONFIG) as bench:
        assert await values(bench, "image_age_seconds") == {}


async def test_no_label_holds_who_asks_or_what_he_asks() -> None:
    """Whatever clients send, the number of series has a bound: the functions of units that are configured."""
    async with gateway_bench(CONFIG) as bench:
        attach(bench)
        for number in range(1, 128):
            client = bench.client(f"10.0.0.{number}:1000", host="127.0.0.1")
            client.ask(41, f"{number:02X} 00 {number:02X} 00 01")
            client.ask(number + 100, READ)
            await asyncio.sleep(0.1)
        labels = {labels for family in (await scrape(bench)).values() for labels, _ in family.values}
        assert not any("10.0.0" in label for each in labels for label in each)
        functions = {labels[2] for labels, _ in (await scrape(bench))["request_duration_seconds"].values}
        assert len(functions) <= 21
        units = {labels[1] for labels, _ in (await scrape(bench))["requests"].values}
        assert units <= {"", "0", "6", "37", "41"}


async def test_lines_work_while_the_metrics_of_many_units_are_read(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.clock.slices._SLICE", 0.0)
    async with gateway_bench('[[line]]\nname = "hall"\nport = "/dev/hall"\ndevices = [{ unit = "1-100" }]\n') as bench:
        for device in bench.gateway.lines[0].devices.values():
            device.counts[3].ok += 1
        making, turns = asyncio.create_task(scrape(bench)), 0
        while not making.done():
            await asyncio.sleep(0)
            turns += 1
        assert turns > 300
        assert len([1 for labels, _ in making.result()["requests"].values if labels[3] == "ok"]) == 100
