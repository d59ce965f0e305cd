"""Clients that ask without end, and others: each has its share of the line, and is not refused for them (C11)."""

import asyncio
import itertools
import random
from collections.abc import Iterator
from statistics import median

import pytest

from gateway.events import QueueFull
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import Client, GatewayBench, gateway_bench

CONFIG = """
[[line]]
port    = "/dev/hall-a"
baud    = 9600
devices = [{ unit = 1 }, { unit = 2, priority = "high" }]

[[access]]
from  = ["127.0.0.0/8"]
units = "all"
allow = ["read", "write"]
"""
#: Clients of one network have priority, and there is a mirror that is polled as often as the line allows.
PRIORITY = """
[[access]]
from     = ["127.0.3.0/24"]
allow    = ["read", "write"]
priority = "high"
"""
MIRROR = """
[[image]]
unit = 241
of   = "hall-a/1"
read = [{ holding = "100-109", every = "100 ms" }]
"""
CONFIG_WITH_PRIORITY = PRIORITY + CONFIG + MIRROR
WRITE = (1, "06 0001 0005")
READ_OF_HIGH_PRIORITY = (2, "03 0001 0001")


class Asking:
    """A client that asks again as soon as it is answered, or at times; a network takes a millisecond."""

    def __init__(self, client: Client, unit: int, pdu: str, pauses: Iterator[float] | None = None) -> None:
        self.times: list[float] = []
        self.failed = 0
        self._client = client
        self._question = (unit, pdu)
        self._pauses = pauses or itertools.repeat(0.001)
        self._task = asyncio.create_task(self._ask())

    def stop(self) -> int:
        """How often it was answered."""
        self._task.cancel()
        return len(self.times)

    async def _ask(self) -> None:
        while True:
            begin = self._client.now()
            answer = await self._client.asks(*self._question)
            self.failed += int(answer[:2], 16) >= 0x80
            self.times.append(self._client.now() - begin)
            await asyncio.sleep(next(self._pauses))


async def reading(bench: GatewayBench, number: int, also: tuple[int, str] | None = None) -> tuple[list[Asking], int]:
    """So many readers, each from its own address, and what else is asked `also`; how often that was answered."""
    asking = [Asking(bench.client(f"127.0.1.{n}:1", host=f"127.0.1.{n}"), 1, f"03 {n:04X} 000A") for n in range(number)]
    others = [Asking(bench.client("127.0.2.1:1", host="127.0.2.1"), *also)] if also else []
    await asyncio.sleep(20)
    for each in asking:
        each.stop()
    return asking, sum(each.stop() for each in others)


@pytest.mark.parametrize("also", [WRITE, READ_OF_HIGH_PRIORITY], ids=["write", "high"])
async def test_who_writes_without_end_has_a_turn_in_each_round_like_the_others(also: tuple[int, str]) -> None:
    async with gateway_bench(CONFIG) as bench:
        bench.attach("hall-a", SimulatedLine("rtu", SimulatedDevice(1), SimulatedDevice(2)))
        undisturbed, _ = await reading(bench, 8)
        disturbed, count = await reading(bench, 8, also)
        shares = [len(each.times) / count for each in disturbed]
        assert 0.95 < min(shares) <= max(shares) < 1.05
        assert median(disturbed[0].times) < 9 / 8 * median(undisturbed[0].times) + 0.002


# --- clients with priority ---


def from_control_room(bench: GatewayBench, unit: int, pdu: str, number: int = 1, **more: Iterator[float]) -> Asking:
    host = f"127.0.3.{number}"
    return Asking(bench.client(f"{host}:1", host=host), unit, pdu, **more)


@pytest.mark.parametrize("function", ["03", "06"])
async def test_a_client_with_priority_that_asks_without_end_has_one_turn_in_a_round_of_the_others(
    function: str,
) -> None:
    async with gateway_bench(CONFIG_WITH_PRIORITY) as bench:
        bench.attach("hall-a", SimulatedLine("rtu", SimulatedDevice(1), SimulatedDevice(2)))
        await asyncio.sleep(5)  # the mirror has asked before there was a device
        own = [from_control_room(bench, 1, f"{function} 1{number:03} 0001", number) for number in (1, 2)]
        others, _ = await reading(bench, 8)
        counts = [each.stop() for each in own]
        assert all(0.9 < len(each.times) / count < 1.1 for each in others for count in counts)


@pytest.mark.parametrize(("unit", "pdu"), [(1, "03 0001 000A"), (1, "06 0001 0005"), (241, "06 0064 0005")])
@pytest.mark.parametrize("also", [None, WRITE, READ_OF_HIGH_PRIORITY], ids=["reads", "write", "high"])
async def test_a_client_with_priority_waits_for_what_is_on_the_line_and_at_most_one_more(
    unit: int, pdu: str, also: tuple[int, str] | None
) -> None:
    """It asks a line, or through a mirror, once in a round or less; the one more may be the poll of the mirror."""
    dice = random.Random(3)
    pauses = (dice.uniform(2.0, 4.0) for _ in itertools.count())
    async with gateway_bench(CONFIG_WITH_PRIORITY) as bench:
        bench.attach("hall-a", SimulatedLine("rtu", SimulatedDevice(1), SimulatedDevice(2)))
        await asyncio.sleep(5)  # the mirror has asked before there was a device
        alone = from_control_room(bench, unit, pdu)
        await asyncio.sleep(1)
        assert alone.stop()
        own = from_control_room(bench, unit, pdu, pauses=pauses)
        others = [Asking(bench.client(f"127.0.4.{n}:1", host=f"127.0.4.{n}"), *also) for n in range(8 * bool(also))]
        readers, _ = await reading(bench, 8)
        own.stop()
        for each in others:
            each.stop()
        waiting, turn = 8 + len(others), median(readers[0].times) / (8 + len(others))
        assert max(own.times[1:]) < max(alone.times) + 2.2 * turn
        assert median(readers[0].times) > (waiting - 1) * turn, "the line is busy"
        assert [each.failed for each in (own, *readers)] == [0] * 9


async def test_a_writer_costs_none_of_many_readers_its_answer() -> None:
    async with gateway_bench(CONFIG) as bench:
        bench.attach("hall-a", SimulatedLine("rtu", SimulatedDevice(1), SimulatedDevice(2)))
        readers, _ = await reading(bench, 48, WRITE)
        assert [each.failed for each in readers] == [0] * 48


async def test_a_host_has_no_larger_share_for_more_connections() -> None:
    async with gateway_bench(CONFIG) as bench:
        bench.attach("hall-a", SimulatedLine("rtu", SimulatedDevice(1), SimulatedDevice(2)))
        many = [Asking(bench.client(f"127.0.1.1:{n}", host="127.0.1.1"), 1, f"03 {n:04X} 0001") for n in range(31)]
        modest = Asking(bench.client("127.0.2.1:1", host="127.0.2.1"), 1, "03 0064 0001")
        await asyncio.sleep(20)
        assert modest.stop() == pytest.approx(sum(each.stop() for each in many), rel=0.05)


async def test_a_modest_client_waits_for_no_more_turns_than_there_are_clients() -> None:
    async with gateway_bench(CONFIG) as bench:
        bench.attach("hall-a", SimulatedLine("rtu", SimulatedDevice(1)))
        greedy, modest = bench.client("10.0.0.9:1"), bench.client("10.0.0.7:1")
        for address in range(16):
            greedy.ask(1, f"03 {address:04X} 0001")

        async def greedy_asks(times: int) -> None:
            for number in range(times):
                await greedy.answer()
                greedy.ask(1, f"03 {number:04X} 0001")

        begin = greedy.now()
        await greedy_asks(times=100)
        turn = (greedy.now() - begin) / 100
        for number in range(20):
            await greedy_asks(times=10)
            await asyncio.sleep(turn * number / 20)
            begin = modest.now()
            assert await modest.asks(1, "03 0064 0001") == "03 02 00 00"
            waited = modest.came_at - begin - turn
            assert waited <= 2 * turn + 0.001


async def test_a_client_with_one_request_is_not_refused_though_others_have_filled_the_queue() -> None:
    """Promise P18: five connections of one host keep sixteen requests each under way, and 64 may wait."""
    async with gateway_bench(CONFIG) as bench:
        bench.attach("hall-a", SimulatedLine("rtu", SimulatedDevice(1)))
        greedy = [bench.client(f"10.0.0.9:{number}", host="127.0.0.9") for number in range(5)]
        modest = bench.client("10.0.0.7:1", host="127.0.0.7")
        asking = [asyncio.create_task(keeps_asking(client)) for client in greedy]
        await asyncio.sleep(1)
        for _ in range(12):
            assert await modest.asks(1, "03 0064 0001") == "03 02 00 00"
            await asyncio.sleep(1)
        assert {told.client[:8] for told in queue_full(bench)} == {"10.0.0.9"}
        for task in asking:
            task.cancel()


@pytest.mark.search
async def test_clients_that_ask_again_at_once_are_not_refused_over_and_over() -> None:
    """Each refusal costs the processor what the lines need: there are not many more of them than answers."""
    async with gateway_bench(CONFIG) as bench:
        bench.attach("hall-a", SimulatedLine("rtu", SimulatedDevice(1)))
        greedy = [bench.client(f"10.0.0.9:{number}", host="127.0.0.9") for number in range(60)]
        asking = [asyncio.create_task(keeps_asking(client)) for client in greedy]
        await asyncio.sleep(5)
        refused_before = refused(bench)
        await asyncio.sleep(10)
        assert 100 < (refused(bench) - refused_before) / 10 < 1000
        for task in asking:
            task.cancel()


async def keeps_asking(client: Client) -> None:
    """Keep sixteen requests under way, whatever is answered; a network takes a millisecond."""
    for address in range(16):
        client.ask(1, f"03 {address:04X} 0001")
    for number in itertools.count(16):
        await client.answer()
        await asyncio.sleep(0.001)
        client.ask(1, f"03 {number:04X} 0001")


def refused(bench: GatewayBench) -> int:
    return sum(event.times or 1 for event in queue_full(bench))


def queue_full(bench: GatewayBench) -> list[QueueFull]:
    return [event for event in bench.events if isinstance(event, QueueFull)]
