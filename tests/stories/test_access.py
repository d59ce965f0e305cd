"""Rights and the account of writes in a whole gateway: what is on the lines is what somebody was allowed to ask."""

import asyncio
import random

import pytest

from gateway.events import WriteAudit
from gateway.modbus import ascii as ascii_framing
from gateway.modbus import mbap, rtu
from kit.conversation import Conversation, Stage
from kit.gateway_bench import GatewayBench, gateway_bench

CONFIG = """
[[listen]]
name  = "scada"
bind  = "tcp://0.0.0.0:502"
unit0 = "broadcast"

[[listen]]
name  = "office"
bind  = "tcp://0.0.0.0:503"
unit0 = 41

[[listen]]
name  = "field"
bind  = "udp://0.0.0.0:502"
unit0 = "broadcast"

[[line]]
name    = "hall"
port    = "/dev/hall"
devices = [{ unit = 1, as = 41, name = "silo" }, { unit = 2, as = 42 }]

[[line]]
name    = "motion"
port    = "/dev/motion"
mode    = "ascii"
devices = [{ unit = 3, as = 43 }]

[[line]]
name   = "panel"
port   = "/dev/panel"
role   = "server"
serves = [41, 200, 241]
broadcast_to = "all"

[[upstream]]
name  = "plant"
to    = "tcp://10.1.0.5:502"
units = [{ as = 44, unit = 4 }]

[[image]]
unit    = 200
holding = 100
coils   = 100

[[image]]
unit = 241
of   = "silo"
read = [{ holding = "0-1", every = "10 s" }]
"""
SCADA, OFFICE, FIELD = range(3)
#: A broadcast or a stand-in for 41; devices on an RTU and an ASCII line, one behind a server; an image; a mirror.
UNITS = (0, 41, 42, 43, 44, 200, 241)
READING = {1, 2, 3, 4, 7, 11, 12, 17, 20, 24}
#: Requests that are whole: they pass every check there is on the way to a line.
WHOLE = {
    1: "01 0000 0001", 2: "02 0000 0001", 3: "03 0000 0001", 4: "04 0000 0001", 5: "05 0000 FF00", 6: "06 0000 0007",
    7: "07", 8: "08 0001 0000", 11: "0B", 12: "0C", 15: "0F 0000 0001 01 01", 16: "10 0000 0001 02 0007", 17: "11",
    20: "14 07 06 0001 0000 0001", 21: "15 09 06 0001 0000 0001 0007", 22: "16 0000 00F2 0025",
    23: "17 0000 0001 0000 0001 02 0007", 24: "18 0000", 43: "2B 0D 00",
}  # fmt: skip


class Lines:
    """The devices of all lines: they refuse whatever they are asked, and `heard` is that, as (port, unit, PDU)."""

    def __init__(self, bench: GatewayBench) -> None:
        self.heard: list[tuple[str, int, bytes]] = []
        for port, unframe, frame in (
            ("hall", lambda data: (data[0], data[1:-2]), rtu.encode),
            ("motion", _unframe_ascii, ascii_framing.encode),
            ("tcp://10.1.0.5:502", lambda data: (data[6], data[7:]), None),
        ):
            bench.lines[port].on_write = self._taker(bench, port, unframe, frame)

    def _taker(self, bench: GatewayBench, port: str, unframe, frame):
        def take(data: bytes) -> None:
            unit, pdu = unframe(data)
            self.heard.append((port, unit, pdu))
            refusal = bytes((pdu[0] | 0x80, 1))
            answer = frame(unit, refusal) if frame else mbap.encode(int.from_bytes(data[:2]), unit, refusal)
            if unit:
                asyncio.get_running_loop().call_later(0.005, bench.lines[port].deliver, answer)

        return take


def _unframe_ascii(data: bytes) -> tuple[int, bytes]:
    frame = bytes.fromhex(data[1:-2].decode())
    return frame[0], frame[1:-1]


def writes(pdu: bytes) -> bool:
    """What a client without the right to write must not get through, by the book."""
    return pdu[0] not in READING and pdu[:2] != b"\x2b\x0e"


def requests() -> list[bytes]:
    """Every function: as it should be where that is known, and with anything behind it."""
    dice = random.Random(7)
    whole = [bytes.fromhex(WHOLE.get(function, f"{function:02X} 0000 0001")) for function in range(1, 128)]
    return [*whole, b"\x2b\x0e\x01\x00", *(bytes((each[0],)) + dice.randbytes(dice.randrange(8)) for each in whole)]


async def ask_everything(bench: GatewayBench, host: str, listener: int) -> None:
    """One client, every request to every unit; broadcasts are not answered."""
    client = bench.client("10.0.0.9:1", host=host, listener=listener)
    for unit in UNITS:
        for pdu in requests():
            client.ask(unit, pdu.hex())
            while not client.session.is_idle:  # noqa: ASYNC110 - virtual time
                await asyncio.sleep(0.05)


READ_ONLY = {
    "nobody has said anything": ("", "10.0.0.9"),
    "they may read": ('[[access]]\nallow = ["read"]\n', "127.0.0.1"),
    "others may write": (
        '[[access]]\nfrom = ["10.2.0.0/16"]\nallow = ["read", "write"]\n[[access]]\nallow = ["read"]\n',
        "10.3.0.1",
    ),
    "their way in": (
        '[[access]]\nlisten = ["scada", "office", "field"]\nunits = "1-247"\nallow = ["read"]\n',
        "10.3.0.1",
    ),
    "functions that read": ("[[access]]\nfunctions = [1, 2, 3, 4, 7, 11, 12, 17, 20, 24]\n", "10.3.0.1"),
}


@pytest.mark.parametrize("listener", [SCADA, OFFICE, FIELD])
@pytest.mark.parametrize("rights", READ_ONLY)
async def test_whoever_may_only_read_writes_by_no_function_at_all(rights: str, listener: int) -> None:
    rows, host = READ_ONLY[rights]
    async with gateway_bench(CONFIG + rows) as bench:
        lines = Lines(bench)
        await ask_everything(bench, host, listener)
        assert not [heard for heard in lines.heard if writes(heard[2])]
        assert {pdu[0] for _, _, pdu in lines.heard} >= READING
        client = bench.client(host=host, listener=listener)
        assert await client.asks(200, "03 0000 0002") == "03 04 00 00 00 00"
        assert await client.asks(200, "01 0000 0008") == "01 01 00"


async def test_by_datagrams_nobody_writes_before_a_row_names_their_listener() -> None:
    rows = '[[access]]\nallow = ["read", "write"]\n'
    async with gateway_bench(CONFIG + rows) as bench:
        lines = Lines(bench)
        await ask_everything(bench, "127.0.0.1", FIELD)
        assert not [heard for heard in lines.heard if writes(heard[2])]
    async with gateway_bench(CONFIG + '[[access]]\nlisten = ["field"]\nallow = ["read", "write"]\n') as bench:
        lines = Lines(bench)
        await bench.client(listener=FIELD).asks(42, "06 0000 0007")
        assert lines.heard == [("hall", 2, bytes.fromhex("06 0000 0007"))]


async def test_who_may_write_to_one_unit_writes_to_no_other_and_broadcasts_nothing() -> None:
    rows = '[[access]]\nunits = 42\nallow = ["read", "write"]\n[[access]]\nallow = ["read"]\n'
    async with gateway_bench(CONFIG + rows) as bench:
        lines = Lines(bench)
        await ask_everything(bench, "10.3.0.1", SCADA)
        written = {(port, unit) for port, unit, pdu in lines.heard if writes(pdu)}
        assert written == {("hall", 2)}


async def test_who_may_write_to_all_but_one_unit_does_not_reach_it_by_unit_0() -> None:
    rows = '[[access]]\nunits = 41\nallow = ["read"]\n[[access]]\nallow = ["read", "write"]\n'
    for listener in (SCADA, OFFICE):
        async with gateway_bench(CONFIG + rows) as bench:
            lines = Lines(bench)
            client = bench.client(listener=listener)
            assert await client.asks(0, "06 0000 0007") == "86 01"
            assert lines.heard == []


async def test_unit_0_in_the_place_of_a_unit_needs_the_right_at_that_one_only() -> None:
    rows = '[[access]]\nunits = 41\nallow = ["read", "write"]\n[[access]]\nallow = ["read"]\n'
    async with gateway_bench(CONFIG + rows) as bench:
        lines = Lines(bench)
        await bench.client(listener=OFFICE).asks(0, "06 0000 0007")
        assert [unit for _, unit, pdu in lines.heard if writes(pdu)] == [1]


async def test_only_the_named_functions_pass() -> None:
    async with gateway_bench(CONFIG + "[[access]]\nfunctions = [3, 16]\n") as bench:
        lines = Lines(bench)
        await ask_everything(bench, "10.3.0.1", SCADA)
        assert {pdu[0] for _, _, pdu in lines.heard} == {3, 16}


async def test_who_may_write_everywhere_broadcasts() -> None:
    async with gateway_bench(CONFIG) as bench:
        lines = Lines(bench)
        bench.client(host="127.0.0.1").ask(0, "06 0000 0007")
        await asyncio.sleep(1)
        assert {(port, unit) for port, unit, _ in lines.heard} == {("hall", 0), ("motion", 0)}


async def test_other_rights_reach_connections_that_are_open() -> None:
    async with gateway_bench(CONFIG) as bench:
        lines = Lines(bench)
        client = bench.client(host="10.3.0.1")
        assert await client.asks(42, "06 0000 0007") == "86 01"
        async with gateway_bench(CONFIG + '[[access]]\nallow = ["read", "write"]\n') as other:
            bench.gateway.listeners[SCADA].router.rights = other.gateway.listeners[SCADA].router.rights
        await client.asks(42, "06 0000 0007")
        assert [unit for _, unit, _ in lines.heard] == [2]


# Server lines


@pytest.mark.parametrize(
    ("rows", "answer"),
    [
        ("", "C8 06 00 00 00 07"),
        ('[[access]]\nallow = ["read"]\n', "C8 06 00 00 00 07"),
        ('[[access]]\nlisten = ["panel"]\nallow = ["read"]\n', "C8 86 01"),
        ('[[access]]\nlisten = ["panel"]\nunits = 41\nallow = ["read", "write"]\n', "C8 86 01"),
    ],
)
async def test_a_panel_does_everything_until_a_row_names_it(rows: str, answer: str) -> None:
    def framed(text: str) -> str:
        data = bytes.fromhex(text)
        return rtu.encode(data[0], data[1:]).hex(" ").upper()

    async with gateway_bench(CONFIG + rows) as bench:
        steps = (f"panel << {framed('C8 06 00 00 00 07')}", f"panel >> {framed(answer)}")
        await Stage(bench).play(Conversation("", steps))


# The account of writes


def audits(bench: GatewayBench) -> list[tuple[str, int, str, str]]:
    return [(told.listener, told.unit, told.result, told.code) for told in bench.events if isinstance(told, WriteAudit)]


async def test_every_write_is_told_once_and_no_read_is() -> None:
    async with gateway_bench(CONFIG) as bench:
        Lines(bench)
        await ask_everything(bench, "127.0.0.1", SCADA)
        asked = sum(writes(pdu) for pdu in requests())
        told = audits(bench)
        assert len(told) == asked * len(UNITS)
        assert [sum(each[1] == unit for each in told) for unit in UNITS] == [asked] * len(UNITS)


async def test_what_became_of_writes() -> None:
    async with gateway_bench(CONFIG) as bench:
        lines = Lines(bench)
        client, write = bench.client(), "10 0000 0002 04 0001 0002"
        await client.asks(200, write)
        await client.asks(41, write)
        await client.asks(241, write)
        await client.asks(99, write)
        await client.asks(200, "10 0063 0002 04 0001 0002")
        await bench.client(host="10.3.0.1").asks(42, write)
        client.ask(0, write)
        bench.lines["hall"].on_write = None
        await client.asks(241, write)
        assert audits(bench) == [
            ("scada", 200, "ok", ""),
            ("scada", 41, "exception", "01"),
            ("scada", 241, "exception", "01"),
            ("scada", 99, "no_route", "0A"),
            ("scada", 200, "refused", "02"),
            ("scada", 42, "denied", "01"),
            ("scada", 0, "broadcast", ""),
            ("scada", 241, "timeout", "0B"),
        ]
        assert len([heard for heard in lines.heard if writes(heard[2]) and heard[1]]) == 2


async def test_a_write_of_a_client_that_leaves_is_told_though_nobody_gets_the_answer() -> None:
    async with gateway_bench(CONFIG) as bench:
        client = bench.client()
        client.ask(41, "06 0000 0007")
        client.ask(42, "06 0000 0007")
        await asyncio.sleep(0.02)
        client.session.closed()
        await asyncio.sleep(5)
        assert sorted(audits(bench)) == [("scada", 41, "timeout", "0B"), ("scada", 42, "unwanted", "06")]


async def test_a_write_of_a_panel_is_told_with_its_line() -> None:
    async with gateway_bench(CONFIG) as bench:
        Lines(bench)
        bench.lines["panel"].deliver(rtu.encode(200, bytes.fromhex("06 0000 0007")))
        bench.lines["panel"].deliver(b"")
        await asyncio.sleep(1)
        (told,) = (event for event in bench.events if isinstance(event, WriteAudit))
        assert (told.client, told.listener, told.unit, told.address, told.count) == ("panel", "panel", 200, 0, 1)
