"""Responses that are intact and do not fit, and bytes of another framing: event, trace and doctor name them."""

import asyncio
import re

import pytest

from gateway.diagnosis.finding import Finding
from gateway.events import BadFrame, UpstreamClosed
from gateway.modbus import mbap, rtu
from gateway.modbus.mbap import encode
from gateway.operator.operations.asked import ToExplain
from gateway.operator.trace.stories import sentences
from gateway.operator.trace.why import stories
from kit.asking import ask
from kit.device import Answer, SimulatedDevice, SimulatedLine
from kit.gateway_bench import GatewayBench, gateway_bench

LINE = """
[[line]]
name    = "hall"
port    = "/dev/hall"
wire    = "direct"
timeout = "120 ms"
devices = [{ unit = 1, name = "silo" }, { unit = 2, name = "press" }]
"""
UPSTREAM = """
[[upstream]]
name  = "plant"
to    = "tcp://10.1.0.5:502"
units = [{ as = "1-2", unit = "1-2" }]
"""
TO = "tcp://10.1.0.5:502"
DEVICE_SERVER = "rtu+tcp://10.1.0.5:4001"
#: What is asked, what comes, and how it is called.
MISFITS = [
    ("03 0005 0001", "03 04 0001 0002", "intact, 4 data bytes where 2 were expected (32-bit registers?)"),
    ("06 0005 00C8", "06 0005 0064", "echoed 0064, sent 00C8 (limited by the device)"),
]


def reasons(bench: GatewayBench) -> list[str]:
    return [event.reason for event in bench.events if isinstance(event, BadFrame)]


def why(bench: GatewayBench) -> str:
    """The story of the last failure."""
    now = asyncio.get_running_loop().time()
    found = stories(bench.running, ToExplain("10.0.0.9", 1), (now, now)).stories
    return sentences(found[0])


async def rows(bench: GatewayBench, **question: object) -> list[Finding]:
    return (await ask(bench.running, "doctor", **{"ask": False, **question}))["findings"]


@pytest.mark.parametrize(("asked", "came", "named"), MISFITS)
async def test_on_a_line(asked: str, came: str, named: str) -> None:
    async with gateway_bench(LINE) as bench:
        silo, client = SimulatedDevice(1), bench.client()
        bench.attach("hall", SimulatedLine("rtu", silo, SimulatedDevice(2)))
        for _ in range(4):
            silo.script.append([Answer(0.01, rtu.encode(1, bytes.fromhex(came)))])
            assert (await client.asks(1, asked))[3:] == "0B"
            assert f"({named})." in why(bench)
            for _ in range(3):
                await client.asks(2, "04 0000 0001")
                await client.asks(1, "04 0000 0001")
        assert reasons(bench) == [named] * 4
        found = await rows(bench)
        (row,) = [each for each in found if each.unit == "silo"]
        assert (row.level, row.what) == ("fix", f"4 of 16 responses did not fit their requests: {named}")
        told = " ".join(f"{each.what} {each.remedy}" for each in found)
        assert not re.search("damaged|wiring|two devices|another client|does not answer", told)


async def test_what_is_damaged_is_still_called_so() -> None:
    async with gateway_bench(LINE) as bench:
        silo, client = SimulatedDevice(1), bench.client()
        bench.attach("hall", SimulatedLine("rtu", silo, SimulatedDevice(2)))
        for number in range(4):
            silo.script.append([Answer(0.01, rtu.encode(1, bytes((3, 2, 0, 1)))[:-1] + bytes((number,)))])
            assert await client.asks(1, "03 0005 0001") == "83 0B"
        assert reasons(bench) == ["this is the answer, and its check sum is wrong"] * 4
        assert any("damaged" in each.what for each in await rows(bench))


@pytest.mark.parametrize(("asked", "came", "named"), MISFITS)
async def test_behind_another_server(asked: str, came: str, named: str) -> None:
    async with gateway_bench(UPSTREAM) as bench:
        client, line = bench.client(), bench.lines[TO]
        client.ask(1, asked)
        line.deliver(encode(1, 1, bytes.fromhex(came)))
        assert (await client.answer())[3:] == "0B"
        assert reasons(bench) == [named]
        assert f"({named})." in why(bench)


@pytest.mark.parametrize(
    ("adu", "named"),
    [
        (encode(0, 1, b"\3\2\0\1"), "intact, but its transaction identifier 0000 is not that of the request"),
        (encode(1, 9, b"\3\2\0\1"), "intact, but from unit 9"),
        (encode(1, 1, b"\4\2\0\1"), "intact, but of function 04"),
    ],
)
async def test_a_response_of_another_server_that_is_for_no_request(adu: bytes, named: str) -> None:
    async with gateway_bench(UPSTREAM) as bench:
        client, line = bench.client(), bench.lines[TO]
        client.ask(1, "03 0005 0001")
        line.deliver(adu)
        assert await client.answer() == "83 0B"
        assert reasons(bench) == [named]
        assert f"({named})." in why(bench)
        (row,) = [each for each in await rows(bench) if each.unit]
        assert row.what == f"1 of 1 responses did not fit their requests: {named}"


async def test_a_surplus_response_harms_nobody_who_gets_his_own() -> None:
    async with gateway_bench(UPSTREAM) as bench:
        client, line = bench.client(), bench.lines[TO]
        client.ask(1, "03 0005 0001")
        line.deliver(encode(0, 1, b"\3\2\0\1") + encode(1, 1, b"\3\2\0\2"))
        assert await client.answer() == "03 02 00 02"
        assert reasons(bench) == []


async def test_a_server_of_modbus_tcp_behind_rtu_over_tcp_is_recognized() -> None:
    """It takes unit and function of the RTU read for a transaction identifier, and the CRC for a request."""
    config = LINE.replace("/dev/hall", DEVICE_SERVER)
    async with gateway_bench(config) as bench:
        client, line = bench.client(), bench.lines[DEVICE_SERVER]
        client.ask(1, "03 0000 0002")
        line.deliver(encode(0x0103, 0xC4, b"\x8b\1"))
        assert await client.answer() == "83 0B"
        named = "this looks like Modbus TCP: [[upstream]] is for that"
        assert reasons(bench) == [named]
        assert f"({named})." in why(bench)
        assert any(named in each.what for each in await rows(bench))


@pytest.mark.parametrize("heard", ["01 03 02 0007 F986", "01 03 0000 0001 840A", "01 03 0005 0002 D40A"])
async def test_rtu_from_a_server_is_recognized(heard: str) -> None:
    async with gateway_bench(UPSTREAM) as bench:
        client, line = bench.client(), bench.lines[TO]
        client.ask(1, "03 0005 0001")
        line.deliver(bytes.fromhex(heard))
        assert await client.answer() == "83 0B"
        (closed,) = [event for event in bench.events if isinstance(event, UpstreamClosed)]
        assert closed.reason.startswith("what came is not Modbus TCP: ")
        assert closed.reason.endswith(": this looks like RTU, which rtu+tcp:// is for")


async def test_a_response_that_looks_unfinished_because_it_is_rtu_is_recognized() -> None:
    async with gateway_bench(UPSTREAM) as bench:
        client, line = bench.client(), bench.lines[TO]
        client.ask(1, "03 0005 0001")
        line.deliver(rtu.encode(1, bytes.fromhex("03 0000 0010")))
        assert await client.answer() == "83 0B"
        (closed,) = [event for event in bench.events if isinstance(event, UpstreamClosed)]
        assert closed.reason.endswith("8 bytes came of it: this looks like RTU, which rtu+tcp:// is for")


# --- doctor, where there are upstreams only ---


class Server:
    """Another server, whose units 1 and 2 answer unless they are `silent`."""

    def __init__(self, bench: GatewayBench) -> None:
        self.silent: set[int] = set()
        self.line = bench.lines[TO]
        self.line.on_write = self._take
        self._framer = mbap.MbapFramer()

    def _take(self, data: bytes) -> None:
        for transaction, unit, _ in self._framer.cut(data):
            if unit not in self.silent:
                self.line.deliver(encode(transaction, unit, b"\3\2\0\7"))


def shown(found: list[Finding]) -> list[tuple[str, str, str]]:
    return [(each.level, each.about, each.what) for each in found]


async def test_doctor_asks_units_behind_a_server_and_says_that_all_is_well() -> None:
    async with gateway_bench(UPSTREAM) as bench:
        Server(bench)
        expected = [
            ("ok", "plant", "2 units answer: 100 % of 8 requests"),
            ("note", "plant", "doctor has sent 8 reads of configured units"),
        ]
        assert shown(await rows(bench, ask=True)) == expected
        assert shown(await rows(bench, ask=True, line="plant")) == expected[:1]


async def test_doctor_asks_nobody_when_it_must_not() -> None:
    async with gateway_bench(UPSTREAM) as bench:
        Server(bench)
        assert shown(await rows(bench)) == [("note", "plant", "not asked yet: 2 of 2 units")]
        assert bench.lines[TO].take_written() == b""


async def test_doctor_names_units_that_do_not_answer_behind_a_server() -> None:
    async with gateway_bench(UPSTREAM) as bench:
        server = Server(bench)
        server.silent = {2}
        assert shown(await rows(bench, ask=True))[:2] == [
            ("fix", "unit 2, plant/2", "does not answer at address 2"),
            ("ok", "plant", "unit 1 answers"),
        ]
    async with gateway_bench(UPSTREAM) as bench:
        Server(bench).silent = {1, 2}
        (row, *_) = await rows(bench, ask=True)
        assert (row.level, row.about, row.what) == ("fix", "plant", "none of its 2 units answers")
        assert row.remedy.startswith("check the unit identifiers, and the devices behind the server; gateway.toml:2: ")


async def test_doctor_knows_servers_that_answer_one_request_at_a_time() -> None:
    async with gateway_bench(UPSTREAM) as bench:
        server, client = Server(bench), bench.client()
        for number in range(20):
            server.silent = {1} if number % 5 in (2, 3) else set()
            await client.asks(1, "03 0005 0001")
        found = [each for each in await rows(bench) if "were not answered" in each.what]
        assert [each.remedy for each in found] == [
            "if it answers when it is polled alone, gateway.toml:2: in_flight = 1; else check the device"
        ]


async def test_doctor_says_why_a_server_is_not_reached() -> None:
    async with gateway_bench(UPSTREAM) as bench:
        bench.lines[TO].pull("refused")
        assert [(each.level, each.what) for each in await rows(bench, ask=True)] == [("fix", "is down: refused")]


ALONE = """
[[listen]]
bind     = "tcp://127.0.0.1:1502"
upstream = "plant"
[[upstream]]
name = "plant"
to   = "tcp://10.1.0.5:502"
"""


async def test_doctor_tells_of_units_that_only_clients_know() -> None:
    async with gateway_bench(ALONE) as bench:
        assert shown(await rows(bench, ask=True)) == [("note", "plant", "is up; no client has asked a unit yet")]
        Server(bench).silent, client = {7}, bench.client()
        for _ in range(3):
            await client.asks(7, "03 0005 0001")
            await client.asks(8, "03 0005 0001")
        assert shown(await rows(bench, ask=True)) == [
            ("note", "unit 7, plant/7", "a client asks for it and gets no answer; behind this server 8 can answer"),
            ("ok", "plant", "1 unit answers: 100 % of 3 requests"),
        ]
