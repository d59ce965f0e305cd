"""Listeners for one upstream: the numbers of that server, whatever other clients call them, and nothing else."""

import asyncio

import pytest

from gateway.events import WriteAudit
from gateway.modbus import rtu
from gateway.modbus.mbap import MbapFramer, encode
from gateway.operator.operations.asked import Traced
from gateway.operator.status.metrics import read
from gateway.operator.trace.trace import page
from kit.asking import ask
from kit.gateway_bench import GatewayBench, gateway_bench
from kit.over_tcp import OverTcpClient
from kit.statuses import status

LISTEN = """
[[listen]]
name  = "scada"
bind  = "tcp://0.0.0.0:502"
unit0 = "broadcast"

[[listen]]
name     = "roof port"
bind     = "tcp://0.0.0.0:503"
upstream = "roof"

[[listen]]
name     = "cellar port"
bind     = "rtu+tcp://0.0.0.0:504"
upstream = "cellar"
"""
SCADA, ROOF, CELLAR = range(3)
UPSTREAMS = """
[[upstream]]
name  = "roof"
to    = "tcp://10.1.0.5:502"
units = [{ as = "71-72", unit = [1, 0] }, { as = 73, unit = 1 }]

[[upstream]]
name = "cellar"
to   = "tcp://10.1.0.6:502"
"""
OTHERS = """
[[line]]
name    = "hall"
port    = "/dev/hall"
devices = [{ unit = 1 }, { unit = 9 }]

[[image]]
unit    = 5
holding = 10
"""
CONFIG = LISTEN + UPSTREAMS + OTHERS
ALL = '[[access]]\nallow = ["read", "write"]\n'
READ, WRITE = "03 0001 0001", "06 0001 0007"


class Servers:
    """Both servers: each register holds the unit that was asked. `heard` is that, as (server, unit, function)."""

    def __init__(self, bench: GatewayBench) -> None:
        self.heard: list[tuple[str, int, int]] = []
        for name, to in (("roof", "tcp://10.1.0.5:502"), ("cellar", "tcp://10.1.0.6:502")):
            bench.lines[to].on_write = self._taker(bench, name, to)

    def _taker(self, bench: GatewayBench, name: str, to: str):
        framer = MbapFramer()

        def take(data: bytes) -> None:
            for adu in framer.cut(data):
                self.heard.append((name, adu.unit, adu.pdu[0]))
                answer = adu.pdu if adu.pdu[0] == 6 else bytes((adu.pdu[0], 2, 0, adu.unit))
                response = encode(adu.transaction, adu.unit, answer)
                asyncio.get_running_loop().call_later(0.005, bench.lines[to].deliver, response)

        return take


async def test_clients_keep_every_unit_of_the_server() -> None:
    async with gateway_bench(CONFIG + ALL) as bench:
        servers = Servers(bench)
        for listener, name in ((ROOF, "roof"), (CELLAR, "cellar")):
            client = bench.client(listener=listener)
            answers = [await client.asks(unit, READ) for unit in range(256)]
            assert answers == [f"03 02 00 {unit:02X}" for unit in range(256)]
            assert servers.heard == [(name, unit, 3) for unit in range(256)]
            servers.heard.clear()


async def test_unit_0_is_one_unit_with_a_response() -> None:
    async with gateway_bench(CONFIG + ALL) as bench:
        servers = Servers(bench)
        assert await bench.client(listener=ROOF).asks(0, WRITE) == "06 00 01 00 07"
        assert servers.heard == [("roof", 0, 6)]
        assert bench.lines["hall"].take_written() == b""
        (audit,) = [event for event in bench.events if isinstance(event, WriteAudit)]
        assert (audit.unit, audit.result) == (0, "ok")


async def test_unit_0_has_a_response_by_rtu_over_tcp_too() -> None:
    async with gateway_bench(CONFIG + ALL) as bench:
        Servers(bench)
        client = OverTcpClient(bench.gateway.listeners[CELLAR])
        assert await client.asks(READ, time_out=0.5, unit=0) == rtu.encode(0, bytes.fromhex("03 02 0000"))


async def test_other_clients_use_the_numbers_of_units_and_reach_no_other() -> None:
    async with gateway_bench(CONFIG + ALL) as bench:
        servers = Servers(bench)
        client = bench.client(listener=SCADA)
        assert [await client.asks(unit, READ) for unit in (71, 72, 73)] == ["03 02 00 01", "03 02 00 00", "03 02 00 01"]
        assert await client.asks(2, READ) == "83 0A"
        servers.heard.clear()
        client.ask(0, WRITE)
        await asyncio.sleep(1.0)
        assert servers.heard == []


async def test_only_units_that_were_asked_have_rows() -> None:
    async with gateway_bench(CONFIG + ALL) as bench:
        Servers(bench)
        named = ["roof/71", "roof/72", "roof/73"]
        assert [unit.name for unit in status(bench.running).units if unit.line != "hall"] == named
        for listener, units in ((ROOF, (1, 71, 250)), (CELLAR, (0, 255))):
            for unit in units:
                await bench.client(listener=listener).asks(unit, READ)
        shown = [each for each in status(bench.running).units if each.line != "hall"]
        assert {(each.unit, each.on_the_wire, each.name) for each in shown if each.counts.ok} == {
            (71, 1, "roof/71"),
            (71, 71, "roof/unit-71"),
            (250, 250, "roof/250"),
            (0, 0, "cellar/0"),
            (255, 255, "cellar/255"),
        }
        assert len(shown) == len(named) + 4
        assert all(each.longest_wait_ms == 3000 for each in shown)
        families = {family.name: family for family in await read(bench.running)}
        assert {labels[:2] for labels, count in families["requests"].values if count} == {
            *(("roof", unit) for unit in ("71", "roof/unit-71", "250")),
            *(("cellar", unit) for unit in ("0", "255")),
        }
        clock = asyncio.get_running_loop().time(), 0.0
        facts = page(bench.running, Traced(since=60), clock).facts
        assert [(each["unit"], each["name"]) for each in facts if each["kind"] == "exchange"] == [
            (1, "roof/71"),
            (71, "roof/unit-71"),
            (250, "roof/250"),
            (0, "cellar/0"),
            (255, "cellar/255"),
        ]


async def may_write(bench: GatewayBench, listener: int, unit: int) -> bool:
    """Whether a write from elsewhere is let through."""
    return await bench.client(host="10.3.0.1", listener=listener).asks(unit, WRITE) != "86 01"


@pytest.mark.parametrize(
    ("rows", "may"),
    [
        pytest.param("", [], id="from elsewhere nobody writes"),
        pytest.param(ALL, [0, 1, 2, 9, 71, 250], id="all units"),
        pytest.param('[[access]]\nunits = "1-247"\nallow = ["write"]\n', [0, 1, 2, 9, 71, 250], id="every number"),
        pytest.param('[[access]]\nunits = [71, 73]\nallow = ["write"]\n', [1], id="unit 1 by both its numbers"),
        pytest.param('[[access]]\nunits = 71\nallow = ["write"]\n', [], id="by one of two numbers"),
        pytest.param('[[access]]\nunits = 72\nallow = ["write"]\n', [0], id="unit 0 by its number"),
        pytest.param('[[access]]\nunits = [2, 9]\nallow = ["write"]\n', [], id="units of others, or of nobody"),
        pytest.param('[[access]]\nunits = 72\nallow = ["read"]\n' + ALL, [1, 2, 9, 71, 250], id="all but unit 0"),
        pytest.param('[[access]]\nunits = 9\nallow = ["read"]\n' + ALL, [0, 1, 2, 9, 71, 250], id="another one's 9"),
        pytest.param(
            '[[access]]\nlisten = ["roof port"]\nunits = [0, 2, "248-255"]\nallow = ["write"]\n',
            [0, 2, 250],
            id="by the server's units",
        ),
        pytest.param('[[access]]\nlisten = ["scada"]\nallow = ["write"]\n', [], id="another listener"),
    ],
)
async def test_who_may_write_where(rows: str, may: list[int]) -> None:
    async with gateway_bench(CONFIG + rows) as bench:
        Servers(bench)
        assert [unit for unit in (0, 1, 2, 9, 71, 250) if await may_write(bench, ROOF, unit)] == may


async def test_no_row_for_a_unit_is_got_round() -> None:
    rows = '[[access]]\nunits = [71, 73]\nallow = ["read"]\n' + ALL
    async with gateway_bench(CONFIG + rows) as bench:
        Servers(bench)
        assert not await may_write(bench, SCADA, 71)
        assert not await may_write(bench, ROOF, 1)


async def test_a_listener_that_a_reload_brings_leaves_the_connection_as_it_is() -> None:
    alone = LISTEN.partition("[[listen]]\nname     = ")[0] + UPSTREAMS.partition("\n[[upstream]]\nname = ")[0] + OTHERS
    more = LISTEN.partition('[[listen]]\nname     = "cellar')[0]
    more += UPSTREAMS.partition("\n[[upstream]]\nname = ")[0] + OTHERS
    async with gateway_bench(alone + ALL) as bench:
        bench.lines.setdefault("tcp://10.1.0.6:502", bench.lines["hall"])
        Servers(bench)
        await bench.client(listener=SCADA).asks(71, READ)
        before = bench.gateway.upstreams
        for text in (more, more, alone):
            bench.gateway = reloaded(bench, text + ALL)
            assert bench.gateway.upstreams == before
            if text is more:
                assert await bench.client(listener=ROOF).asks(250, READ) == "03 02 00 FA"
                assert await bench.client(listener=ROOF).asks(1, READ) == "03 02 00 01"
        counted = {unit.name: unit.counts.ok for unit in status(bench.running).units if unit.line == "roof"}
        assert counted == {"roof/71": 3, "roof/72": 0, "roof/73": 0}


PROFILED = (
    LISTEN + UPSTREAMS.replace('to   = "tcp://10.1.0.6:502"', 'to   = "tcp://10.1.0.6:502"\nprofile = "mint"') + OTHERS
)


async def test_units_that_are_not_named_have_the_profile_of_the_upstream() -> None:
    async with gateway_bench(PROFILED + ALL) as bench:
        servers = Servers(bench)
        client = bench.client(listener=CELLAR)
        assert [await client.asks(9, pdu) for pdu in (READ, "04 0001 0001", "03 0001 0064", "03 0064 0001")] == [
            "03 02 00 09",
            "84 01",
            "83 03",
            "83 02",
        ]
        assert servers.heard == [("cellar", 9, 3)]


async def test_a_reload_gives_units_that_are_not_named_another_profile() -> None:
    async with gateway_bench(CONFIG + ALL) as bench:
        Servers(bench)
        assert await bench.client(listener=CELLAR).asks(9, READ) == "03 02 00 09"
        bench.gateway = reloaded(bench, PROFILED + ALL)
        assert await bench.client(listener=CELLAR).asks(9, "04 0001 0001") == "84 01"


def reloaded(bench: GatewayBench, text: str):
    """The gateway after a reload of this text."""
    gateway = bench.rebuilt(text)
    bench.running.apply(gateway)
    return gateway


async def test_a_unit_without_a_number_for_other_clients_has_its_name() -> None:
    config = CONFIG.replace("{ as = 73, unit = 1 }", '{ unit = "7-8", as = "none", name = "meter-*" }')
    rows = '[[access]]\nunits = 7\nallow = ["write"]\n[[access]]\nallow = ["read"]\n'
    async with gateway_bench(config + rows) as bench:
        servers = Servers(bench)
        assert await bench.client(listener=SCADA).asks(7, READ) == "83 0A"
        assert await bench.client(listener=ROOF).asks(7, READ) == "03 02 00 07"
        assert await bench.client(listener=ROOF).asks(7, WRITE) == "86 01", "the row for unit 7 is about another one"
        answer = await ask(bench.running, "request", unit="meter-8", pdu=READ)
        assert (answer["unit"], answer["pdu"]) == (None, "03 02 00 08")
        assert servers.heard == [("roof", 7, 3), ("roof", 8, 3)]
