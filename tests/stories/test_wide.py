"""Registers of four bytes (`wide`), through the whole gateway: from every kind of client to a line and a server."""

import asyncio

import pytest

from gateway.events import WriteAudit
from gateway.modbus import mbap, rtu
from kit.gateway_bench import GatewayBench, gateway_bench
from kit.memory import MemoryLine

CONFIG = """
[[listen]]
bind = "tcp://127.0.0.1:5020"

[profile.enron]
wide = { holding = "5000-5999" }

[[line]]
name    = "hall-a"
port    = "/dev/hall-a"
baud    = 19200
devices = [{ unit = 1, name = "flow", profile = "enron" }]

[[line]]
name   = "plc"
port   = "/dev/plc"
baud   = 19200
role   = "server"
serves = [1, 201]

[[upstream]]
name    = "site"
to      = "tcp://10.0.0.1:502"
units   = [{ unit = 2, as = 2, profile = "enron" }]

[[image]]
unit = 201
of   = "flow"
read = [{ input = "0-1", every = "10 min" }]
"""
READ, RESPONSE = "03 13 88 00 02", "03 08 00 01 02 03 04 05 06 07"
WRITE, WRITTEN = "10 13 88 00 01 04 DE AD BE EF", "10 13 88 00 01"
ANSWERS = {READ: RESPONSE, WRITE: WRITTEN, "04 00 00 00 02": "04 04 00 00 00 00"}


def attach(bench: GatewayBench) -> list[str]:
    """A device on the line and one behind the server, which answer; the requests that they get."""
    heard: list[str] = []

    def on_line(data: bytes) -> None:
        heard.append(data[1:-2].hex(" ").upper())
        bench.lines["hall-a"].deliver(rtu.encode(1, bytes.fromhex(ANSWERS[heard[-1]])))

    server = bench.lines.setdefault("tcp://10.0.0.1:502", MemoryLine("site", has_arrived=lambda: True))

    def behind(data: bytes) -> None:
        asked = mbap.decode(data)
        heard.append(asked.pdu.hex(" ").upper())
        server.deliver(mbap.encode(asked.transaction, asked.unit, bytes.fromhex(ANSWERS[heard[-1]])))

    bench.lines["hall-a"].on_write = on_line
    server.on_write = behind
    return heard


@pytest.mark.parametrize("unit", [1, 2, 201])
async def test_a_client_writes_four_bytes_a_register(unit: int) -> None:
    async with gateway_bench(CONFIG) as bench:
        heard = attach(bench)
        assert await bench.client().asks(unit, WRITE) == WRITTEN
        assert WRITE in heard
        (audit,) = [event for event in bench.events if isinstance(event, WriteAudit)]
        assert (audit.address, audit.count, audit.result) == (5000, 1, "ok")


@pytest.mark.parametrize("unit", [1, 2])
async def test_a_client_reads_four_bytes_a_register(unit: int) -> None:
    async with gateway_bench(CONFIG) as bench:
        attach(bench)
        assert await bench.client().asks(unit, READ) == RESPONSE


async def test_a_mirror_does_not_have_them() -> None:
    async with gateway_bench(CONFIG) as bench:
        attach(bench)
        assert await bench.client().asks(201, READ) == "83 02"


@pytest.mark.parametrize(("pdu", "answer"), [(READ, RESPONSE), (WRITE, WRITTEN)])
async def test_a_client_on_a_line_asks_for_them(pdu: str, answer: str) -> None:
    async with gateway_bench(CONFIG) as bench:
        attach(bench)
        panel = bench.lines["plc"]
        for byte in rtu.encode(1, bytes.fromhex(pdu)):
            panel.deliver(bytes((byte,)))
        await asyncio.sleep(2.0)
        assert panel.take_written() == rtu.encode(1, bytes.fromhex(answer))


@pytest.mark.parametrize(
    ("pdu", "answer"),
    [("06 13 88 00 01", "86 01"), ("10 13 88 00 01 02 00 01", "90 03"), ("03 13 87 00 02", "83 02")],
)
async def test_what_does_not_fit_is_not_sent(pdu: str, answer: str) -> None:
    async with gateway_bench(CONFIG) as bench:
        heard = attach(bench)
        assert await bench.client().asks(1, pdu) == answer
        assert pdu not in heard
