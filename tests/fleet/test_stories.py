"""Gateways of several sites in virtual time: requests, rights, deadlines, bounds, and what is lost on the way."""

import asyncio
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import replace
from itertools import chain

import pytest

from gateway.config.plan.settings import Plan
from gateway.errors import ExceptionReceived
from gateway.events import AccessDenied, WriteAudit
from gateway.fleet import link
from gateway.fleet.headers import MOST_HOPS
from gateway.fleet.messages import Message
from gateway.fleet.slots import MOST_OF_SENDER
from gateway.operator.operations.asked import ToExplain
from gateway.operator.trace.stories import sentences
from gateway.operator.trace.why import stories
from gateway.runtime.gateway import Gateway
from kit.asking import ask
from kit.device import SimulatedDevice, SimulatedLine
from kit.fake_nats import FakeBucket, FakeConnection, FakeNats
from kit.gateway_bench import GatewayBench, gateway_bench

FLEET = '[fleet]\nservers = ["nats://127.0.0.1"]\n'

OWNER = f"""
site = "b"
[[line]]
name = "hall"
port = "/dev/hall"
baud = 115200
devices = [{{ unit = 1, as = 41 }}, {{ unit = 2, as = 42 }}]
[[image]]
unit = 200
holding = 10
initial.holding = [{{ at = 0, values = [7, 8] }}]
{FLEET}
"""
WRITERS = '[[access]]\nlisten = ["fleet"]\nfrom = ["a"]\nallow = ["read", "write"]\n'
LOCAL = '[[access]]\nallow = ["read", "write"]\n'
ASKER = f"""
site = "a"
[[upstream]]
name = "b"
to = "fleet://b"
timeout = "1 s"
units = [{{ as = "41-43", unit = "41-43" }}, {{ as = 200, unit = 200 }}]
{FLEET}
"""
READ = "03 00 00 00 01"
OTHER_READ = "03 00 01 00 01"
WRITE = "06 00 05 00 09"


@pytest.fixture
def nats(monkeypatch) -> FakeNats:
    made = FakeNats()
    monkeypatch.setattr(FakeConnection, "nats", made, raising=False)
    monkeypatch.setattr(link, "NatsConnection", FakeConnection)
    return made


@asynccontextmanager
async def site(config: str, *, clock_ahead: float = 0.0):
    """A gateway that serves its units to others."""
    async with gateway_bench(config) as bench:
        loop, fleet = asyncio.get_running_loop(), bench.running.add_ons.fleet
        fleet.clock = lambda: loop.time() + clock_ahead
        await fleet.connect(bench.gateway)
        await fleet.serve(bench.gateway)
        try:
            yield bench
        finally:
            await fleet.stop()


@asynccontextmanager
async def sites(*configs: str):
    """Several of them, a second after they have found each other; the clock of each is ahead of the last one."""
    async with AsyncExitStack() as stack:
        benches = [
            await stack.enter_async_context(site(config, clock_ahead=1000.0 * place))
            for place, config in enumerate(configs)
        ]
        await asyncio.sleep(3.0)
        yield benches


def on_line(bench: GatewayBench, **settings) -> list[SimulatedDevice]:
    devices = [SimulatedDevice(unit, **settings) for unit in (1, 2)]
    bench.attach("hall", SimulatedLine("rtu", *devices))
    return devices


async def test_units_of_another_site_are_read(nats):
    async with sites(ASKER, OWNER) as (a, b):
        on_line(b)
        client = a.client()
        assert await client.asks(200, "03 00 00 00 02") == "03 04 00 07 00 08"
        assert await client.asks(41, READ) == "03 02 00 00"


DESCRIBED = ASKER.replace(
    'unit = "41-43" }', 'unit = "41-43", name = "silo-*", points = [{ name = "weight", holding = 5, write = true }] }'
)


async def test_units_of_another_site_have_the_names_and_points_that_are_described_here(nats):
    async with sites(DESCRIBED, OWNER + WRITERS) as (a, b):
        silo, _ = on_line(b)
        (weight,) = (await ask(a.running, "points", unit="silo-41"))["values"]
        assert (weight.point, weight.value) == ("weight", 0)
        await ask(a.running, "write-point", unit="silo-41", name="weight", values=[9])
        assert silo.holding[5] == 9


BY_SITE = f'site = "a"\n[[listen]]\nbind = "tcp://127.0.0.1:5021"\nsite = "b"\n{FLEET}'


async def test_a_listener_for_a_site_has_its_units_under_their_numbers_there(nats):
    async with sites(BY_SITE, OWNER) as (a, b):
        on_line(b)
        client = a.client()
        assert await client.asks(200, "03 00 00 00 02") == "03 04 00 07 00 08"
        assert [await client.asks(unit, READ) for unit in (41, 43, 0, 255)] == [
            "03 02 00 00",
            "83 0A",
            "83 0A",
            "83 0A",
        ]
        assert await client.asks(41, WRITE) == "86 01"


async def test_equal_reads_of_several_clients_are_requests_of_each(nats):
    """Headers name one client and its role; the owner's line shares the reads."""
    async with sites(ASKER.replace("units", "in_flight = 1\nunits"), OWNER) as (a, b):
        on_line(b)
        clients = [a.client(f"10.0.0.{number}:1") for number in range(4)]
        for client in clients:
            client.ask(41, READ)
        assert [await client.answer() for client in clients] == ["03 02 00 00"] * 4
        (upstream,) = a.gateway.upstreams
        assert (upstream.devices[41].counts[3].sent, upstream.devices[41].counts[3].coalesced) == (4, 0)


async def test_another_site_only_reads_until_a_row_names_it(nats):
    async with sites(ASKER, OWNER) as (a, b):
        devices = on_line(b)
        assert await a.client().asks(41, WRITE) == "86 01"
        assert devices[0].heard == []
        [denied] = [each for each in b.events if isinstance(each, AccessDenied)]
        assert (denied.listener, denied.client, denied.unit) == ("fleet", "a:1", 41)


async def test_why_a_request_has_failed_names_the_site_that_refused_it(nats):
    async with sites(ASKER + LOCAL, OWNER) as (a, b):
        on_line(b)
        assert await a.client("10.9.9.9:4711").asks(41, WRITE) == "86 01"
        now = asyncio.get_running_loop().time()
        [story] = stories(a.running, ToExplain("10.9.9.9", 1), (now, now)).stories
        assert sentences(story).startswith("Sent through site b to address 41 at once. Site b (the unit there, or the ")
        assert "line" not in sentences(story)


async def test_who_may_write_is_audited_with_the_client_that_its_site_names(nats):
    async with sites(ASKER + LOCAL, OWNER + WRITERS) as (a, b):
        on_line(b)
        assert await a.client("10.9.9.9:4711").asks(41, WRITE) == WRITE
        [audit] = [each for each in b.events if isinstance(each, WriteAudit)]
        assert (audit.client, audit.subject, audit.listener, audit.result) == ("a:1", "10.9.9.9:4711", "fleet", "ok")


async def test_another_site_is_told_the_role_of_a_client_with_its_reads_and_writes(nats):
    async with sites(ASKER + LOCAL, OWNER) as (a, b):
        on_line(b)
        client = a.client()
        client.session.caller = replace(client.session.caller, subject="CN=anna", role="operator")
        assert await client.asks(41, READ) == "03 02 00 00"
        assert await client.asks(41, WRITE) == "86 01"
        assert [sent.headers["Role"] for sent in nats.sent if ".unit." in sent.subject] == ["operator"] * 2
        [denied] = [each for each in b.events if isinstance(each, AccessDenied)]
        assert denied.role == "operator"


async def test_rights_of_one_site_are_not_those_of_another(nats):
    other = ASKER.replace('site = "a"', 'site = "c"')
    async with sites(other + LOCAL, OWNER + WRITERS) as (c, b):
        devices = on_line(b)
        assert await c.client().asks(41, WRITE) == "86 01"
        assert devices[0].heard == []


async def test_a_unit_that_nobody_has_is_0a_at_once(nats):
    async with sites(ASKER, OWNER) as (a, _):
        client = a.client()
        before = client.now()
        assert await client.asks(43, READ) == "83 0A"
        assert client.now() - before < 0.1


async def test_a_site_that_is_not_there_is_0a_at_once(nats):
    async with sites(ASKER) as (a,):
        client = a.client()
        before = client.now()
        assert await client.asks(41, READ) == "83 0A"
        assert client.now() == before
        await asyncio.sleep(3.0)
        assert str(a.gateway.upstreams[0].reconnector.error) == "fleet://b: it is not heard"


async def test_who_reads_a_unit_by_hand_is_told_that_its_site_is_not_heard(nats):
    async with sites(ASKER + '[[line]]\nname = "hall"\nport = "/dev/hall"\ndevices = [{ unit = 1 }]\n') as (a,):
        await asyncio.sleep(3.0)
        a.lines["hall"].pull("it was pulled")
        answers = [await ask(a.running, "request", unit=unit, pdu=READ) for unit in (41, 1)]
        assert [answer["result"] for answer in answers] == ["line_down", "line_down"]
        assert [answer["reason"] for answer in answers] == [
            "fleet://b: it is not heard; modbus-gateway status --fleet shows the sites",
            "",
        ]


async def test_what_mends_a_site_that_is_away_is_at_that_site_and_without_nats_there_is_one_cause(nats):
    async with sites(ASKER) as (a,):
        await asyncio.sleep(3.0)
        [missing] = await to_mend(a)
        assert (missing.about, missing.remedy.split(":")[0]) == (
            "b",
            "check the gateway of b, and its connection to NATS",
        )
        nats.down = True
        for connection in tuple(nats.connections):
            connection.lose("it stops")
        await asyncio.sleep(3.0)
        [cause] = await to_mend(a)
        assert cause.about.startswith("fleet ")


async def to_mend(bench):
    found = await ask(bench.running, "doctor")
    return [each for each in found["findings"] if each.level == "fix"]


async def test_a_site_that_is_killed_is_silent_for_who_asks_its_units_long_before_it_is_lost(nats, monkeypatch):
    monkeypatch.setattr(FakeConnection, "bucket", FakeBucket().bucket)
    async with sites(ASKER, OWNER) as (a, b):
        on_line(b)
        await asyncio.sleep(11.0)
        assert [(each.site, each.state, each.lines) for each in await a.running.add_ons.fleet.sites()] == [
            ("a", "up", 0),
            ("b", "up", 1),
        ]
        await b.running.add_ons.fleet.stop()  # without a word
        await asyncio.sleep(5.0)
        _, status = await a.running.add_ons.fleet.sites()
        assert (status.state, 3.5 <= status.for_s <= 6.0) == ("silent", True)


async def test_a_site_that_is_stopping_says_so_and_takes_no_more_requests(nats, monkeypatch):
    monkeypatch.setattr(FakeConnection, "bucket", FakeBucket().bucket)
    async with sites(ASKER, OWNER) as (a, b):
        on_line(b)
        await asyncio.sleep(11.0)
        await b.running.add_ons.fleet.leave()
        assert await a.client().asks(41, READ) == "83 0A"
        _, status = await a.running.add_ons.fleet.sites()
        assert status.state == "left"


async def test_other_sites_are_told_of_the_lines_that_there_are_now(nats, monkeypatch):
    monkeypatch.setattr(FakeConnection, "bucket", FakeBucket().bucket)
    async with sites(ASKER, OWNER) as (a, b):
        on_line(b)
        b.drop_lines()
        await asyncio.sleep(11.0)
        _, status = await a.running.add_ons.fleet.sites()
        assert (status.lines, status.lines_down) == (0, ())


async def test_a_site_that_leaves_is_0a_at_once(nats):
    async with sites(ASKER, OWNER) as (a, b):
        await b.running.add_ons.fleet.stop()
        client = a.client()
        before = client.now()
        assert await client.asks(41, READ) == "83 0A"
        assert client.now() - before < 0.1


async def test_a_request_that_comes_too_late_is_never_sent(nats):
    """Its client has its 0B when the line is free at last."""
    async with sites(ASKER + LOCAL, OWNER + WRITERS) as (a, b):
        devices = on_line(b, delay=0.55)
        first, second, third = (a.client(f"10.0.0.{each}:1") for each in range(3))
        began = first.now()
        for value, client in enumerate((first, second, third)):
            client.ask(41, f"06 00 05 00 {value:02X}")
        assert await third.answer() == "86 0B"
        assert third.came_at - began == pytest.approx(1.0)
        await asyncio.sleep(5.0)
        assert [frame.pdu[4] for frame in devices[0].heard] == [0, 1]
        assert b.running.add_ons.fleet.serving.owner.counts.expired == 1


async def test_no_write_begins_after_its_client_has_an_answer(nats):
    """Whatever the delays: the deadline is by the owner's clock, as its last heartbeat tells it."""
    async with sites(ASKER.replace("1 s", "600 ms") + LOCAL, OWNER + WRITERS) as (a, b):
        devices = on_line(b, delay=0.12)
        written_at: list[tuple[float, bytes]] = []
        deliver = b.lines["hall"].on_write
        loop = asyncio.get_running_loop()

        def watch(data: bytes) -> None:
            written_at.append((loop.time(), data))
            deliver(data)

        b.lines["hall"].on_write = watch
        for step in range(60):
            nats.delay = 0.001 + 0.003 * (step * 7 % 50)
            clients = [a.client(f"10.0.{step}.{each}:1") for each in range(6)]
            for each, client in enumerate(clients):
                client.ask(41 + each % 2, f"06 00 {step:02X} 00 {each:02X}")
            for each, client in enumerate(clients):
                answer = await client.answer()
                sent = [at for at, frame in written_at if frame[3:6] == bytes((step, 0, each))]
                assert len(sent) <= 1
                assert all(at < client.came_at for at in sent), (step, each, answer)
            await asyncio.sleep(1.0)
            assert {frame[1:6] for _, frame in written_at} == {frame[1:6] for at, frame in written_at}
        assert devices[0].heard


async def test_a_write_that_is_answered_0b_does_not_begin_later(nats):
    async with sites(ASKER.replace("1 s", "500 ms") + LOCAL, OWNER + WRITERS) as (a, b):
        on_line(b, delay=0.2)
        began: dict[bytes, float] = {}
        deliver, loop = b.lines["hall"].on_write, asyncio.get_running_loop()

        def watch(data: bytes) -> None:
            began[data[2:6]] = loop.time()
            deliver(data)

        b.lines["hall"].on_write = watch
        late = 0
        for step in range(40):
            nats.delay = 0.002 * step
            clients = [a.client(f"10.1.{step}.{each}:1") for each in range(5)]
            for each, client in enumerate(clients):
                client.ask(41, f"06 00 {step:02X} 00 {each:02X}")
            answers = [await client.answer() for client in clients]
            await asyncio.sleep(3.0)
            for each, (client, answer) in enumerate(zip(clients, answers, strict=True)):
                at = began.get(bytes((0, step, 0, each)))
                late += answer == "86 0B"
                assert at is None or at < client.came_at
        assert late > 20


async def test_a_lost_connection_leaves_requests_their_time(nats):
    """The owner may still send what it got: until its deadline nobody says that it failed."""
    async with sites(ASKER + LOCAL, OWNER + WRITERS) as (a, b):
        on_line(b, delay=0.05)
        client = a.client()
        began = client.now()
        client.ask(41, WRITE)
        await asyncio.sleep(0.001)
        nats.cut()
        assert await client.answer() == "86 0B"
        assert client.came_at - began == pytest.approx(1.0)
        assert await client.asks(41, READ) == "83 0A"


async def test_all_comes_back_when_nats_does(nats):
    async with sites(ASKER, OWNER) as (a, b):
        on_line(b)
        nats.cut()
        await asyncio.sleep(30.0)
        nats.down = False
        await asyncio.sleep(16.0)
        assert await a.client().asks(41, READ) == "03 02 00 00"


async def test_a_connection_that_was_lost_for_a_moment_is_not_lost_again_for_lack_of_heartbeats(nats):
    async with sites(ASKER, OWNER) as (a, b):
        on_line(b)
        for connection in tuple(nats.connections):
            if connection.login.site == "a":
                connection.lose("cut")
        await asyncio.sleep(2.0)
        client = a.client()
        for _ in range(20):
            assert await client.asks(41, READ) == "03 02 00 00"
            await asyncio.sleep(0.5)


async def test_a_late_or_second_answer_is_no_answer_to_another_request(nats):
    async with sites(ASKER, OWNER) as (a, b):
        devices = on_line(b)
        devices[0].holding[0:2] = [1, 2]
        client = a.client()
        assert await client.asks(41, "03 00 00 00 01") == "03 02 00 01"
        [copy] = [each for each in nats.sent if ".answer." in each.subject]
        client.ask(41, "03 00 01 00 01")
        nats.take(Message(copy.subject, b"\x03\x02\x00\x63"))
        assert await client.answer() == "03 02 00 02"
        [driver] = [each.driver for each in a.gateway.upstreams]
        assert driver.unasked == 1


async def test_an_answer_of_another_site_is_no_answer(nats):
    """NATS lets a site answer below its own name only."""
    async with sites(ASKER, OWNER) as (a, b):
        on_line(b, delay=0.2)
        client = a.client()
        client.ask(41, READ)
        await asyncio.sleep(0.05)
        asked = next(each for each in nats.sent if ".unit." in each.subject)
        nats.take(Message(asked.reply.replace(".answer.b.", ".answer.c."), b"\x03\x02\x00\x63"))
        assert await client.answer() == "03 02 00 00"


async def test_what_one_site_is_asked_tells_it_nothing_of_what_another_is_asked(nats):
    """Which JetStream would publish for it: so where answers are awaited is known to the site that is asked alone."""
    second = ASKER.partition("[[upstream]]")[2].partition("[fleet]")[0].replace('"b"', '"c"').replace("//b", "//c")
    second = second.replace("units = [", "units = [{ as = 51, unit = 41 }]#")
    other = OWNER.replace('site = "b"', 'site = "c"')
    async with sites(f"{ASKER}[[upstream]]{second}", OWNER, other) as (a, b, c):
        on_line(b)
        on_line(c, delay=0.2)
        client = a.client()
        await client.asks(41, READ)
        client.ask(51, READ)
        await asyncio.sleep(0.05)
        known, wanted = (each.reply for each in nats.sent if ".unit." in each.subject)
        folder, number = known.rpartition(".")[0], wanted.rpartition(".")[2]
        for guess in (folder, folder[:-1] + "2"):
            forged = f"{guess}.{number}".replace(".answer.b.", ".answer.c.")
            assert forged != wanted
            nats.take(Message(forged, b"\x03\x02\x00\x63"))
        assert await client.answer() == "03 02 00 00"


async def answer_that_is_forged(nats, client, forged: Message) -> str:
    """What the client gets when this comes to where the answer to its request is awaited."""
    client.ask(41, READ)
    await asyncio.sleep(0.05)
    asked = [each for each in nats.sent if ".unit." in each.subject][-1]
    forged.subject = asked.reply
    nats.take(forged)
    return await client.answer()


@pytest.mark.parametrize(
    "forged",
    [
        Message("", b"\x03\x02\x00\x63", headers={"Nats-Stream": "KV_mbgw-status"}),
        Message("", b"x" * 254),
        Message("", b""),
    ],
    ids=["with headers", "too long", "empty"],
)
async def test_what_no_site_would_answer_does_not_end_a_request(nats, forged):
    async with sites(ASKER, OWNER) as (a, b):
        on_line(b, delay=0.2)
        assert await answer_that_is_forged(nats, a.client(), forged) == "03 02 00 00"


async def test_a_heartbeat_with_headers_is_none(nats):
    """No gateway sends one: JetStream has published what some site has stored."""
    async with sites(ASKER, OWNER) as (a, b):
        on_line(b)
        stored = {"Nats-Stream": "KV_mbgw-status"}
        nats.take(Message("mbgw.b.clock", b"abcdef 99999999.0", headers=stored))
        await asyncio.sleep(0.1)
        await a.client().asks(41, READ)
        [asked] = [each for each in nats.sent if ".unit." in each.subject]
        assert "abcdef" not in asked.headers["Deadline"]


async def test_a_request_whose_answer_would_go_to_a_third_site_is_dropped(nats):
    async with sites(OWNER + WRITERS) as (b,):
        devices = on_line(b)
        headers = {"Deadline": b.running.add_ons.fleet.serving.owner.instance + "=1e9", "Hops": "1"}
        for reply in ("mbgw.c.unit.1.from.b", "mbgw.c.answer.b.1", "mbgw.a.answer.c.1", ""):
            nats.take(Message("mbgw.b.unit.41.from.a", bytes.fromhex(WRITE), reply, headers))
        await asyncio.sleep(1.0)
        assert devices[0].heard == []
        assert b.running.add_ons.fleet.serving.owner.counts.dropped == 4
        assert b.running.add_ons.fleet.status().last_dropped_ms == pytest.approx(1000, abs=10)
        assert {each.client for each in b.events if isinstance(each, AccessDenied)} == {"a"}


@pytest.mark.parametrize(
    ("headers", "answer"),
    [
        ({}, "83 0A"),
        ({"Deadline": "other=1e9"}, "83 0A"),
        ({"Deadline": "INSTANCE=soon"}, "83 0A"),
        ({"Deadline": "INSTANCE=0.5"}, "83 0B"),
        ({"Deadline": "INSTANCE=nan"}, "83 0A"),
        ({"Deadline": "INSTANCE=1e9", "Hops": "5"}, "83 0A"),
        ({"Deadline": "INSTANCE=1e9", "Hops": "many"}, "83 0A"),
        ({"Deadline": "INSTANCE=1e9"}, "03 02 00 07"),
    ],
)
async def test_headers_that_say_nothing_are_no_way_round_a_rule(nats, headers, answer):
    async with sites(OWNER) as (b,):
        instance = b.running.add_ons.fleet.serving.owner.instance
        headers = {name: text.replace("INSTANCE", instance) for name, text in headers.items()}
        nats.take(Message("mbgw.b.unit.200.from.a", bytes.fromhex(READ), "mbgw.a.answer.b.1", headers))
        await asyncio.sleep(1.0)
        assert [each.body.hex(" ").upper() for each in nats.sent if ".answer." in each.subject] == [answer]


async def test_a_circle_of_sites_ends(nats):
    there = ASKER.replace('"b"', '"c"').replace("fleet://b", "fleet://c")
    back = (
        there.replace('site = "a"', 'site = "c"').replace("fleet://c", "fleet://a").replace('name = "c"', 'name = "a"')
    )
    async with sites(there, back) as (a, _):
        client = a.client()
        before = client.now()
        assert await client.asks(41, READ) == "83 0A"
        assert client.now() - before < 0.5
        assert len([each for each in nats.sent if ".unit." in each.subject]) <= 6


async def test_the_next_site_gets_no_more_time_than_the_first_client_gives(nats):
    """Else the second owner could send a write whose client has had its answer."""
    middle = ASKER.replace('site = "a"', 'site = "m"').replace("1 s", "5 s")
    first = ASKER.replace("fleet://b", "fleet://m").replace('name = "b"', 'name = "m"').replace("1 s", "500 ms")
    rights = '[[access]]\nlisten = ["fleet"]\nallow = ["read", "write"]\n'
    async with sites(first + LOCAL, middle + rights, OWNER + rights) as (a, _, b):
        devices = on_line(b, delay=0.4)
        one, other = a.client("10.0.0.1:1"), a.client("10.0.0.2:1")
        one.ask(42, READ)
        one.ask(41, READ)
        other.ask(41, WRITE)
        assert await other.answer() == "86 0B"
        await asyncio.sleep(10.0)
        assert all(frame.pdu[0] != 6 for device in devices for frame in device.heard)


async def test_one_clients_requests_to_a_unit_keep_their_order(nats):
    async with sites(ASKER + LOCAL, OWNER + WRITERS) as (a, b):
        devices = on_line(b, delay=0.02)
        clients = [a.client(f"10.0.0.{each}:1") for each in range(3)]
        for value in range(8):
            for each, client in enumerate(clients):
                client.ask(41, f"06 00 {each:02X} 00 {value:02X}")
        for client in clients:
            for _ in range(8):
                assert (await client.answer()).startswith("06")
        for each in range(3):
            assert [frame.pdu[4] for frame in devices[0].heard if frame.pdu[2] == each] == list(range(8))


async def test_equal_reads_share_at_the_owner(nats):
    async with sites(ASKER, OWNER) as (a, b):
        devices = on_line(b, delay=0.05)
        clients = [a.client(f"10.0.0.{each}:1") for each in range(8)]
        for client in clients:
            client.ask(41, READ)
        for client in clients:
            assert await client.answer() == "03 02 00 00"
        assert len(devices[0].heard) == 2


async def test_a_flood_of_one_sender_is_its_own_trouble(nats):
    async with sites(ASKER, OWNER) as (a, b):
        on_line(b, delay=0.02)
        instance = b.running.add_ons.fleet.serving.owner.instance
        headers = {"Deadline": f"{instance}=1e9"}
        for number in range(2000):
            told = {**headers, "Client": f"10.0.0.1:{number}"}
            pdu = bytes((3, 0, number % 100, 0, 1))
            nats.take(Message("mbgw.b.unit.41.from.z", pdu, f"mbgw.z.answer.b.{number}", told))
        client = a.client()
        before = client.now()
        assert await client.asks(41, "03 00 AA 00 01") == "03 02 00 00"
        assert client.now() - before < 0.7
        owner = b.running.add_ons.fleet.serving.owner
        assert owner.counts.busy == 2000 - MOST_OF_SENDER
        await asyncio.sleep(10.0)
        assert owner.under_way == 0


async def test_a_full_connection_is_0a(nats):
    async with sites(ASKER, OWNER) as (a, b):
        on_line(b)
        for connection in nats.connections:
            connection.is_full = connection.login.site == "a"
        client = a.client()
        assert await client.asks(41, READ) == "83 0A"


async def test_units_that_are_not_served_any_more_have_no_responders(nats):
    async with sites(ASKER, OWNER) as (a, b):
        on_line(b)
        client = a.client()
        assert await client.asks(41, READ) == "03 02 00 00"
        b.running.add_ons.fleet.router.routes.pop(41)
        await asyncio.sleep(1.5)
        assert await client.asks(41, READ) == "83 0A"
        assert await client.asks(42, READ) == "03 02 00 00"


async def test_a_reload_that_drops_the_fleet_leaves_it(nats):
    async with sites(ASKER, OWNER) as (a, _):
        await a.running.add_ons.fleet.connect(Gateway(plan=Plan()))
        client = a.client()
        assert await client.asks(41, READ) == "83 0A"
        assert len(nats.connections) == 1


# --- through mirrors ---

#: What a mirror of another site's units looks like; `{}` is the unit that it mirrors.
MIRROR = '[[image]]\nunit = 60\nof = "b/{}"\nstale = "60 s"\nread = [{{ holding = "0-9", every = "30 s" }}]\n'
ANYBODY_WRITES = '[[access]]\nlisten = ["fleet"]\nallow = ["read", "write"]\n'


async def test_the_first_deadline_holds_behind_a_mirror(nats):
    """Site a asks m, whose unit 60 mirrors unit 41 of b, which is busy for longer than a waits."""
    asker = """
site = "a"
[[upstream]]
name = "m"
to = "fleet://m"
timeout = "500 ms"
units = [{ as = "60", unit = "60" }]
[[upstream]]
name = "b"
to = "fleet://b"
timeout = "5 s"
units = [{ as = 42, unit = 42 }]
"""
    middle = ASKER.replace('"a"', '"m"').replace("1 s", "5 s") + MIRROR.format(41) + ANYBODY_WRITES
    async with sites(asker + LOCAL + FLEET, middle, OWNER + ANYBODY_WRITES) as (a, _, b):
        devices = on_line(b, delay=0.8)
        busy, writer = a.client("10.0.0.1:1"), a.client("10.0.0.2:1")
        busy.ask(42, READ)
        busy.ask(42, OTHER_READ)
        writer.ask(60, WRITE)
        assert await writer.answer() == "86 0B"
        await asyncio.sleep(10.0)
        assert all(frame.pdu[0] == 3 for frame in chain.from_iterable(device.heard for device in devices))


async def test_sites_that_mirror_each_other_pass_a_write_on_only_so_often(nats):
    def one(name: str, other: str) -> str:
        upstream = (
            f'[[upstream]]\nname = "b"\nto = "fleet://{other}"\ntimeout = "5 s"\nunits = [{{ as = 61, unit = 60 }}]\n'
        )
        return f'site = "{name}"\n{upstream}{MIRROR.format(61)}{ANYBODY_WRITES}{LOCAL}{FLEET}'

    async with sites(one("a", "c"), one("c", "a")) as (a, _):
        a.client().ask(60, WRITE)
        await asyncio.sleep(20.0)
    writes = [sent for sent in nats.sent if ".unit." in sent.subject and sent.body[:1] == b"\x06"]
    assert len(writes) == MOST_HOPS + 1, "the last one is refused"


WITH_BITS = DESCRIBED.replace('name = "weight", holding = 5', 'name = "lamp", holding = 5, bit = 3')
MASKS = "[profile.masks]\nfunctions = [3, 6, 22]\n"


async def test_bits_of_another_site_need_function_22(nats):
    """Clients there could write between a read and a write."""
    async with sites(WITH_BITS, OWNER + WRITERS) as (a, b):
        silo, _ = on_line(b)
        with pytest.raises(ExceptionReceived, match="clients of the other site"):
            await ask(a.running, "write-point", unit="silo-41", name="lamp", values=[1])
        assert silo.heard == []
    masks = WITH_BITS.replace('to = "fleet://b"', 'to = "fleet://b"\nprofile = "masks"') + MASKS
    async with sites(masks, OWNER + WRITERS) as (a, b):
        silo, _ = on_line(b)
        await ask(a.running, "write-point", unit="silo-41", name="lamp", values=[1])
        assert silo.holding[5] == 8
        assert silo.heard[-1].pdu.hex(" ").upper() == "16 00 05 FF F7 00 08"
