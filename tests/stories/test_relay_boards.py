"""Relay boards, to which function 05 says more than on and off (`coil_values = "any"`), through the whole gateway."""

import asyncio

import pytest

from gateway.events import OtherClientHeard, WriteAudit
from gateway.lines.exchange import Exchange
from gateway.lines.ledger import FOREIGN_OCCUPIES
from gateway.modbus import rtu
from gateway.modbus.pdu import parse_sent
from kit.device import Answer, SimulatedDevice, SimulatedLine
from kit.gateway_bench import GatewayBench, gateway_bench

CONFIG = """
[profile.relays]
coil_values = "any"

[[line]]
name    = "hall-a"
port    = "/dev/hall-a"
devices = [{ unit = 1, name = "relays", profile = "relays" }, { unit = 2 }]

[[image]]
unit    = 200
profile = "relays"
coils   = 10

[[image]]
unit = 201
of   = "relays"
read = [{ coils = "0-7", every = "10 min" }]
"""
#: Of boards on the market: toggle one relay or all, switch one on for 7 x 100 ms; and on.
VALUES = ["05 00 00 55 00", "05 00 FF 55 00", "05 02 00 00 07", "05 00 00 FF 00"]


def attach(bench: GatewayBench) -> list[SimulatedDevice]:
    devices = [SimulatedDevice(1), SimulatedDevice(2)]
    bench.attach("hall-a", SimulatedLine("rtu", *devices))
    return devices


def confirm(device: SimulatedDevice, pdu: str) -> None:
    """The board repeats the request."""
    device.script.append([Answer(0.01, rtu.encode(device.unit, bytes.fromhex(pdu)))])


@pytest.mark.parametrize("unit", [1, 201])
@pytest.mark.parametrize("pdu", VALUES)
async def test_every_value_is_sent_and_confirmed(pdu: str, unit: int) -> None:
    async with gateway_bench(CONFIG) as bench:
        board, _ = attach(bench)
        confirm(board, pdu)
        assert await bench.client().asks(unit, pdu) == pdu
        assert board.heard[-1] == (1, bytes.fromhex(pdu))
        (audit,) = [event for event in bench.events if isinstance(event, WriteAudit)]
        assert (audit.address, audit.count, audit.result) == (int(pdu[3:8].replace(" ", ""), 16), 1, "ok")


@pytest.mark.parametrize("unit", [2, 200])
async def test_other_devices_and_images_take_on_and_off(unit: int) -> None:
    async with gateway_bench(CONFIG) as bench:
        devices = attach(bench)
        assert await bench.client().asks(unit, "05 00 00 55 00") == "85 03"
        assert not any(device.heard for device in devices)


async def test_a_confirmation_of_another_value_is_none() -> None:
    async with gateway_bench(CONFIG) as bench:
        board, _ = attach(bench)
        confirm(board, "05 00 00 FF 00")
        assert await bench.client().asks(1, "05 00 00 55 00") == "85 0B"


async def test_a_late_confirmation_is_known_to_the_next_line_too() -> None:
    async with gateway_bench(CONFIG) as bench:
        line, client, loop = bench.gateway.lines[0], bench.client(), asyncio.get_running_loop()
        late = Exchange(1, 1, parse_sent(bytes.fromhex("05 00 00 55 00")), 0)
        late.ends_at = loop.time() + 2.0
        line.driver.line.ledger.take_over([late], line.patience)
        assert await client.asks(1, "05 00 00 55 00") == "85 0B"
        bench.lines["hall-a"].deliver(rtu.encode(1, bytes.fromhex("05 00 00 55 00")))
        await asyncio.sleep(0.1)
        board, _ = attach(bench)
        confirm(board, "05 00 00 55 00")
        assert await client.asks(1, "05 00 00 55 00") == "05 00 00 55 00"


async def test_another_client_that_toggles_is_heard() -> None:
    """Its confirmation looks like the one that we wait for."""
    async with gateway_bench(CONFIG) as bench:
        line = bench.lines["hall-a"]
        line.deliver(rtu.encode(1, bytes.fromhex("05 00 00 55 00")))
        await asyncio.sleep(FOREIGN_OCCUPIES + 0.01)
        client = bench.client()
        client.ask(1, "05 00 00 55 00")
        await asyncio.sleep(0.05)
        line.deliver(rtu.encode(1, bytes.fromhex("05 00 00 55 00")))
        assert await client.answer() == "85 0B"
        assert any(isinstance(event, OtherClientHeard) for event in bench.events)
