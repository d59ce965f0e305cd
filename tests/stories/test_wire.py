"""A device that is its own adapter, in virtual time: it answers sooner than a wire could carry the question."""

import asyncio

import pytest

from gateway.events import AnswerTooEarly, BadFrame, EchoHeard
from gateway.modbus import rtu
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import GatewayBench, gateway_bench
from kit.statuses import status

#: A port in memory is virtual: `serial` makes it what `auto` makes a ttyACM.
CONFIG = """
[[line]]
name    = "plc"
port    = "/dev/plc"
baud    = 9600
timeout = "200 ms"
wire    = "serial"
"""
SERVER = """
[[line]]
name   = "panel"
port   = "/dev/panel"
role   = "server"
serves = [200]
wire   = "serial"

[[image]]
unit    = 200
holding = 10
"""
READ, WRITE = "03 00 05 00 01", "06 00 05 00 09"
#: Late windows and rests are over after so many seconds.
LATER = 100.0


def attach(bench: GatewayBench) -> SimulatedDevice:
    device = SimulatedDevice(1, delay=0.001)
    bench.attach("plc", SimulatedLine("rtu", device))
    return device


async def test_it_is_not_believed_and_the_log_says_what_to_do() -> None:
    async with gateway_bench(CONFIG) as bench:
        attach(bench)
        client = bench.client()
        for pdu in (READ, READ, READ, WRITE):
            assert (await client.asks(1, pdu)).endswith(" 0B")
            await asyncio.sleep(LATER)
        (told,) = [event for event in bench.events if isinstance(event, AnswerTooEarly)]
        assert told.line == "plc"
        assert 'wire = "direct"' in told.advice
        assert not [event for event in bench.events if isinstance(event, EchoHeard | BadFrame)]


@pytest.mark.parametrize("wire", ["direct", "auto"])
async def test_without_a_wire_it_is_believed(wire: str) -> None:
    async with gateway_bench(CONFIG.replace('"serial"', f'"{wire}"')) as bench:
        device, client = attach(bench), bench.client()
        assert await client.asks(1, WRITE) == WRITE
        assert await client.asks(1, READ) == "03 02 00 09"
        assert len(device.heard) == 2
        assert not [event for event in bench.events if isinstance(event, AnswerTooEarly | EchoHeard)]


async def test_a_panel_behind_an_adapter_whose_echo_comes_late_writes_once() -> None:
    async with gateway_bench(SERVER) as bench:
        panel = bench.lines["panel"]
        panel.on_write = lambda data: panel_echo(bench, data)
        panel.deliver(rtu.encode(200, bytes.fromhex(READ)))
        await asyncio.sleep(1.0)
        panel.take_written()
        panel.deliver(rtu.encode(200, bytes.fromhex(WRITE)))
        await asyncio.sleep(10.0)
        assert panel.take_written() == rtu.encode(200, bytes.fromhex(WRITE))
        assert len([event for event in bench.events if isinstance(event, EchoHeard)]) == 1


def panel_echo(bench: GatewayBench, data: bytes) -> None:
    asyncio.get_running_loop().call_later(0.04, bench.lines["panel"].deliver, data)


@pytest.mark.parametrize(("wire", "is_direct"), [("serial", False), ("direct", True), ("auto", True)])
async def test_status_says_what_it_has_turned_out_to_be(wire: str, is_direct: bool) -> None:
    config = (CONFIG + SERVER).replace('"serial"', f'"{wire}"')
    async with gateway_bench(config) as bench:
        shown = status(bench.running)
        assert {line.wire for line in (*shown.lines, *shown.servers)} == {"direct" if is_direct else "serial"}


async def test_before_the_port_is_open_it_says_what_the_config_does() -> None:
    bench = GatewayBench(CONFIG.replace('"serial"', '"auto"'))
    assert bench.gateway.lines[0].driver.wire == "auto"
