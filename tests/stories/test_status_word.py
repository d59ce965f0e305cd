"""A status word of 16 alarms, one register: read by their names, and each acknowledged without touching the others."""

import asyncio
from collections.abc import AsyncIterator

import pytest

from gateway.control.server import carry_out
from gateway.errors import DoesNotFit, WrongQuestion
from gateway.operator.operations.operation import Asker
from gateway.operator.operator import Operator
from gateway.request import Caller
from kit.asking import ask
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import GatewayBench, gateway_bench

ADDRESS = 8
ALARMS = [f"alarm-{bit}" for bit in range(16)]
POINTS = "\n".join(
    f'  {{ name = "{name}", holding = {ADDRESS}, bit = {bit}, labels = {{ 0 = "ok", 1 = "alarm" }}, write = true }},'
    for bit, name in enumerate(ALARMS)
)
CONFIG = """
[profile.annunciator]
{functions}
points = [
{points}
  {{ name = "word", holding = 8, write = true }},
]

[[line]]
name    = "hall"
port    = "/dev/hall"
devices = [{{ unit = 3, name = "panel", profile = "annunciator" }}]
"""
#: What the profile says of its functions, and what a write to one bit is on the line.
WITH_MASK = pytest.param("functions = [3, 6, 22]", [22], id="function 22")
IN_ONE_TURN = [
    pytest.param("functions = [3, 6]", [3, 6], id="a turn with 06"),
    pytest.param("functions = [3, 16]", [3, 16], id="a turn with 16"),
    pytest.param("", [3, 6], id="a turn where no function is named"),
]


@pytest.fixture
async def bench(request: pytest.FixtureRequest) -> AsyncIterator[GatewayBench]:
    async with gateway_bench(CONFIG.format(functions=request.param, points=POINTS)) as bench:
        yield bench


def panel(bench: GatewayBench) -> SimulatedDevice:
    device = SimulatedDevice(3, delay=0.02)
    bench.attach("hall", SimulatedLine("rtu", device))
    return device


async def write(bench: GatewayBench, name: str, value: str, client: str = "control") -> None:
    asker = Asker(Caller.without_address(client), lambda: True)
    asked = {"verb": "write-point", "unit": "panel", "name": name, "values": [value]}
    (_,) = [answer async for answer in carry_out(asked, Operator(bench.running, None), asker)]


def functions_heard(device: SimulatedDevice) -> list[int]:
    return [frame.pdu[0] for frame in device.heard]


@pytest.mark.parametrize("bench", ["functions = [3, 6]"], indirect=True)
async def test_all_alarms_are_read_by_name_with_one_request(bench: GatewayBench) -> None:
    device = panel(bench)
    device.holding[ADDRESS] = 0b1000_0000_0000_0101
    told = (await ask(bench.running, "points", unit="panel"))["values"]
    assert {each.point: each.value for each in told} == {
        "word": 0x8005,
        **{name: "alarm" if bit in (0, 2, 15) else "ok" for bit, name in enumerate(ALARMS)},
    }
    assert functions_heard(device) == [3]


@pytest.mark.parametrize(("bench", "functions"), [WITH_MASK, *IN_ONE_TURN], indirect=["bench"])
async def test_each_bit_is_written_alone(bench: GatewayBench, functions: list[int]) -> None:
    device = panel(bench)
    for bit, name in enumerate(ALARMS):
        for before in (0x0000, 0xFFFF, 0xA5C3):
            device.holding[ADDRESS] = before
            device.heard.clear()
            await write(bench, name, "alarm")
            assert device.holding[ADDRESS] == before | 1 << bit
            assert functions_heard(device) == functions
            await write(bench, name, "ok")
            assert device.holding[ADDRESS] == before & ~(1 << bit)


@pytest.mark.parametrize(("bench", "functions"), [WITH_MASK, *IN_ONE_TURN], indirect=["bench"])
async def test_two_clients_write_different_bits_at_the_same_time_and_none_is_lost(
    bench: GatewayBench, functions: list[int]
) -> None:
    device = panel(bench)
    device.holding[ADDRESS] = 0x00FF
    await asyncio.gather(
        *(write(bench, ALARMS[bit], "ok", "control room") for bit in range(8)),
        *(write(bench, ALARMS[bit], "alarm", "gate house") for bit in range(8, 16)),
    )
    assert device.holding[ADDRESS] == 0xFF00
    assert functions_heard(device) == functions * 16


@pytest.mark.parametrize(
    ("bench", "whole"),
    [("functions = [3, 6]", "06 0008"), ("functions = [3, 16]", "10 0008 0001 02")],
    indirect=["bench"],
)
async def test_a_client_that_writes_the_whole_word_comes_before_a_turn_or_behind_it(
    bench: GatewayBench, whole: str
) -> None:
    device, plant = panel(bench), bench.client()
    for value in range(20):
        word = 0x0100 + value
        device.heard.clear()
        bit = asyncio.create_task(write(bench, "alarm-15", "alarm"))
        await asyncio.sleep(0.005 * value)
        plant.ask(3, f"{whole} {word:04X}")
        await asyncio.gather(bit, plant.answer())
        assert device.holding[ADDRESS] in (word, word | 0x8000)
        heard = functions_heard(device)
        reading = heard.index(3)
        assert heard[reading + 1] in (6, 16), "something came between"
        assert len(heard) == 3


@pytest.mark.parametrize("bench", ["functions = [3, 6]"], indirect=True)
async def test_reads_of_other_clients_go_on_around_a_turn(bench: GatewayBench) -> None:
    device, reader = panel(bench), bench.client("10.0.0.8:50000")
    device.holding[ADDRESS] = 0x0F0F
    writing = asyncio.gather(*(write(bench, name, "ok") for name in ALARMS))
    seen = [await reader.asks(3, "03 0008 0001") for _ in range(10)]
    await writing
    assert all(answer.startswith("03 02 ") for answer in seen)
    assert device.holding[ADDRESS] == 0


@pytest.mark.parametrize("bench", ["functions = [3, 6]", ""], indirect=True)
async def test_nothing_is_written_when_the_word_cannot_be_read(bench: GatewayBench) -> None:
    device = panel(bench)
    device.holding[ADDRESS] = 0x0F0F
    device.refuses[3] = 4
    with pytest.raises(WrongQuestion, match="04"):
        await write(bench, "alarm-5", "alarm")
    device.refuses.clear()
    device.silent = True
    with pytest.raises(WrongQuestion):
        await write(bench, "alarm-5", "alarm")
    assert device.holding[ADDRESS] == 0x0F0F
    assert set(functions_heard(device)) == {3}


@pytest.mark.parametrize("bench", ["functions = [3, 6]"], indirect=True)
async def test_what_is_no_state_of_an_alarm_is_refused(bench: GatewayBench) -> None:
    device = panel(bench)
    with pytest.raises(DoesNotFit, match="it has the labels ok, alarm"):
        await write(bench, "alarm-5", "broken")
    assert device.heard == []
