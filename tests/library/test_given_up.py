"""What a program gives up at any moment: each write is audited once and done at most once, and nobody is in the way."""

import asyncio
from collections import Counter
from contextlib import suppress

import pytest

from gateway.errors import RequestError
from gateway.events import WriteAudit
from gateway.images.custom_unit import CustomUnit
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import gateway_bench
from kit.program import unit_of

CONFIG = """
[profile.meter]
functions = [1, 2, 3, 4, 5, 6, 15, 16]
points = [
  { name = "first", holding = 1 },
  { name = "last", holding = 150 },
  { name = "setting", holding = 2, write = true },
  { name = "bit", holding = 3, bit = 5, write = true },
]

[[line]]
name = "hall"
port = "/dev/hall"
latency = "5 ms"

[[line.devices]]
unit = 1
name = "meter"
timeout = "50 ms"
profile = "meter"

[[line.devices]]
unit = 2
name = "dead"
timeout = "20 ms"

[[image]]
unit = 60
name = "relay"
python = "made:Relay"
timeout = "40 ms"
"""
#: What a program asks for, and the writes in it.
ASKS = {
    "registers": (lambda unit: unit.read_holding(1, 3), 0),
    "points": (lambda unit: unit.read_points("first", "last"), 0),
    "point": (lambda unit: unit.write("setting", 7), 1),
    "bit": (lambda unit: unit.write("bit", True), 1),
    "coils": (lambda unit: unit.write_coils(0, [True]), 1),
}


class Relay(CustomUnit):
    """Has the registers of a device, and takes its time."""

    async def read(self, area, address, count):
        return await self.unit("meter").read_holding(address, count)

    async def write(self, area, address, values):
        await asyncio.sleep(0.01)
        await self.unit("meter").write_holding(address, values)


@pytest.mark.parametrize("what", ASKS)
@pytest.mark.parametrize("before", ["nothing", "a read", "a device that does not answer"])
async def test_a_request_to_a_device(what, before):
    ask, writes = ASKS[what]
    async with gateway_bench(CONFIG, units={60: Relay()}) as bench:
        device = SimulatedDevice(1, delay=0.02)
        device.holding = [3 * at for at in range(200)]
        bench.attach("hall", SimulatedLine("rtu", device, SimulatedDevice(2, delay=9.0)))
        meter, dead = unit_of(bench, "meter"), unit_of(bench, "dead")
        for at in range(120):
            device.heard.clear()
            bench.events.clear()
            other = asyncio.create_task((meter if before == "a read" else dead).read_holding(0)) if at else None
            if before == "nothing" and other is not None:
                other.cancel()
            await asyncio.sleep(0)
            with suppress(TimeoutError, RequestError):
                async with asyncio.timeout(at * 0.0015):
                    await ask(meter)
            assert await meter.read_holding(9, 2) == [27, 30]
            if other is not None:
                await asyncio.wait((other,))
                assert other.cancelled() or other.exception() or other.result() == [0]
            await asyncio.sleep(1.0)
            asked = Counter(frame.pdu for frame in device.heard)
            assert max(asked.values()) == 1, at
            audits = [each for each in bench.events if isinstance(each, WriteAudit)]
            assert len(audits) == writes, at
            was_written = any(frame.pdu[0] in (5, 6, 15, 16) for frame in device.heard)
            assert not was_written or before != "a read" or not 0 < at < 9, at  # it was given up while it waited
            told = {each.result for each in audits}
            assert told <= ({"ok", "timeout"} if was_written else {"unwanted", "expired", "resting", "timeout"}), at
            assert was_written or what == "bit" or "timeout" not in told  # what was read before may be all


async def test_requests_to_a_unit_made_in_python_that_asks_a_device():
    async with gateway_bench(CONFIG, units={60: Relay()}) as bench:
        bench.running.builder.custom.find = lambda unit: unit_of(bench, unit)
        device = SimulatedDevice(1, delay=0.012)
        bench.attach("hall", SimulatedLine("rtu", device))
        relay, client = unit_of(bench, "relay"), bench.client()
        for at in range(60):
            device.holding = [at + each for each in range(200)]
            device.heard.clear()
            bench.events.clear()
            given_up = [asyncio.create_task(relay.write_holding(150 + each, [1000 * at + each])) for each in range(3)]
            asyncio.get_running_loop().call_later(at * 0.002, lambda tasks=given_up: [each.cancel() for each in tasks])
            response = await client.asks(60, "03 0007 0002")
            own = bytes.fromhex(f"0304{at + 7:04X}{at + 8:04X}").hex(" ").upper()
            assert response in (own, "83 06", "83 0B"), at
            await asyncio.gather(*given_up, return_exceptions=True)
            await asyncio.sleep(20.0)
            writes = Counter(frame.pdu for frame in device.heard if frame.pdu[0] != 3)
            assert not writes or max(writes.values()) == 1
            audits = Counter(each.unit for each in bench.events if isinstance(each, WriteAudit))
            assert audits[60] == len(given_up)
            assert audits[1] >= sum(writes.values())
