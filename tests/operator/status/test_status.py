"""One snapshot that tells how the whole gateway is doing."""

import asyncio
import json
from dataclasses import asdict, astuple, replace

import pytest

from gateway.lines.counts import Counts
from gateway.operator.operations.answers.status import LineStatus, MovedStatus, RangeStatus, Status, UnitStatus
from gateway.operator.operations.operation import Asker, Nothing
from gateway.operator.operator import Operator
from gateway.operator.status.status import status_in_slices, tell_status
from gateway.operator.values.requests import AT_CONTROL
from gateway.request import Caller
from gateway.state.memory import Memory
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import Client, GatewayBench, gateway_bench
from kit.statuses import status

CONFIG = """
[[listen]]
name = "scada"
bind = "tcp://127.0.0.1:5021"
unit0 = "broadcast"

[[line]]
name    = "hall-a"
port    = "/dev/hall-a"
baud    = 9600
timeout = "200 ms"
devices = [{ unit = 1, as = 41, name = "silo" }, { unit = 6, name = "press", profile = "v80" }]

[[line]]
name    = "hall-b"
port    = "/dev/hall-b"
mode    = "ascii"
devices = [{ unit = 2 }]

[[image]]
unit    = 200
name    = "shift"
holding = 10
"""
MIRROR = """
[[image]]
unit = 241
name = "silo-mirror"
of   = "silo"
read = [{ coils = "0-7", every = "10 s" }]
"""
SERVER = """
[[line]]
name   = "panel"
port   = "/dev/panel"
mode   = "ascii"
role   = "server"
serves = [200, 41]
"""
READ = "03 00 00 00 01"


def snapshot(bench: GatewayBench) -> Status:
    return status(bench.running)


def line(bench: GatewayBench, name: str = "hall-a") -> LineStatus:
    return next(each for each in snapshot(bench).lines if each.name == name)


def unit(bench: GatewayBench, number: int = 41) -> UnitStatus:
    return next(each for each in snapshot(bench).units if each.unit == number)


def attach(bench: GatewayBench) -> SimulatedDevice:
    device = SimulatedDevice(1)
    bench.attach("hall-a", SimulatedLine("rtu", device))
    return device


async def rests(client: Client) -> None:
    """Unit 41 fails until it rests."""
    for _ in range(3):
        assert await client.asks(41, READ) == "83 0B"
        await asyncio.sleep(1.0)


async def test_before_the_start_no_line_was_tried() -> None:
    assert [(each.state, each.reason) for each in snapshot(GatewayBench(CONFIG)).lines] == [("not tried", "")] * 2


async def test_the_lines_are_those_of_the_config() -> None:
    async with gateway_bench(CONFIG) as bench:
        first, second = snapshot(bench).lines
        assert (first.name, first.port, first.state) == ("hall-a", "/dev/hall-a", "up")
        assert (first.mode, first.baud, first.format) == ("rtu", 9600, "8E1")
        assert (second.mode, second.baud, second.format) == ("ascii", 19200, "7E1")
        assert first.source.endswith(":7")


async def test_a_line_that_is_down_says_why() -> None:
    async with gateway_bench(CONFIG) as bench:
        bench.lines["hall-a"].pull("it was pulled")
        await asyncio.sleep(5)
        assert (line(bench).state, line(bench).reason) == ("down", "it was pulled")
        bench.lines["hall-a"].plug()
        await asyncio.sleep(5)
        assert (line(bench).state, line(bench).reason) == ("up", "")


async def test_what_waits_and_what_is_awaited() -> None:
    async with gateway_bench(CONFIG) as bench:
        client = bench.client()
        for _ in range(3):
            client.ask(6, READ)
        assert line(bench).queue == 2
        await asyncio.sleep(10.0)
        assert (line(bench).queue, line(bench).late_windows) == (0, 0)
        await bench.client().asks(41, READ)
        assert line(bench).late_windows == 1
        assert line(bench, "hall-b").late_windows == 0


async def test_counts_of_units_and_their_line() -> None:
    async with gateway_bench(CONFIG) as bench:
        device, client = attach(bench), bench.client()
        await client.asks(41, READ)
        device.refuses[6] = 4
        await client.asks(41, "06 00 01 00 05")
        client.ask(0, "06 00 01 00 05")
        await client.asks(6, READ)
        silo = unit(bench)
        assert silo.counts == Counts(ok=1, exception=1, sent=2, responses=2)
        assert silo.functions == {3: Counts(ok=1, sent=1, responses=1), 6: Counts(exception=1, sent=1, responses=1)}
        assert (silo.exceptions, silo.last_error) == ({4: 1}, "exception 04")
        assert line(bench).counts == Counts(ok=1, exception=1, timeout=1, broadcast=1, sent=4, responses=2)
        assert 0.1 < line(bench).busy_s < 2.0
        assert sum(astuple(line(bench).phases)) == pytest.approx(line(bench).busy_s, abs=0.005)


async def test_the_share_and_the_rate_of_a_line_are_those_of_the_last_minute() -> None:
    async with gateway_bench(CONFIG) as bench:
        began = snapshot(bench).at - 1.0
        sampling = asyncio.create_task(bench.recent.keep_sampling(lambda: bench.gateway))
        assert (line(bench).busy_share, line(bench).requests_per_s) == (0, 0)
        attach(bench)
        client = bench.client()
        for _ in range(100):
            await client.asks(41, READ)
        await asyncio.sleep(50.0)
        now = snapshot(bench)
        assert now.lines[0].busy_share == pytest.approx(now.lines[0].busy_s / (now.at - began), abs=0.001)
        assert now.lines[0].requests_per_s == pytest.approx(100 / (now.at - began), abs=0.1)
        assert now.lines[0].busy_share > 0.02
        await asyncio.sleep(70.0)
        assert (line(bench).busy_share, line(bench).requests_per_s) == (0, 0)
        assert line(bench).busy_s == now.lines[0].busy_s
        sampling.cancel()


async def test_a_line_in_its_first_second_has_no_rate() -> None:
    bench = GatewayBench(CONFIG)
    assert line(bench).busy_share is None


async def test_times_of_a_unit_and_of_each_function() -> None:
    async with gateway_bench(CONFIG) as bench:
        attach(bench)
        client = bench.client()
        for _ in range(20):
            await client.asks(41, READ)
        await client.asks(41, "06 00 01 00 05")
        silo = unit(bench)
        assert set(silo.function_times) == {3, 6}
        assert silo.times.limit_ms == max(each.limit_ms for each in silo.function_times.values())
        assert 0 < silo.times.answer_p50_ms <= silo.times.answer_p99_ms < silo.times.limit_ms
        assert 0 < silo.times.limit_share_p99 < 1
        never_asked = unit(bench, 6).times
        assert set(astuple(replace(never_asked, late=None))) == {None}


async def test_how_long_ago_a_unit_has_answered_and_failed() -> None:
    async with gateway_bench(CONFIG) as bench:
        device = attach(bench)
        client = bench.client()
        assert (unit(bench).last_answer_ms, unit(bench).last_error_ms) == (None, None)
        device.refuses[3] = 2
        await client.asks(41, READ)
        await asyncio.sleep(3.0)
        assert (unit(bench).last_answer_ms, unit(bench).last_error_ms) == (3000, 3000)


async def test_clients_and_when_they_asked_last() -> None:
    async with gateway_bench(CONFIG) as bench:
        (listener,) = bench.gateway.listeners
        client = bench.client("10.0.0.9:49152")
        listener.connections.enter(client.session, asyncio.get_running_loop().time())
        (before,) = snapshot(bench).clients
        assert (before.client, before.listener, before.asked_ms) == ("10.0.0.9:49152", "scada", None)
        await client.asks(200, READ)
        await asyncio.sleep(2.0)
        assert snapshot(bench).clients[0].asked_ms == 2000


async def test_a_unit_fails_and_rests_and_is_fine_again() -> None:
    async with gateway_bench(CONFIG) as bench:
        client = bench.client()
        assert (unit(bench).state, unit(bench).failures, unit(bench).rests_ms) == ("fine", 0, 0)
        await client.asks(41, READ)
        assert (unit(bench).state, unit(bench).failures, unit(bench).last_error) == ("failing", 1, "timeout")
        await asyncio.sleep(1.0)
        await rests(client)
        assert unit(bench).state == "resting"
        assert 0 < unit(bench).rests_ms < 10_000
        assert unit(bench, 6).state == "fine"
        attach(bench)
        await asyncio.sleep(unit(bench).rests_ms / 1000 + 0.01)
        assert (unit(bench).state, unit(bench).rests_ms) == ("failing", 0)
        await client.asks(41, READ)
        assert (unit(bench).state, unit(bench).last_error) == ("fine", "timeout")


async def test_a_unit_says_who_it_is_and_how_long_a_client_may_have_to_wait() -> None:
    """In the queue for 2 s; then 3.5 characters, the longest request and response and 200 ms, and 5 ms for the port."""
    async with gateway_bench(CONFIG) as bench:
        silo = unit(bench)
        assert (silo.line, silo.on_the_wire, silo.name, silo.profile) == ("hall-a", 1, "silo", "generic")
        characters = 4.5 + 256 + 256  # the V80 on the line needs a silence of 4.5
        assert silo.longest_wait_ms >= 2000 + 200 + 5
        assert silo.longest_wait_ms <= 2000 + characters * 11 / 9.6 + 200 + 5


async def test_units_behind_another_server() -> None:
    text = '[[upstream]]\nname = "plant-1"\nto = "tcp://10.1.0.5"\nunits = [{ as = 37, unit = 7 }]\n'
    async with gateway_bench(text) as bench:
        client = bench.client()
        client.ask(37, READ)
        client.ask(37, READ)
        (plant,) = snapshot(bench).upstreams
        assert (plant.name, plant.to, plant.state) == ("plant-1", "tcp://10.1.0.5:502", "up")
        assert (plant.queue, plant.under_way, plant.overdue) == (1, 1, 0)
        bench.lines[plant.to].deliver(bytes.fromhex("7777 0000 0005 07 03 02 0007"))
        await asyncio.sleep(5)
        (plant,) = snapshot(bench).upstreams
        assert (plant.queue, plant.under_way, plant.overdue, plant.unasked_frames) == (0, 0, 2, 1)
        assert plant.counts == Counts(timeout=1, bad_frame=1, explained=1, sent=2)
        behind = unit(bench, 37)
        assert (behind.line, behind.on_the_wire, behind.state) == ("plant-1", 7, "failing")
        assert (behind.counts, behind.longest_wait_ms) == (plant.counts, 3000)
        bench.lines[plant.to].pull("it was pulled")
        await asyncio.sleep(0.01)
        (plant,) = snapshot(bench).upstreams
        assert (plant.state, plant.reason, plant.overdue) == ("down", "it was pulled", 0)


async def test_listeners_and_what_they_refuse() -> None:
    async with gateway_bench(CONFIG) as bench:
        reader = bench.client(host="10.0.0.9")
        await reader.asks(41, "06 00 01 00 05")
        await reader.asks(99, READ)
        await reader.asks(99, READ)
        (scada,) = snapshot(bench).listeners
        assert (scada.name, scada.address, scada.clients) == ("scada", "tcp://127.0.0.1:5021", 0)
        assert (scada.denied, scada.no_route) == (1, 2)


async def test_images() -> None:
    async with gateway_bench(CONFIG) as bench:
        client = bench.client()
        await client.asks(200, READ)
        await client.asks(200, "03 00 64 00 01")
        (image,) = snapshot(bench).images
        assert (image.unit, image.name, image.requests, image.exceptions) == (200, "shift", 2, 1)


async def test_mirrors() -> None:
    async with gateway_bench(CONFIG + MIRROR) as bench:
        attach(bench)
        await asyncio.sleep(10.0)
        (mirror,) = snapshot(bench).mirrors
        assert (mirror.unit, mirror.name, mirror.of) == (241, "silo-mirror", "silo")
        assert (mirror.polls, mirror.failed_polls) == (2, 1)
        assert mirror.ranges == (RangeStatus("coils 0-7", 10000.0, 5773.8),)


async def test_a_snapshot_is_json_and_changes_no_more() -> None:
    async with gateway_bench(CONFIG) as bench:
        attach(bench)
        before = snapshot(bench)
        text = json.dumps(asdict(before))
        await bench.client().asks(41, READ)
        assert json.dumps(asdict(before)) == text
        assert replace(snapshot(bench), at=before.at) != before


@pytest.mark.parametrize("part", ["listeners", "lines", "units", "images", "mirrors"])
async def test_each_part_is_in_the_json(part: str) -> None:
    async with gateway_bench(CONFIG + MIRROR) as bench:
        assert json.loads(json.dumps(asdict(snapshot(bench))))[part]


async def test_a_server_line_shows_what_it_serves_and_what_became_of_its_requests() -> None:
    async with gateway_bench(CONFIG + SERVER) as bench:
        for text in (":C8030000000134", ":C8030000000135", ":070300000001F5"):
            bench.lines["panel"].deliver(text.encode() + b"\r\n")
            await asyncio.sleep(0.1)
        (server,) = snapshot(bench).servers
        assert (server.name, server.port, server.state, server.mode) == ("panel", "/dev/panel", "up", "ascii")
        assert (server.serves, server.source) == ((41, 200), "gateway.toml:25")
        counts = server.counts
        assert (counts.requests, counts.responses, counts.noise, counts.foreign_frames) == (1, 1, 1, 1)
        bench.lines["panel"].pull("unplugged")
        await asyncio.sleep(0.1)
        assert (snapshot(bench).servers[0].state, snapshot(bench).servers[0].reason) == ("down", "unplugged")
        assert json.dumps(asdict(server))


async def test_lines_work_while_the_status_of_many_units_is_made(monkeypatch):
    monkeypatch.setattr("gateway.clock.slices._SLICE", 0.0)
    units = ", ".join(f"{{ unit = {unit} }}" for unit in range(1, 101))
    async with gateway_bench(f'[[line]]\nname = "hall"\nport = "/dev/hall"\ndevices = [{units}]') as bench:
        running = bench.running
        making, turns = asyncio.create_task(status_in_slices(running)), 0
        while not making.done():
            await asyncio.sleep(0)
            turns += 1
        assert turns > 100
        monkeypatch.undo()
        assert making.result() == snapshot(bench)


async def test_a_unit_that_is_elsewhere_than_the_config_says() -> None:
    memory, config = Memory(), CONFIG.replace('name = "silo"', 'name = "silo", profile = "weigher", timeout = "200 ms"')
    memory.remember("/dev/hall-a silo", 1, 5, 7)
    async with gateway_bench(config, memory) as bench:
        assert snapshot(bench).moved == (MovedStatus("hall-a", 41, "silo", (5, 7), 1, 0),)
        await rests(bench.client())
        assert snapshot(bench).moved[0].failures == 3
    async with gateway_bench(config) as bench:
        assert snapshot(bench).moved == ()


async def test_over_http_it_may_be_a_second_old_and_at_the_control_socket_it_is_that_of_now():
    async with gateway_bench(CONFIG) as bench:
        operator = Operator(bench.running, None)
        at_control = Asker(AT_CONTROL, lambda: True)
        over_http = Asker(Caller("web@10.0.0.9", "10.0.0.9", "10.0.0.9"), lambda: True, "10.0.0.9", "web")
        first = await tell_status(operator, Nothing(), over_http)
        await asyncio.sleep(0.5)
        assert await tell_status(operator, Nothing(), over_http) is first
        assert (await tell_status(operator, Nothing(), at_control)).at == pytest.approx(first.at + 0.5)
        await asyncio.sleep(0.5)
        assert (await tell_status(operator, Nothing(), over_http)).at == pytest.approx(first.at + 1.0)


async def test_a_config_that_was_rejected_is_wrong_until_one_is_accepted() -> None:
    async with gateway_bench(CONFIG) as bench:
        for succeeded, wrong in ((True, []), (False, [("fix", "config")]), (True, [])):
            bench.running.reload_succeeded = succeeded
            told = await tell_status(Operator(bench.running, None), Nothing(), Asker(AT_CONTROL, lambda: True))
            assert [(each.kind, each.name) for each in told.troubles] == wrong


async def test_what_is_wrong_is_told_and_one_failure_of_a_unit_that_answers_is_not() -> None:
    async with gateway_bench(CONFIG) as bench:
        operator, client = Operator(bench.running, None), bench.client()

        async def wrong() -> list[tuple[str, str]]:
            told = await tell_status(operator, Nothing(), Asker(AT_CONTROL, lambda: True))
            return [(each.kind, each.name) for each in told.troubles]

        device = attach(bench)
        await client.asks(41, READ)
        assert await wrong() == []
        device.silent = True
        assert await client.asks(41, READ) == "83 0B"
        assert unit(bench).state == "failing"
        assert await wrong() == []
        await client.asks(6, READ)
        assert await wrong() == [("failing", "press")]
        await asyncio.sleep(1.0)
        for _ in range(2):
            await client.asks(41, READ)
            await asyncio.sleep(1.0)
        bench.lines["hall-b"].pull("it was pulled")
        await asyncio.sleep(1.0)
        assert await wrong() == [("down", "hall-b"), ("resting", "silo"), ("failing", "press")]
