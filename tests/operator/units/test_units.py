"""What an operator asks of units: as a client like others, with its rights, queue and audits. In virtual time."""

import asyncio

import pytest

from gateway.errors import WrongQuestion
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.operator.operator import Operator
from gateway.operator.units.units import points_within
from kit.asking import NO_FILE, answers, pictured
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import gateway_bench

CONFIG = """
[[line]]
name = "hall"
port = "/dev/hall"
devices = [{ unit = 1, as = 41, name = "silo-1", profile = "weigher" }, { unit = 6, name = "press" }]

[[image]]
unit = 200
name = "shift"
holding = 2
initial.holding = [{ at = 0, values = [7] }]

[[image]]
unit = 241
of = "silo-1"
read = [{ holding = "0-1", every = "1 s" }]

[[upstream]]
name = "plant"
to = "tcp://10.1.0.5"
units = [{ as = 37, unit = 1 }]
"""


async def asked(bench, unit, pdu, *, is_there=lambda: True):
    (answer,) = await answers(bench.running, {"verb": "request", "unit": unit, "pdu": pdu}, is_there=is_there)
    return answer


async def test_a_device_answers_by_number_and_by_name():
    async with gateway_bench(CONFIG) as bench:
        bench.attach("hall", SimulatedLine("rtu", SimulatedDevice(6)))
        answer = await asked(bench, 6, "03 00 00 00 01")
        assert (answer["unit"], answer["pdu"]) == (6, "03 02 00 00")
        assert 0 < answer["elapsed_ms"] < 100
        assert (await asked(bench, "press", "030000 0001"))["pdu"] == "03 02 00 00"
        assert (await asked(bench, "shift", "0300000001"))["pdu"] == "03 02 00 07"


async def test_why_there_is_no_response_is_told():
    async with gateway_bench(CONFIG) as bench:
        answer = await asked(bench, "press", "03 00 00 00 01")
        assert (answer["pdu"], answer["result"]) == ("83 0B", "timeout")
        answer = await asked(bench, 99, "03 00 00 00 01")
        assert (answer["pdu"], answer["result"], answer["reason"]) == ("83 0A", "no_route", "no such unit")
        answer = await asked(bench, "silo-1", "04 00 00 00 01")
        assert (answer["pdu"], answer["reason"]) == ("84 01", "profile weigher has no function 4")


async def test_a_write_is_audited_as_that_of_the_client_control():
    async with gateway_bench(CONFIG) as bench:
        assert (await asked(bench, 200, "06 00 01 00 05"))["pdu"] == "06 00 01 00 05"
        (audit,) = [event for event in bench.events if event.name == "write_audit"]
        assert (audit.client, audit.listener, audit.unit, audit.result) == ("control", "control", 200, "ok")


@pytest.mark.parametrize(
    ("rows", "may_write"),
    [
        ('[[access]]\nlisten = ["default"]\nallow = ["read"]\n', True),
        ('[[access]]\nfrom = ["127.0.0.1"]\nallow = []\n', True),
        ('[[access]]\nlisten = ["control"]\nallow = ["read"]\n', False),
    ],
)
async def test_the_operator_keeps_all_rights_until_a_row_names_control(rows, may_write):
    async with gateway_bench(CONFIG + rows) as bench:
        answer = await asked(bench, 200, "06 00 01 00 05")
        assert (answer["pdu"] == "06 00 01 00 05") is may_write
        assert (answer.get("result") == "denied") is not may_write
        assert (await asked(bench, 200, "03 00 00 00 01"))["pdu"] == "03 02 00 07"


async def test_what_waits_of_an_operator_who_has_left_is_dropped_if_it_is_a_write():
    async with gateway_bench(CONFIG) as bench:
        sent = []
        bench.lines["hall"].on_write = sent.append
        first = asyncio.create_task(asked(bench, 6, "03 00 00 00 01"))
        await asyncio.sleep(0)
        write = asyncio.create_task(asked(bench, 6, "06 00 00 00 01", is_there=lambda: False))
        read = asyncio.create_task(asked(bench, 6, "04 00 00 00 01", is_there=lambda: False))
        assert (await write)["pdu"] == "86 06"
        await first
        await read
        assert [data[1] for data in sent if data[0] == 6] == [3, 4]


async def test_the_operator_who_is_cancelled_wants_nothing_more():
    async with gateway_bench(CONFIG) as bench:
        sent = []
        bench.lines["hall"].on_write = sent.append
        first = asyncio.create_task(asked(bench, 6, "03 00 00 00 01"))
        await asyncio.sleep(0)
        second = asyncio.create_task(asked(bench, 6, "04 00 00 00 02"))
        await asyncio.sleep(0)
        second.cancel()
        await first
        await asyncio.sleep(5)
        assert len([data for data in sent if data[0] == 6]) == 1


@pytest.mark.parametrize(
    ("unit", "pdu", "reason"),
    [
        ("silo1", "03", 'nothing has the name "silo1"; did you mean "silo-1"\\?'),
        (None, "03", '"unit" must be a number from 0 to 255, or a name'),
        (256, "03", '"unit" must be a number'),
        (True, "03", '"unit" must be a number'),
        (6, "", '"pdu" must be 1 to 253 bytes'),
        (6, None, '"pdu" must be'),
        (6, "3", '"pdu" must be'),
        (6, "00" * 254, '"pdu" must be'),
    ],
)
async def test_a_wrong_question_is_refused_in_plain_words(unit, pdu, reason):
    async with gateway_bench(CONFIG) as bench:
        with pytest.raises(WrongQuestion, match=reason):
            await asked(bench, unit, pdu)


async def test_a_unit_is_shown_with_what_it_accepts_and_its_points():
    async with gateway_bench(CONFIG) as bench:
        silo = pictured(bench.running, "silo-1")
        assert (silo.unit, silo.kind, silo.profile, silo.functions) == (41, "device", "weigher", (3, 16))
        assert [point.name for point in silo.points][:3] == ["weight", "baud", "address"]
        assert silo.longest_wait_ms > 3000
        assert pictured(bench.running, 6).functions is None
        image = pictured(bench.running, 200)
        assert (image.kind, image.longest_wait_ms) == ("image", 0.0)
        assert pictured(bench.running, "image-241").points[0].name == "weight"
        assert pictured(bench.running, 37).kind == "upstream"
        with pytest.raises(WrongQuestion, match="there is no unit 99; modbus-gateway check lists"):
            pictured(bench.running, 99)


async def test_a_number_that_only_a_listener_of_its_own_leads_to_is_asked_there():
    listener = '[[listen]]\nbind = "tcp://127.0.0.1:5021"\nupstream = "plant"\n'
    async with gateway_bench(listener + CONFIG) as bench:
        with pytest.raises(WrongQuestion, match=r"no unit 99 that all clients can reach; .*--tcp with that address; "):
            pictured(bench.running, 99)


async def test_points_near_some_addresses_are_found_in_their_order():
    points = [("last", 9, "uint16"), ("bit", 5, "uint16"), ("long", 3, "float64"), ("before", 1, "uint16")]
    listed = ", ".join(f'{{ name = "{name}", holding = {at}, type = "{kind}" }}' for name, at, kind in points)
    listed += ', { name = "other", input = 5 }'
    config = f'[[line]]\nport = "/dev/hall"\ndevices = [{{ unit = 1, name = "silo", points = [{listed}] }}]\n'
    async with gateway_bench(config) as bench:
        operator = Operator(bench.running, NO_FILE)
        unit = pictured(bench.running, "silo")

        def near(start, count):
            return [each.name for each in points_within(operator, unit, Span(Area.HOLDING, start, count))]

        assert near(0, 100) == ["before", "long", "bit", "last"]
        assert near(6, 3) == ["long"]
        assert near(2, 1) == []
        assert near(7, 3) == ["last"]
        await bench.reload(config.replace('"last"', '"end"'))
        unit = pictured(bench.running, "silo")
        assert near(7, 3) == ["end"]
