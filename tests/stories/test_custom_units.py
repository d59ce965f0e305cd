"""Units made in Python in a whole gateway: their clients, what polls them, what they ask, reloads and the stop."""

import asyncio

from gateway.errors import DeviceFailure
from gateway.events import CustomUnitFailed, CustomUnitsLeft, UnitResting, WriteAudit
from gateway.images.custom_unit import CustomUnit
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.operator.images.kept import kept, window
from gateway.operator.operations.asked import ToExplain
from gateway.operator.trace.stories import sentences
from gateway.operator.trace.why import stories
from gateway.operator.units.reached import target
from kit.gateway_bench import GatewayBench, gateway_bench, keep_lines_open
from kit.statuses import status

LISTEN = """
[[listen]]
bind = "tcp://127.0.0.1:0"
unit0 = "broadcast"
"""
CLOCK = """
[[image]]
unit = 60
name = "clock"
python = "plant:Clock"
"""
OTHER = """
[[image]]
unit = 61
name = "other"
python = "plant:Other"
"""
BLOCK = """
[[image]]
unit = 70
name = "block"

[[image.map]]
at = 10
device = "clock"
holding = "0-1"
every = "1 s"
"""


class Clock(CustomUnit):
    """Holding registers, each its address at first; a read or write takes as long as it is told."""

    def __init__(self) -> None:
        self.values = list(range(100))
        self.takes = 0.0
        self.heeds = True

    async def read(self, area, address, count):
        await self.take()
        return self.values[address : address + count]

    async def write(self, area, address, values):
        await self.take()
        self.values[address : address + len(values)] = values

    async def take(self) -> None:
        until = asyncio.get_running_loop().time() + self.takes
        while (left := until - asyncio.get_running_loop().time()) > 0:
            try:
                await asyncio.sleep(left)
            except asyncio.CancelledError:
                if self.heeds:
                    raise


async def test_a_client_reads_and_writes_it_and_the_audit_says_so():
    async with gateway_bench(LISTEN + CLOCK, units={60: Clock()}) as bench:
        client = bench.client()
        assert await client.asks(60, "03 0005 0002") == "03 04 00 05 00 06"
        assert await client.asks(60, "06 0005 0111") == "06 00 05 01 11"
        assert await client.asks(60, "03 0005 0001") == "03 02 01 11"
        audits = [event for event in bench.events if isinstance(event, WriteAudit)]
        assert [(audit.unit, audit.result) for audit in audits] == [(60, "ok")]


async def test_a_write_that_is_cancelled_may_have_acted_and_the_audit_says_so():
    unit = Clock()
    async with gateway_bench(LISTEN + CLOCK, units={60: unit}) as bench:
        unit.takes = 5.0
        assert await bench.client().asks(60, "06 0005 0111") == "86 0B"
        (audit,) = [event for event in bench.events if isinstance(event, WriteAudit)]
        assert audit.result == "timeout"


async def test_slow_units_do_not_wait_for_each_other():
    slow, fast = Clock(), Clock()
    slow.takes = 0.9
    async with gateway_bench(LISTEN + CLOCK + OTHER, units={60: slow, 61: fast}) as bench:
        one, other = bench.client(), bench.client("10.0.0.8:1")
        one.ask(60, "03 0001 0001")
        asked_at = other.now()
        assert await other.asks(61, "03 0001 0001") == "03 02 00 01"
        assert other.came_at - asked_at < 0.001
        assert await one.answer() == "03 02 00 01"


async def test_a_client_that_has_left_has_written_nothing_more():
    unit = Clock()
    unit.takes = 0.4
    async with gateway_bench(LISTEN + CLOCK, units={60: unit}) as bench:
        one, gone = bench.client(), bench.client("10.0.0.8:1")
        one.ask(60, "06 0001 0AAA")
        gone.ask(60, "06 0001 0BBB")
        gone.close()
        assert await one.answer() == "06 00 01 0A AA"
        await asyncio.sleep(2.0)
        assert unit.values[1] == 0x0AAA


async def test_a_broadcast_reaches_it():
    unit = Clock()
    async with gateway_bench(LISTEN + CLOCK, units={60: unit}) as bench:
        bench.client().ask(0, "06 0001 0777")
        await asyncio.sleep(0.1)
        assert unit.values[1] == 0x0777


async def test_a_virtual_unit_polls_it():
    unit = Clock()
    async with gateway_bench(LISTEN + CLOCK + BLOCK, units={60: unit}) as bench:
        client = bench.client()
        assert await client.asks(70, "03 000A 0002") == "03 04 00 00 00 01"
        unit.values[1] = 9
        await asyncio.sleep(1.1)
        assert await client.asks(70, "03 000A 0002") == "03 04 00 00 00 09"
        unit.takes = 5.0
        await asyncio.sleep(10.0)
        assert await client.asks(70, "03 000A 0002") == "83 0B"  # stale, and it rests
        assert [event.device for event in bench.events if isinstance(event, UnitResting)] == ["clock"]


class Asks(CustomUnit):
    """Asks another unit of the gateway."""

    async def read(self, area, address, count):
        return await self.unit("clock").read_holding(address, count)


async def test_it_finds_other_units_once_the_gateway_lets_it():
    class Found:
        async def read_holding(self, address, count):
            return [address + 1] * count

    async with gateway_bench(LISTEN + OTHER, units={61: Asks()}) as bench:
        client, asked = bench.client(), []
        assert await client.asks(61, "03 0001 0001") == "83 04"
        (event,) = [event for event in bench.events if isinstance(event, CustomUnitFailed)]
        assert "this unit belongs to no gateway that has been started" in event.error
        bench.running.builder.custom.find = lambda unit: asked.append(unit) or Found()
        assert await client.asks(61, "03 0001 0001") == "03 02 00 02"
        assert asked == ["clock"]


async def test_a_reload_that_changes_others_interrupts_nothing():
    unit = Clock()
    async with gateway_bench(LISTEN + CLOCK, units={60: unit, 61: Clock()}) as bench:
        client, image = bench.client(), bench.gateway.images[0]
        unit.takes = 0.5
        client.ask(60, "03 0001 0001")
        await bench.reload(LISTEN + CLOCK + OTHER)
        assert bench.gateway.images[0] is image
        assert await client.answer() == "03 02 00 01"
        assert await client.asks(61, "03 0002 0001") == "03 02 00 02"


async def test_a_reload_that_changes_or_removes_it_ends_what_it_does():
    unit = Clock()
    async with gateway_bench(LISTEN + CLOCK, units={60: unit, 61: Clock()}) as bench:
        one, other = bench.client(), bench.client("10.0.0.8:1")
        for config in (LISTEN + CLOCK + 'timeout = "3 s"\n', LISTEN + OTHER):
            unit.takes = 0.9
            one.ask(60, "06 0001 0001")
            other.ask(60, "06 0002 0001")
            await asyncio.sleep(0.1)
            await bench.reload(config)
            assert (await one.answer(), await other.answer()) == ("86 0B", "86 0A")
            unit.takes = 2.0
            if config.endswith('"3 s"\n'):
                assert await one.asks(60, "03 0003 0001") == "03 02 00 03"
        assert await one.asks(60, "03 0003 0001") == "83 0A"
        assert unit.values[2] == 2


async def test_at_the_stop_what_is_open_is_answered_and_what_does_not_end_is_told():
    unit, bench = Clock(), None
    unit.takes, unit.heeds = 20.0, False
    bench = GatewayBench(LISTEN + CLOCK.rstrip() + '\ntimeout = "30 s"\n', units={60: unit})
    async with keep_lines_open(bench.running):
        one, other = bench.client(), bench.client("10.0.0.8:1")
        one.ask(60, "06 0001 0001")
        other.ask(60, "06 0002 0001")
        await asyncio.sleep(0.1)
        await bench.running.drain(lambda: True)
        assert (await one.answer(), await other.answer()) == ("86 0B", "86 0A")
        ending = one.now()
    assert 1.0 <= one.now() - ending < 1.1
    assert bench.events[-1] == CustomUnitsLeft(("clock",))


async def test_the_trace_says_what_became_of_its_requests():
    unit = Clock()
    async with gateway_bench(LISTEN + CLOCK, units={60: unit}) as bench:
        one, other = bench.client(), bench.client("10.0.0.8:1")
        unit.takes = 5.0
        one.ask(60, "06 0001 0001")
        await asyncio.sleep(0.1)
        unit.heeds = False
        other.ask(60, "06 0002 0001")
        assert (await one.answer(), await other.answer()) == ("86 0B", "86 06")
        told = [sentences(story) for story in stories(bench.running, ToExplain("clock"), (0.0, 0.0)).stories]
        assert [each.partition(" The result")[0] for each in told] == [
            "It was refused: it waited 1 s for earlier requests to clock. The unit was not asked.",
            "It failed: clock did not answer within 1 s. It was cancelled; the unit may have acted.",
        ]


async def test_the_status_says_how_it_is():
    unit = Clock()
    async with gateway_bench(LISTEN + CLOCK, units={60: unit}) as bench:

        def shown():
            (image,) = status(bench.running).images
            return image.state, image.rests_ms

        client, before = bench.client(), shown()
        unit.takes = 5.0
        assert [await client.asks(60, "03 0001 0001")] == ["83 0B"]
        assert (before, shown()) == (("fine", 0.0), ("failing", 0.0))
        assert [await client.asks(60, "03 0001 0001") for _ in range(2)] == ["83 0B"] * 2
        assert shown() == ("resting", 9000.0)


async def test_it_has_no_values_of_its_own_to_be_shown():
    async with gateway_bench(LISTEN + CLOCK, units={60: Clock()}) as bench:
        span = Span(Area.HOLDING, 0, 2)
        assert kept(bench.gateway, 60, [span], 0.0) == [None]
        assert window(bench.gateway, 60, span, [span], 0.0) is None
        assert target(bench.gateway, 60) is bench.gateway.images[0]


async def test_an_exception_of_its_own_is_what_the_client_gets():
    class Broken(CustomUnit):
        async def read(self, area, address, count):
            raise DeviceFailure("no sensor")

    async with gateway_bench(LISTEN + CLOCK, units={60: Broken()}) as bench:
        assert await bench.client().asks(60, "03 0001 0001") == "83 04"
