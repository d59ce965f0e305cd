"""What the daemon finds wrong on its lines: in virtual time, with devices that are not as the config says."""

import asyncio
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import pytest

from gateway.devices.device import Device
from gateway.errors import WrongQuestion
from gateway.events import RequestTimeout
from gateway.fleet.status import FleetStatus
from gateway.modbus.mbap import MbapFramer, encode
from gateway.plant.status import BrokerStatus
from gateway.ports.port import CharacterErrors
from gateway.tools.questions import outcome_of
from gateway.tools.scan import opened
from kit import mapped_hall
from kit.asking import answers, ask
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import gateway_bench

CONFIG = """
[[line]]
name = "hall"
port = "/dev/hall"
baud = 19200
wire = "direct"
devices = [{ unit = 1, as = 41, name = "silo" }, { unit = 6, name = "press" }]
"""


def is_there():
    return True


async def found(bench, **request):
    """The findings as (level, about, what), and the answer."""
    answer = await ask(bench.running, "doctor", **request)
    return [(each.level, each.about, each.what) for each in answer["findings"]]


def fixes(rows):
    return [what for level, _, what in rows if level == "fix"]


def attach_at(bench, baud, format_, *devices):
    """Let devices answer who are set to this rate and format, and hear nothing at another one."""
    bench.attach("hall", SimulatedLine("rtu", *devices))
    line = bench.lines["hall"]
    answer = line.on_write
    bench.heard = []

    def hear(data):
        opened = bench.opened["hall"]
        bench.heard.append((opened.baud, str(opened.format)))
        if bench.heard[-1] == (baud, format_):
            answer(data)

    line.on_write = hear


def frames(bench):
    """What was sent: unit and function of each."""
    return [tuple(frame[:2]) for frame in split(bench.lines["hall"].take_written())]


def split(data):
    """All requests of these tests are eight bytes long."""
    return [data[at : at + 8] for at in range(0, len(data), 8)]


async def test_a_healthy_line_is_asked_a_little_and_is_ok():
    async with gateway_bench(CONFIG) as bench:
        bench.attach("hall", SimulatedLine("rtu", SimulatedDevice(1), SimulatedDevice(6)))
        assert await found(bench) == [
            ("ok", "hall", "2 units answer: 100 % of 8 requests"),
            ("note", "hall", "doctor has sent 8 reads of configured units"),
        ]
        assert sorted(frames(bench)) == [(1, 3)] * 4 + [(6, 3)] * 4


async def test_what_clients_have_asked_enough_is_not_asked_again():
    async with gateway_bench(CONFIG) as bench:
        bench.attach("hall", SimulatedLine("rtu", SimulatedDevice(1), SimulatedDevice(6)))
        client = bench.client()
        for unit in (41, 6) * 5:
            await client.asks(unit, "03 00 00 00 01")
        bench.lines["hall"].take_written()
        assert await found(bench) == [("ok", "hall", "2 units answer: 100 % of 10 requests")]
        assert frames(bench) == []


@pytest.mark.parametrize(("failures", "ask"), [(1, True), (3, True), (3, False)])
async def test_a_unit_that_has_stopped_answering_is_named(failures, ask):
    async with gateway_bench(CONFIG) as bench:
        bench.attach("hall", SimulatedLine("rtu", SimulatedDevice(1), SimulatedDevice(6)))
        client = bench.client()
        for unit in (41, 6) * 100:
            await client.asks(unit, "03 00 00 00 01")
        bench.attach("hall", SimulatedLine("rtu", SimulatedDevice(6)))
        for _ in range(failures):
            await client.asks(41, "03 00 00 00 01")
            await asyncio.sleep(5.0)
        (what,) = fixes(await found(bench, ask=ask))
        assert what.startswith("does not answer at the moment: its last ")


async def test_a_unit_that_answers_again_is_asked_and_is_ok():
    async with gateway_bench(CONFIG) as bench:
        bench.attach("hall", SimulatedLine("rtu", SimulatedDevice(1), SimulatedDevice(6)))
        client = bench.client()
        for unit in (41, 6) * 100:
            await client.asks(unit, "03 00 00 00 01")
        bench.attach("hall", SimulatedLine("rtu", SimulatedDevice(6)))
        for _ in range(3):
            await client.asks(41, "03 00 00 00 01")
        bench.attach("hall", SimulatedLine("rtu", SimulatedDevice(1), SimulatedDevice(6)))
        await asyncio.sleep(60.0)
        assert fixes(await found(bench)) == []


async def test_it_tells_that_its_time_was_too_short_for_all_silent_units():
    rows = ", ".join(f"{{ unit = {unit} }}" for unit in range(1, 31))
    async with gateway_bench(CONFIG[: CONFIG.index("devices")] + f"devices = [{rows}]") as bench:
        began = asyncio.get_running_loop().time()
        (note,) = [what for level, _, what in await found(bench) if level == "note" and "doctor has sent" in what]
        reads = int(note.removeprefix("doctor has sent ").partition(" ")[0])
        assert f"{reads} reads of configured units in 30 s, which was too short for all" in note
        assert 10 <= reads < 30
        assert asyncio.get_running_loop().time() - began > 30


PASSES_THROUGH = CONFIG[: CONFIG.index("devices")]


@pytest.mark.parametrize("config", [CONFIG, PASSES_THROUGH])
@pytest.mark.parametrize("pause", [5.0, 61.0])
async def test_a_line_that_has_died_is_not_ok(config, pause):
    async with gateway_bench(config) as bench:
        first, second = (1, 6) if config == PASSES_THROUGH else (41, 6)
        bench.attach("hall", SimulatedLine("rtu", SimulatedDevice(1), SimulatedDevice(6)))
        client = bench.client()
        for unit in (first, second) * 60:
            await client.asks(unit, "03 00 00 00 01")
        bench.attach("hall", SimulatedLine("rtu"))
        await client.asks(second, "03 00 00 00 01")
        await asyncio.sleep(pause)
        rows = await found(bench)
        assert fixes(rows) == ["none of its 2 units answers any more, though some have answered"]
        assert [row for row in rows if row[0] == "ok"] == []


async def test_a_unit_that_nobody_has_asked_for_a_minute_is_asked():
    async with gateway_bench(CONFIG) as bench:
        bench.attach("hall", SimulatedLine("rtu", SimulatedDevice(1), SimulatedDevice(6)))
        client = bench.client()
        for unit in (41, 6) * 5:
            await client.asks(unit, "03 00 00 00 01")
        await asyncio.sleep(61.0)
        (row,) = await found(bench, ask=False)
        assert row == ("note", "hall", "2 units have answered: 100 % of 10 requests, the last one 61 s ago")
        bench.lines["hall"].take_written()
        assert (await found(bench))[0] == ("ok", "hall", "2 units answer: 100 % of 12 requests")
        assert sorted(frames(bench)) == [(1, 3), (6, 3)]


async def test_another_client_is_a_note_once_it_is_heard_no_more():
    async with gateway_bench(CONFIG) as bench:
        bench.attach("hall", SimulatedLine("rtu", SimulatedDevice(1), SimulatedDevice(6)))
        for _ in range(4):
            bench.lines["hall"].deliver(bytes.fromhex("01 03 00 10 00 01 85 CF"))
            await asyncio.sleep(0.1)
        assert fixes(await found(bench)) == ["another client sends requests on this line: 4 were heard"]
        client = bench.client()
        for unit in (41, 6) * 100:
            await client.asks(unit, "03 00 00 00 01")
            await asyncio.sleep(0.5)
        rows = await found(bench)
        assert fixes(rows) == []
        assert rows[0][0] == "note"
        assert "4 were heard, the last one" in rows[0][2]


async def test_nothing_is_sent_when_that_is_not_wanted():
    async with gateway_bench(CONFIG) as bench:
        assert await found(bench, ask=False) == [("note", "hall", "not asked yet: 2 of 2 units")]
        assert frames(bench) == []


async def test_nothing_is_sent_any_more_once_nobody_waits_for_it():
    async with gateway_bench(CONFIG) as bench:
        await answers(bench.running, {"verb": "doctor"}, is_there=lambda: False)
        assert frames(bench) == []


async def test_an_examination_waits_for_another_one_but_not_for_ever():
    async with gateway_bench(CONFIG) as bench:
        async with bench.running.examining:
            with pytest.raises(WrongQuestion, match="another examination"):
                await asyncio.wait_for(ask(bench.running, "doctor", ask=False), 100)
        assert "findings" in await ask(bench.running, "doctor", ask=False)


@pytest.mark.parametrize(("baud", "format_"), [(9600, "8E1"), (19200, "8N1"), (19200, "8O1"), (4800, "8N1")])
async def test_wrong_rate_and_parity_are_found_and_the_line_goes_on(baud, format_):
    async with gateway_bench(CONFIG) as bench:
        bench.lines["hall"].is_virtual = False
        bench.lines["hall"].pull()
        await asyncio.sleep(1.0)
        bench.lines["hall"].plug()
        await asyncio.sleep(2.0)
        attach_at(bench, baud, format_, SimulatedDevice(1, delay=0.1), SimulatedDevice(6, delay=0.1))
        assert fixes(await found(bench)) == [f"nobody answers at 19200 8E1, but at {baud} {format_}"]
        attach_at(bench, 19200, "8E1", SimulatedDevice(1), SimulatedDevice(6))
        await asyncio.sleep(130.0)  # both units rest
        assert await bench.client().asks(41, "03 00 00 00 01") == "03 02 00 00"


async def test_no_other_rate_is_tried_while_one_unit_answers():
    async with gateway_bench(CONFIG) as bench:
        attach_at(bench, 19200, "8E1", SimulatedDevice(6))
        assert fixes(await found(bench)) == ["does not answer at address 1"]
        assert set(bench.heard) == {(19200, "8E1")}


async def test_no_other_rate_is_tried_where_another_client_asks():
    async with gateway_bench(CONFIG) as bench:
        for _ in range(4):
            bench.lines["hall"].deliver(bytes.fromhex("01 03 00 10 00 01 85 CF"))
            await asyncio.sleep(0.1)
        attach_at(bench, 9600, "8E1", SimulatedDevice(1))
        await found(bench)
        assert set(bench.heard) == {(19200, "8E1")}


async def test_a_device_at_an_address_that_is_not_configured_is_found():
    async with gateway_bench(CONFIG) as bench:
        bench.attach("hall", SimulatedLine("rtu", SimulatedDevice(2), SimulatedDevice(6)))
        rows = await found(bench)
        what = "does not answer at address 1, but a device that is not configured answers at 2: are addresses swapped?"
        assert fixes(rows) == [what]
        assert "one read to each of the addresses 2, 3, 4, 5, 7, 8, 9, 10, 41, 247" in rows[-1][2]
        assert {event.unit for event in bench.events if isinstance(event, RequestTimeout)} == {1}


async def test_only_reads_are_sent_for_whatever_is_looked_for():
    async with gateway_bench(CONFIG) as bench:
        await found(bench)
        assert {function for _, function in frames(bench)} == {3}


async def test_a_limit_that_is_too_short_is_found_without_any_client():
    async with gateway_bench(CONFIG.replace('name = "silo"', 'name = "silo", timeout = "50 ms"')) as bench:
        bench.attach("hall", SimulatedLine("rtu", SimulatedDevice(1, delay=0.12), SimulatedDevice(6)))
        (what,) = fixes(await found(bench))
        assert what == "one response came after the limit, the slowest after 115 ms (limit 59 ms)"


async def test_a_late_answer_is_told_with_the_limit_of_its_own_function():
    timing = '[{ fc = 3, items = 1, time = "10 ms" }, { fc = 4, items = 1, time = "100 ms" }]'
    table = f"[profile.two]\ntiming = {timing}\n"
    async with gateway_bench(table + CONFIG.replace('name = "silo"', 'name = "silo", profile = "two"')) as bench:
        bench.attach("hall", SimulatedLine("rtu", SimulatedDevice(1, delay=0.05), SimulatedDevice(6)))
        client = bench.client()
        await client.asks(41, "04 00 00 00 01")
        for _ in range(3):
            await client.asks(41, "03 00 00 00 01")
            await asyncio.sleep(1.0)
        (what,) = fixes(await found(bench, ask=False))
        assert what == "3 responses came after the limit, the slowest after 45.4 ms (limit 24 ms)"


async def test_two_devices_that_answer_one_after_the_other_are_found():
    async with gateway_bench(CONFIG) as bench:
        twins = SimulatedLine("rtu", SimulatedDevice(1), SimulatedDevice(6))
        answer = bytes.fromhex("01 03 02 00 00 B8 44")
        twins.devices[1].script.extend([[(0.01, answer), (0.05, answer)]] * 4)
        bench.attach("hall", twins)
        await ask(bench.running, "doctor", ask=False)
        client = bench.client()
        for _ in range(4):
            await client.asks(41, "03 00 00 00 01")
            await asyncio.sleep(0.2)
        assert fixes(await found(bench)) == ["4 responses came twice: two devices may have the address 1"]


async def test_damaged_responses_are_asked_for_until_they_show_what_damages_them():
    async with gateway_bench(CONFIG.replace("wire =", 'rest = "off"\nwire =')) as bench:
        twins = SimulatedLine("rtu", SimulatedDevice(1), SimulatedDevice(6))
        damaged = [[(0.01, bytes.fromhex(f"01 03 02 00 00 B8 {last:02X}"))] for last in range(1, 7)]
        twins.devices[1].script.extend([damaged[0], [], [], *damaged[1:]])
        bench.attach("hall", twins)
        await found(bench)
        assert any("two devices may have the address 1" in each for each in fixes(await found(bench)))


ANSWER = bytes.fromhex("01 03 02 00 00 B8 44")
DAMAGED = bytes.fromhex("01 03 02 00 00 B8 45")


@pytest.mark.parametrize("requests", [240, 0])
@pytest.mark.parametrize(
    ("responses", "said"),
    [
        ([(0.01, ANSWER), (0.05, ANSWER)], "20 responses came twice{}: two devices may have the address 1"),
        ([(0.01, DAMAGED)], "20 of {} responses were damaged{}"),
        ([(1.5, ANSWER)], "20 responses came after the limit, the slowest after 1.5 s (limit 1.01 s){}"),
        ([], "20 of {} requests were not answered{}"),
    ],
)
async def test_what_was_repaired_is_a_note_after_a_hundred_requests_or_some_minutes(responses, said, requests):
    """Each case is a fault of one unit, which answers as it should again."""
    async with gateway_bench(CONFIG.replace("wire =", 'rest = "off"\nwire =')) as bench:
        line = SimulatedLine("rtu", SimulatedDevice(1), SimulatedDevice(6))
        bench.attach("hall", line)
        client = bench.client()

        async def ask(times):
            for _ in range(times):
                await client.asks(41, "03 00 00 00 01")
                await asyncio.sleep(0.5)

        async def row():
            rows = [each for each in await found(bench, ask=False) if each[1] == "unit 41, silo"]
            return rows[0][0], rows[0][2]

        await ask(20)
        for _ in range(20):
            line.devices[1].script.append(responses)
            await ask(1)
            await asyncio.sleep(3.0)
        await ask(1)
        level, what = await row()
        assert (level, what) == ("fix", said.format(*(41,) * (said.count("{}") - 1), ""))
        await ask(requests)
        await asyncio.sleep(0 if requests else 400.0)
        level, what = await row()
        ago = f", the last one {'2 min' if requests else '7 min'} ago"
        assert (level, what) == ("note", said.format(*(41 + requests,) * (said.count("{}") - 1), ago))


async def test_wrong_characters_of_long_ago_are_a_note():
    async with gateway_bench(CONFIG) as bench:
        bench.attach("hall", SimulatedLine("rtu", SimulatedDevice(1), SimulatedDevice(6)))
        sampling = asyncio.create_task(bench.running.recent.keep_sampling(lambda: bench.gateway))
        bench.lines["hall"].errors = CharacterErrors(100, 0, 60, 0)
        await asyncio.sleep(30.0)
        (fix,) = fixes(await found(bench))
        await asyncio.sleep(400.0)
        rows = await found(bench)
        assert fixes(rows) == []
        said = fix.replace(" bit:", " bit, the last one 7 min ago:")
        assert ("note", "hall", said) in rows
        bench.lines["hall"].errors = CharacterErrors(1000, 0, 61, 0)
        assert fixes(await found(bench)) == [fix.replace("60 of 100 ", "61 of 1000 ")]
        sampling.cancel()


@pytest.mark.parametrize(("ago_ms", "level"), [(1000.0, "fix"), (720_000.0, "note")])
async def test_what_broker_and_sites_were_refused_long_ago_is_a_note(monkeypatch, ago_ms, level):
    values = BrokerStatus("mqtt://b", "", "up", "", None, "5", 1, 2, 2, 3, 9, 4, 0, 0, 0, 0, last_refused_ms=ago_ms)
    sites = FleetStatus("nats://n", "", "a", "up", "", "", None, 1, 0, 0, 0, 0, 0, 4, 0, 0, last_dropped_ms=ago_ms)
    async with gateway_bench(CONFIG) as bench:
        monkeypatch.setattr(bench.running.add_ons.mqtt, "status", lambda: values)
        monkeypatch.setattr(bench.running.add_ons.fleet, "status", lambda: sites)
        levels = {about: level for level, about, _ in await found(bench, ask=False)}
        assert (levels["broker mqtt://b"], levels["fleet nats://n"]) == (level, level)


async def test_what_the_driver_counts_is_among_the_findings():
    async with gateway_bench(CONFIG) as bench:
        bench.attach("hall", SimulatedLine("rtu", SimulatedDevice(1), SimulatedDevice(6)))
        bench.lines["hall"].errors = CharacterErrors(100, 0, 60, 0)
        assert fixes(await found(bench)) == ["60 of 100 characters had a wrong parity bit: the devices have another"]


async def test_a_line_without_a_port_is_named_and_its_port_is_to_be_looked_at():
    async with gateway_bench(CONFIG) as bench:
        bench.lines["hall"].pull("/dev/hall is held by another program")
        await asyncio.sleep(1.0)
        answer = await ask(bench.running, "doctor", line="hall")
        assert [each.what for each in answer["findings"]] == ["is down: /dev/hall is held by another program"]
        (port,) = answer["ports"]
        assert (port.line, port.port, port.is_open) == ("hall", "/dev/hall", False)


@pytest.mark.parametrize("is_held", [False, True])
async def test_of_a_port_it_is_told_whether_another_gateway_may_have_it(monkeypatch, is_held):
    async with gateway_bench(CONFIG) as bench:
        lease = SimpleNamespace(is_held=is_held)
        with monkeypatch.context() as patched:
            patched.setattr(bench.gateway.lines[0], "standby", SimpleNamespace(name="hall", lease=lease))
            (port,) = (await ask(bench.running, "doctor", ask=False))["ports"]
        assert port.is_standby is not is_held


async def test_a_client_that_leaves_before_its_response_is_named():
    async with gateway_bench(CONFIG) as bench:
        bench.attach("hall", SimulatedLine("rtu", SimulatedDevice(1), SimulatedDevice(6)))
        (listener,) = bench.gateway.listeners
        for _ in range(3):
            listener.left_early("10.2.0.7", 0.5)
        rows = await found(bench, line="hall")
        what = "closed its connection 3 times before its response came, the last time after 500 ms"
        assert ("fix", "client 10.2.0.7 of default", what) in rows
        await asyncio.sleep(720.0)
        rows = await found(bench, line="hall")
        assert ("note", "client 10.2.0.7 of default", f"{what}, the last one 12 min ago") in rows


async def test_a_line_that_does_not_exist_is_refused_with_one_that_does():
    async with gateway_bench(CONFIG) as bench:
        with pytest.raises(WrongQuestion, match='there is no line "hal"; did you mean "hall"'):
            await found(bench, line="hal")


async def test_an_operator_who_may_not_read_asks_nothing():
    rows = '[[access]]\nlisten = ["control"]\nallow = []\n[[access]]\nallow = ["read"]\n'
    async with gateway_bench(CONFIG + rows) as bench:
        assert await found(bench) == [("note", "hall", "not asked yet: 2 of 2 units")]
        assert frames(bench) == []


async def test_a_port_is_lent_and_comes_back():
    async with gateway_bench(CONFIG) as bench:
        line, (part,) = bench.lines["hall"], bench.gateway.lines
        async with bench.running.ports.lent(part, "a test"):
            assert not line.is_open
            assert str(part.reconnector.error) == "its port is lent to a test"
            assert await bench.client().asks(41, "03 00 00 00 01") == "83 0A"
        await asyncio.sleep(1.0)
        assert line.is_open


async def test_a_port_does_not_come_back_to_a_line_that_a_reload_has_removed():
    async with gateway_bench(CONFIG) as bench:
        (part,) = bench.gateway.lines
        async with bench.running.ports.lent(part, "a test"):
            bench.drop_lines()
            assert not bench.running.ports.keeps(part)
        await asyncio.sleep(1.0)
        assert not bench.lines["hall"].is_open


async def test_a_port_does_not_come_back_to_a_gateway_that_stops():
    async with gateway_bench(CONFIG) as bench:
        (part,) = bench.gateway.lines
        lent = bench.running.ports.lent(part, "a test")
        await lent.__aenter__()
    await lent.__aexit__(None, None, None)
    await asyncio.sleep(1.0)
    assert not bench.lines["hall"].is_open


async def test_a_port_is_lent_once_at_a_time():
    async with gateway_bench(CONFIG) as bench:
        (part,) = bench.gateway.lines
        async with bench.running.ports.lent(part, "a test"):
            with pytest.raises(WrongQuestion, match="the port of hall is lent already: its port is lent to a test"):
                async with bench.running.ports.lent(part, "another"):
                    pass
            assert not bench.lines["hall"].is_open
        await asyncio.sleep(1.0)
        assert bench.lines["hall"].is_open


async def test_a_port_comes_back_from_who_was_cancelled_before_he_had_it():
    async with gateway_bench(CONFIG) as bench:
        (part,) = bench.gateway.lines

        async def borrow():
            async with bench.running.ports.lent(part, "a test"):
                await asyncio.sleep(10.0)

        borrowing = asyncio.create_task(borrow())
        await asyncio.sleep(0)
        borrowing.cancel()
        await asyncio.wait((borrowing,))
        await asyncio.sleep(1.0)
        assert bench.lines["hall"].is_open


@pytest.mark.parametrize("stops", [False, True])
async def test_what_a_borrower_leaves_overdue_is_awaited(stops):
    """A response to a request of his is not taken for the response to a request of a client."""
    async with gateway_bench(CONFIG) as bench:
        (part,) = bench.gateway.lines
        async with bench.running.ports.lent(part, "a test") as borrowers:
            there = part.at_speed(9600)
            borrowers.append(there.driver.line)
            async with opened(there):
                asked = Device(replace(part.plan.devices[0], name="there"), there.driver)
                asking = asyncio.create_task(outcome_of(asked, 41, bytes.fromhex("03 00 00 00 01"), is_there))
                await asyncio.sleep(0.01)
            assert (await asking)[0].result == "line_lost"
            bench.running.ports._is_ending = stops
        now = asyncio.get_running_loop().time()
        assert part.driver.line.ledger.count_late(now) == 1
        assert len(bench.running.ports._left_behind.at("/dev/hall", now)) == stops
        bench.running.ports._is_ending = False


@pytest.mark.parametrize(("units", "looks"), [("[6, 41]", False), ('"all"', True)])
async def test_only_who_may_read_every_unit_looks_at_other_addresses(units, looks):
    row = f'[[access]]\nlisten = ["control"]\nunits = {units}\nallow = ["read"]\n'
    async with gateway_bench(CONFIG + row) as bench:
        await found(bench)
        asked = {unit for unit, _ in frames(bench)}
        assert asked > {1, 6} if looks else asked == {1, 6}


async def test_beside_a_device_asked_at_address_0_no_other_addresses_are_asked():
    config = CONFIG.replace("devices = [", 'devices = [{ unit = 0, as = 50, profile = "weigher" }, ')
    async with gateway_bench(config) as bench:
        await found(bench)
        assert {unit for unit, _ in frames(bench)} == {0, 1, 6}


async def test_nothing_is_asked_for_a_line_that_a_reload_has_replaced():
    async with gateway_bench(CONFIG) as bench:
        devices = [SimulatedDevice(1), SimulatedDevice(6)]
        bench.attach("hall", SimulatedLine("rtu", *devices))
        examining = asyncio.create_task(found(bench))
        await asyncio.sleep(0.02)
        bench.drop_lines()
        await examining
        assert sum(len(device.heard) for device in devices) <= 2


async def test_a_unit_that_answers_late_each_time_leaves_time_for_the_others():
    async with gateway_bench(CONFIG) as bench:
        silo, press = SimulatedDevice(1), SimulatedDevice(6)
        bench.attach("hall", SimulatedLine("rtu", silo, press))
        client = bench.client()
        for unit in (41, 6) * 10:
            await client.asks(unit, "03 00 00 00 01")
        await asyncio.sleep(120.0)
        silo.delay = 1.6
        bench.lines["hall"].take_written()
        await found(bench)
        assert {unit for unit, _ in frames(bench)} == {1, 6}


PROXY = """
[[listen]]
bind = "tcp://127.0.0.1:5021"
upstream = "plant-1"

[[upstream]]
name = "plant-1"
to = "tcp://10.1.0.5"
"""


async def test_units_that_only_a_listener_for_their_upstream_reaches_are_examined_but_not_asked():
    async with gateway_bench(PROXY) as bench:
        assert await found(bench) == [("note", "plant-1", "is up; no client has asked a unit yet")]
        client, server = bench.client(), bench.lines["tcp://10.1.0.5:502"]
        client.ask(248, "03 00 00 00 01")
        request = server.take_written()
        server.deliver(request[:2] + bytes.fromhex("0000 0005 F8 03 02 0007"))
        assert await client.answer() == "03 02 00 07"
        assert await found(bench, line="plant-1") == [("ok", "plant-1", "1 unit answers: 100 % of 1 requests")]
        for _ in range(3):
            assert await client.asks(7, "03 00 00 00 01") == "83 0B"
        server.take_written()
        what = "a client asks for it and gets no answer; behind this server 248 can answer"
        assert ("note", "unit 7, plant-1/7", what) in await found(bench)
        assert server.take_written() == b""


ROOF = """
[[upstream]]
name = "roof"
to = "tcp://10.1.0.5"
timeout = "200 ms"
units = [{ unit = 1, as = 37, name = "inverter" }, { unit = 2, as = 38, name = "meter" }]
"""


class Server:
    """A server that answers each read with a register 0; `answers` says with which identifier, or not at all."""

    def __init__(self, bench, answers):
        self.line, self._answers, self._framer = bench.lines["tcp://10.1.0.5:502"], answers, MbapFramer()
        self.line.on_write = self._take
        self.responded_at = -1.0

    def _take(self, data):
        for adu in self._framer.cut(data):
            identifier = self._answers(self, adu.transaction)
            if identifier is not None:
                response = encode(identifier, adu.unit, b"\3\2\0\0")
                asyncio.get_running_loop().call_later(0.01, self._respond, response)

    def _respond(self, response):
        self.responded_at = asyncio.get_running_loop().time()
        self.line.deliver(response)


async def asks(bench, count):
    client = bench.client()
    for number in range(count):
        await client.asks(37 + number % 2, "03 00 00 00 01")


async def test_a_server_that_answers_with_identifier_0_needs_a_key_for_that():
    async with gateway_bench(ROOF) as bench:
        Server(bench, lambda server, identifier: 0)
        await asks(bench, 4)
        findings = (await ask(bench.running, "doctor", ask=False))["findings"]
        (fix,) = [each for each in findings if each.level == "fix"]
        assert (fix.about, fix.remedy) == ("roof", 'gateway.toml:2: transaction_id = "zero"')


async def test_a_server_that_loses_requests_which_come_soon_after_a_response_needs_a_gap():
    def is_ready(server, identifier):
        is_too_soon = asyncio.get_running_loop().time() - server.responded_at < 0.05
        return None if is_too_soon else identifier

    async with gateway_bench(ROOF) as bench:
        bench.running.ring.resize(2**20)
        Server(bench, is_ready)
        await asks(bench, 20)
        findings = (await ask(bench.running, "doctor", ask=False))["findings"]
        (fix,) = [each for each in findings if each.level == "fix"]
        assert (fix.about, fix.remedy) == ("roof", 'gateway.toml:2: gap = "100 ms"')
        assert fix.what.startswith("loses requests that come soon after a response: 3 of 3 within 1 ms")


async def test_a_server_that_takes_no_second_client_is_found_by_the_read_of_doctor_itself():
    async with gateway_bench(ROOF) as bench:
        bench.running.ring.resize(2**20)
        server = bench.lines["tcp://10.1.0.5:502"]
        server.opened = lambda: asyncio.get_running_loop().call_later(0.001, partial(server.hang_up, at_once=True))
        server.hang_up()
        rows = await found(bench)
        assert "fix" in [level for level, about, _ in rows if about == "roof"]


async def test_a_gateway_without_lines_and_upstreams_has_a_row_that_says_so():
    async with gateway_bench("[[image]]\nunit = 200\nholding = 10\n") as bench:
        assert await found(bench) == [("ok", "gateway", "runs; it has no lines and no upstreams")]


async def test_a_page_that_could_not_be_opened_is_named():
    async with gateway_bench(CONFIG) as bench:
        bench.running.page_trouble = "http://127.0.0.1:8502 cannot be used: address already in use"
        rows = await found(bench, ask=False)
        assert rows[-1] == ("fix", "web", "http://127.0.0.1:8502 cannot be used: address already in use")


async def test_a_virtual_unit_and_a_mirror_name_the_sources_without_fresh_values():
    mirror = '[[image]]\nunit = 241\nname = "copy"\nof = "meter-3"\nread = [{ holding = "0-0", every = "1 s" }]\n'
    async with gateway_bench(mapped_hall.CONFIG + mirror) as bench:
        meters = mapped_hall.attach(bench)
        await asyncio.sleep(10)
        meters["meter-3"].silent = True
        await asyncio.sleep(30)
        about = [row for row in await found(bench, ask=False) if row[1] in ("virtual unit block", "mirror copy")]
        assert [level for level, _, _ in about] == ["ok", "ok"]
        await asyncio.sleep(90)
        about = [row for row in await found(bench, ask=False) if row[1] in ("virtual unit block", "mirror copy")]
        assert about == [
            ("note", "mirror copy", "no fresh values of its source: meter-3 (for 2 min)"),
            ("note", "virtual unit block", "no fresh values of 1 of 3 sources: meter-3 (for 2 min)"),
        ]
        assert not [row for row in await found(bench, ask=False, line="hall") if row[1] == "virtual unit block"]


async def test_a_source_that_was_never_read_is_named_once_its_poll_has_failed():
    mirror = '[[image]]\nunit = 241\nname = "copy"\nof = "meter-3"\nread = [{ holding = "0-0", every = "1 s" }]\n'
    async with gateway_bench(mapped_hall.CONFIG + mirror) as bench:
        mapped_hall.attach(bench)["meter-3"].silent = True
        await asyncio.sleep(10)
        about = {name: what for _, name, what in await found(bench, ask=False)}
        assert about["mirror copy"] == "no fresh values of its source: meter-3 (never read)"
        assert about["virtual unit block"] == "no fresh values of 1 of 3 sources: meter-3 (never read)"
