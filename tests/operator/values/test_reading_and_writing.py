"""Values of units are read and written at the control socket as over HTTP, with the rights of the control socket."""

import asyncio

import pytest

from gateway.control.server import carry_out
from gateway.errors import DoesNotFit, ExceptionReceived, Malformed, NotPermitted, WrongQuestion
from gateway.modbus.rtu import with_crc
from gateway.operator.operations.operation import Asker
from gateway.operator.operator import Operator
from gateway.operator.values.requests import AT_CONTROL
from kit.asking import ask
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import gateway_bench

CONFIG = """
[[line]]
name = "hall"
port = "/dev/hall"
devices = [{ unit = 6, as = 46, name = "press", points = [
  { name = "speed", holding = 0, type = "int32", swap = "words", scale = 0.1, unit = "rpm", write = true },
  { name = "count", holding = 3 },
  { name = "start", coils = 0, write = "only" },
] }]

[[image]]
unit = 200
name = "shift"
holding = 3000
coils = 16
"""
READ_ONLY = """
[[access]]
listen = ["control"]
units = [46]
allow = ["read"]

[[access]]
listen = ["control"]
units = [200]
functions = [1]
"""


@pytest.fixture
async def bench():
    async with gateway_bench(CONFIG) as bench:
        bench.attach("hall", SimulatedLine("rtu", SimulatedDevice(6)))
        yield bench


async def test_a_point_is_written_once_in_the_name_of_the_control_socket(bench):
    told = await ask(bench.running, "write-point", unit="press", name="speed", values=[12.5])
    assert [(each.value, each.registers) for each in told["values"]] == [(12.5, [125, 0])]
    (audit,) = [event for event in bench.events if event.name == "write_audit"]
    assert (audit.client, audit.function, audit.count, audit.result) == ("control", 16, 2, "ok")
    (value,) = (await ask(bench.running, "point", unit=46, name="speed"))["values"]
    assert (value.value, value.unit) == (12.5, "rpm")


async def test_values_are_written_and_read_by_their_addresses(bench):
    place = {"unit": "shift", "area": "holding", "start": 10, "end": 13, "type": "int32", "swap": "words"}
    await ask(bench.running, "write", **place, values=[-2, 70000])
    told = await ask(bench.running, "read", **place)
    assert [each.value for each in told["values"]] == [-2, 70000]
    assert told["area"] == "holding"
    told = await ask(bench.running, "image", unit=200, area="holding", start=10, end=11)
    assert [(each.value, each.writer) for each in told["values"]] == [(65534, "control"), (65535, "control")]


async def test_points_are_not_read_twice_within_the_age_that_will_do_and_anew_after_a_write(bench):
    operator, asker = Operator(bench.running, None), Asker(AT_CONTROL, lambda: True)

    async def asked(verb, **details):
        (answer,) = [each async for each in carry_out({"verb": verb, "unit": 46, **details}, operator, asker)]
        return answer["values"][0].value, answer.get("age_ms")

    assert await asked("points") == (0, pytest.approx(0, abs=100))
    await asyncio.sleep(10)
    assert await asked("points", max_age=60) == (0, pytest.approx(10_000, abs=100))
    assert await asked("points", max_age=5) == (0, pytest.approx(0, abs=100))
    await asked("write-points", values=[{"point": "speed", "value": 7}])
    assert await asked("points", max_age=60) == (7, pytest.approx(0, abs=100))


@pytest.mark.parametrize(
    ("verb", "details", "kind"),
    [
        ("read", {"unit": 46, "area": "holding", "start": 2, "end": 1}, Malformed),
        ("read", {"unit": 46, "area": "tables", "start": 0}, Malformed),
        ("read", {"unit": 46, "area": "holding", "start": 0, "type": "int33"}, Malformed),
        ("read", {"unit": 300, "area": "holding", "start": 0}, Malformed),
        ("read", {"unit": "nobody", "area": "holding", "start": 0}, WrongQuestion),
        ("read", {"unit": 99, "area": "holding", "start": 0}, ExceptionReceived),
        ("read", {"unit": 200, "area": "holding", "start": 3000}, ExceptionReceived),
        ("point", {"unit": 46, "name": "start"}, DoesNotFit),
        ("write", {"unit": 200, "area": "holding", "start": 0, "values": []}, Malformed),
        ("write", {"unit": 200, "area": "holding", "start": 0, "values": [1, 2]}, Malformed),
        ("write", {"unit": 200, "area": "holding", "start": 0, "values": [None]}, DoesNotFit),
        ("write", {"unit": 200, "area": "input", "start": 0, "values": [1]}, DoesNotFit),
        ("write-point", {"unit": 46, "name": "count", "values": [1]}, DoesNotFit),
        ("write-points", {"unit": 46, "values": [{"point": "speed"}]}, Malformed),
        ("image", {"unit": 46, "area": "holding", "start": 0}, WrongQuestion),
        ("line-history", {"name": "hall"}, WrongQuestion),
    ],
)
async def test_what_cannot_be_carried_out_is_refused_and_nothing_is_written(bench, verb, details, kind):
    with pytest.raises(WrongQuestion) as refused:
        await ask(bench.running, verb, **details)
    assert type(refused.value) is kind
    assert [event for event in bench.events if event.name == "write_audit"] == []


async def test_rights_are_those_of_the_control_socket():
    async with gateway_bench(CONFIG + READ_ONLY) as bench:
        bench.attach("hall", SimulatedLine("rtu", SimulatedDevice(6)))
        assert (await ask(bench.running, "point", unit=46, name="count"))["values"]
        with pytest.raises(ExceptionReceived) as refused:
            await ask(bench.running, "write-point", unit=46, name="speed", values=[1])
        assert (refused.value.code, refused.value.result) == (1, "denied")
        with pytest.raises(NotPermitted, match="does not let control read holding"):
            await ask(bench.running, "image", unit=200, area="holding", start=0)


async def test_lines_and_units_are_told(bench):
    assert [each.name for each in (await ask(bench.running, "lines"))["lines"]] == ["hall"]
    assert (await ask(bench.running, "line", name="hall"))["line"].state == "up"
    assert [each.name for each in (await ask(bench.running, "units"))["units"]] == ["press", "shift"]
    assert (await ask(bench.running, "unit-status", unit=46))["unit"].status.line == "hall"
    with pytest.raises(WrongQuestion, match="there is no line yard"):
        await ask(bench.running, "line", name="yard")


async def test_registers_of_four_bytes_are_read_and_written_by_address():
    """As a flow computer has them: one register is one number of 32 bits."""
    wide = CONFIG.replace('as = 46, name = "press", ', 'as = 46, name = "press", profile = "flow", ')
    async with gateway_bench(wide + '[profile.flow]\nwide = { holding = "100-119" }\n') as bench:
        device = SimulatedDevice(6)
        device.script.extend([[(0.01, with_crc(bytes.fromhex("06 03 08 00 01 11 70 BF 80 00 00")))]] * 2)
        bench.attach("hall", SimulatedLine("rtu", device))
        place = {"unit": 46, "area": "holding", "start": 100, "end": 101}
        told = (await ask(bench.running, "read", **place))["values"]
        assert [(each.address, each.value) for each in told] == [(100, 70000), (101, 0xBF800000)]
        told = (await ask(bench.running, "read", **place, type="float32"))["values"]
        assert told[1].value == -1.0
        device.script.append([(0.01, with_crc(bytes.fromhex("06 10 00 65 00 01")))])
        await ask(bench.running, "write", **{**place, "start": 101}, values=[70000])
        assert device.heard[-1].pdu == bytes.fromhex("10 00 65 00 01 04 00 01 11 70")
