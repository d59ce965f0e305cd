"""A program asks units as any client does: what it gets is what they have, or an error that says why not."""

import asyncio
import re

import pytest

from gateway import AccessDenied, Busy, DeviceFailure, IllegalAddress, LineDown, NoResponse, NotConfigured, Refused
from gateway.errors import AnswerOverdue, OnlyHeard, QueueFull, ResponseTimeout, StaleValue, WaitedTooLong
from gateway.library.unit_client import UnitClient
from gateway.modbus import rtu
from gateway.operator.operator import Operator
from kit.asking import NO_FILE
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import GatewayBench, gateway_bench
from kit.program import unit_of

CONFIG = """
[[line]]
name = "hall"
port = "/dev/hall"
queue = 4
max_wait = "400 ms"
retries = 0
devices = [
  { unit = 6, as = 46, name = "press", timeout = "200 ms", points = [
    { name = "speed", holding = 0, type = "int32", swap = "words", scale = 0.1, unit = "rpm", write = true },
    { name = "mode", holding = 2, labels = { 0 = "off", 1 = "auto" }, write = true },
    { name = "count", input = 3, invalid = 0xFFFF },
    { name = "name", holding = 10, type = "string", length = 4, write = true },
    { name = "ready", holding = 4, bit = 3 },
    { name = "lamp", coils = 5, write = true },
    { name = "start", coils = 0, write = "only" },
    { name = "limit", holding = 5, write = true, min = 0, max = 100, unit = "%" },
  ] },
  { unit = 7, name = "wired", profile = "wide" },
]

[[line]]
name = "bus"
port = "/dev/bus"
role = "monitor"
devices = [{ unit = 3, as = 63, name = "boiler" }]

[profile.wide]
wide = { holding = "100-199" }

[[image]]
unit = 200
name = "shift"
holding = 3000
coils = 3000
"""


@pytest.fixture
async def bench():
    async with gateway_bench(CONFIG) as bench:
        bench.device = SimulatedDevice(6)
        bench.attach("hall", SimulatedLine("rtu", bench.device))
        yield bench


async def test_registers_and_bits_are_read_and_written_by_their_addresses(bench):
    press = unit_of(bench, "press")
    await press.write_holding(20, [1, 65535, 7])
    await press.write_holding(30, [9])
    await press.write_coils(8, [True, False, True])
    await press.write_coils(3, [True])
    assert bench.device.holding[20:23] == [1, 65535, 7]
    assert bench.device.coils[3:12] == [True, *[False] * 4, True, False, True, False]
    bench.device.input[3:5], bench.device.discrete[1] = [5, 6], True
    assert await press.read_holding(19, 5) == [0, 1, 65535, 7, 0]
    assert await press.read_holding(30) == [9]
    assert await press.read_input(3, 2) == [5, 6]
    assert await press.read_coils(8, 3) == [True, False, True]
    assert await press.read_discrete(0, 3) == [False, True, False]
    assert [frame.pdu[0] for frame in bench.device.heard] == [16, 6, 15, 5, 3, 3, 4, 1, 2]


async def test_points_are_written_and_read_as_their_profile_says(bench):
    press = unit_of(bench, 46)
    for point, value in {"speed": 12.5, "mode": "auto", "name": "Müll", "lamp": True, "limit": 100}.items():
        await press.write(point, value)
    bench.device.input[3], bench.device.holding[4] = 0xFFFF, 8
    read = {name: reading.value for name, reading in (await press.read_points()).items()}
    told = {"speed": 12.5, "mode": "auto", "count": None, "name": "Müll", "ready": True, "lamp": True, "limit": 100}
    assert read == told
    assert read["ready"] is True
    speed = await press.read("speed")
    assert (speed.point, speed.value, speed.unit, str(speed)) == ("speed", 12.5, "rpm", "12.5 rpm")
    assert [*await press.read_points("lamp", "count", "lamp")] == ["lamp", "count"]


async def test_the_name_of_a_unit_is_that_of_the_config(bench):
    assert (unit_of(bench, 46).name, str(unit_of(bench, "press"))) == ("press", "<UnitClient press>")
    assert unit_of(bench, "wired").name == "wired"  # asked by its name only


async def test_registers_of_four_bytes_are_whole_numbers_too(bench):
    wired, device = unit_of(bench, "wired"), SimulatedDevice(7)
    bench.attach("hall", SimulatedLine("rtu", device))
    device.script += [[(0.01, rtu.encode(7, pdu))] for pdu in (b"\3\4\1\2\3\4", bytes.fromhex("10 0064 0001"))]
    assert await wired.read_holding(100) == [0x01020304]
    await wired.write_holding(100, [70000])
    assert device.heard[1].pdu == bytes.fromhex("10 0064 0001 04 00011170")
    for asked in wired.read_holding(99, 2), wired.write_holding(199, [1, 2]):
        with pytest.raises(ValueError, match=r"wired: only some of holding .* have four bytes: ask for them apart"):
            await asked
    with pytest.raises(ValueError, match="4294967296 does not fit into holding: whole numbers from 0 to 4294967295"):
        await wired.write_holding(100, [2**32])


@pytest.mark.parametrize(
    ("asked", "says"),
    [
        (lambda press: press.read_holding(0, 126), "press: one request reads at most 125 of holding, not 126"),
        (lambda press: press.read_coils(0, 2001), "press: one request reads at most 2000 of coils, not 2001"),
        (lambda press: press.read_holding(0, 0), "press: 0 of holding: a request has one at least"),
        (lambda press: press.read_input(65530, 7), "press: 7 of input from 65530 on: addresses are 0 to 65535"),
        (lambda press: press.read_discrete(-1), "press: 1 of discrete from -1 on: addresses are 0 to 65535"),
        (lambda press: press.write_holding(0, []), "press: 0 of holding: a request has one at least"),
        (lambda press: press.write_holding(0, [0] * 124), "press: one request writes at most 123 of holding, not 124"),
        (lambda press: press.write_holding(0, [1, 65536]), "65536 does not fit into holding: whole numbers from 0 to"),
        (lambda press: press.write_holding(0, [-1]), "-1 does not fit into holding: whole numbers from 0 to 65535"),
        (lambda press: press.write_holding(0, [1.5]), "1.5 does not fit into holding: whole numbers from 0 to 65535"),
        (lambda press: press.write_coils(0, [0, 255]), "255 does not fit into coils: False or True"),
        (lambda press: press.request(b""), "a request PDU has 1 to 253 bytes, and not 0"),
        (lambda press: press.request(bytes(254)), "a request PDU has 1 to 253 bytes, and not 254"),
        (lambda press: press.read("start"), "press, start: it can be written, but not read"),
        (lambda press: press.write("count", 5), "press, count: count is read-only"),
        (lambda press: press.write("limit", 101), "press, limit: 101 is too high: limit must be 0 to 100 %"),
        (lambda press: press.write("mode", "fast"), 'press, mode: "fast" is not a number; it has the labels off, auto'),
        (lambda press: press.write("mode", None), "press, mode: expected a number, boolean or string, got null"),
    ],
)
async def test_what_does_not_fit_is_a_value_error_and_is_not_sent(bench, asked, says):
    with pytest.raises(ValueError, match=re.escape(says)):
        await asked(unit_of(bench, "press"))
    assert bench.device.heard == []


async def test_addresses_are_whole_numbers(bench):
    with pytest.raises(TypeError):
        await unit_of(bench, "press").read_holding("0")
    with pytest.raises(TypeError):
        await unit_of(bench, "press").read_holding(0, 1.5)


async def test_what_the_config_does_not_have_is_unknown(bench):
    with pytest.raises(NotConfigured, match='nothing has the name "pres"; did you mean "press"'):
        unit_of(bench, "pres")
    with pytest.raises(NotConfigured, match="there is no unit 47"):
        unit_of(bench, 47)
    with pytest.raises(NotConfigured, match='nothing has the name "46"; a number is written without quotes: 46'):
        unit_of(bench, "46")
    for point in unit_of(bench, "press").read("sped"), unit_of(bench, "press").write("sped", 1):
        with pytest.raises(NotConfigured, match='press has no point "sped"; did you mean "speed"'):
            await point
    with pytest.raises(NotConfigured, match="shift has no points to read"):
        await unit_of(bench, "shift").read_points()


@pytest.mark.parametrize(
    ("code", "kind"),
    [(1, Refused), (2, IllegalAddress), (4, DeviceFailure), (6, Busy), (8, Refused), (10, LineDown), (11, NoResponse)],
)
async def test_an_exception_of_a_device_is_the_error_of_its_code(bench, code, kind):
    bench.device.refuses = {3: code}
    press = unit_of(bench, "press")
    asked = {"holding 4-5": press.read_holding(4, 2), "speed": press.read("speed"), "function 3": press.request(READ)}
    for what, read in asked.items():
        with pytest.raises(kind, match=f"^press, {what}: exception {code:02X}, ") as wrong:
            await read
        assert wrong.value.code == code


READ = bytes.fromhex("03 0000 0001")


async def test_the_points_that_could_be_read_are_no_answer_without_the_others(bench):
    bench.device.refuses = {1: 4}
    with pytest.raises(DeviceFailure, match=r"^press, lamp: exception 04"):
        await unit_of(bench, "press").read_points("speed", "lamp")
    assert [*await unit_of(bench, "press").read_points("speed", "mode")] == ["speed", "mode"]


async def test_points_that_the_device_refuses_together_are_read_apart(bench):
    bench.device.script.append([(0.01, rtu.encode(6, b"\x83\x02"))])
    press = unit_of(bench, "press")
    assert [*await press.read_points("speed", "mode")] == ["speed", "mode"]
    assert [frame.pdu[0] for frame in bench.device.heard] == [3, 3, 3]


async def test_no_answer_is_told_with_its_reason(bench):
    bench.device.silent = True
    press = unit_of(bench, "press")
    with pytest.raises(ResponseTimeout, match=r"^press, holding 0-1: exception 0B, .*: no response came") as wrong:
        await press.read_holding(0, 2)
    assert (wrong.value.code, isinstance(wrong.value, NoResponse)) == (11, True)
    with pytest.raises(NoResponse, match=r"^press, speed: exception 0B"):
        await press.write("speed", 1)
    bench.lines["hall"].pull()
    with pytest.raises(LineDown, match=r"^press, holding 0: exception 0A"):
        await press.read_holding(0)


async def test_a_full_queue_and_a_long_wait_are_busy(bench):
    bench.device.delay = 0.15
    press = unit_of(bench, "press")
    reads = [press.read_holding(at) for at in range(8)]
    done = await asyncio.gather(*reads, return_exceptions=True)
    errors = [each for each in done if isinstance(each, Exception)]
    assert {*map(type, errors)} == {QueueFull, WaitedTooLong}
    assert all(each.code == 6 and str(each).startswith("press, holding ") for each in errors)
    assert [each for each in done if each not in errors] == [[0]] * (8 - len(errors))


async def test_nothing_is_asked_on_a_line_where_others_ask(bench):
    with pytest.raises(OnlyHeard, match=r"^boiler, holding 0: exception 0A.*only listens") as wrong:
        await unit_of(bench, "boiler").read_holding(0)
    assert isinstance(wrong.value, Refused)


async def test_a_request_pdu_is_sent_as_it_is(bench):
    press = unit_of(bench, "press")
    assert await press.request(bytes.fromhex("17 0000 0001 0000 0001 02 0005")) == bytes.fromhex("17 02 0005")
    assert await press.request(bytearray(READ)) == bytes.fromhex("03 02 0005")
    with pytest.raises(Refused, match=r"^press, function 3: exception 03"):
        await press.request(b"\x03\0")


async def test_a_write_is_audited_in_the_name_of_the_program(bench):
    await unit_of(bench, "press").write("mode", "auto")
    (audit,) = [event for event in bench.events if event.name == "write_audit"]
    assert (audit.client, audit.listener, audit.unit, audit.result) == ("embedded", "embedded", 46, "ok")


async def test_a_row_of_access_limits_what_the_program_may():
    row = '[[access]]\nlisten = ["embedded"]\nholding = "0-3"\nallow = ["read"]\n'
    async with gateway_bench(CONFIG + row) as bench:
        bench.attach("hall", SimulatedLine("rtu", SimulatedDevice(6)))
        press = unit_of(bench, "press")
        assert await press.read_holding(0, 4) == [0] * 4
        assert [*await press.read_points("speed", "mode")] == ["speed", "mode"]
        for asked in press.read_holding(0, 5), press.write("mode", 1), press.read_points("speed", "limit"):
            with pytest.raises(AccessDenied, match=r"^press, .*: exception 01, illegal function: "):
                await asked
        denied = [event for event in bench.events if event.name == "access_denied"]
        assert {(event.client, event.listener) for event in denied} == {("embedded", "embedded")}


@pytest.mark.parametrize(("priority", "turn"), [("normal", 7), ("high", 1)])
async def test_a_row_gives_priority_to_what_the_program_asks(priority, turn):
    rows = f'[[access]]\nlisten = ["embedded"]\nallow = ["read"]\npriority = "{priority}"\n'
    async with gateway_bench(
        f'{CONFIG}{rows}[[access]]\nallow = ["read"]\n'.replace("queue = 4", "queue = 9")
    ) as bench:
        device = SimulatedDevice(6)
        bench.attach("hall", SimulatedLine("rtu", device))
        for number in range(7):
            bench.client(f"10.0.0.{number}:1", host=f"10.0.0.{number}").ask(46, f"03 00{number:02X} 0001")
        await unit_of(bench, "press").read_holding(99)
        assert [frame.pdu[2] for frame in device.heard].index(99) == turn


async def test_others_get_their_turns_while_a_program_reads_what_the_gateway_itself_has(bench):
    shift, turns = unit_of(bench, "shift"), 0

    async def count_turns() -> None:
        nonlocal turns
        while True:
            turns += 1
            await asyncio.sleep(0)

    others = asyncio.create_task(count_turns())
    for _ in range(10):
        await shift.read_holding(0, 3)
    others.cancel()
    assert turns >= 10


@pytest.mark.parametrize(
    "asks",
    [
        lambda press: press.read("speed"),
        lambda press: press.read_points(),
        lambda press: press.read_holding(0),
        lambda press: press.read_input(0),
        lambda press: press.read_coils(0),
        lambda press: press.read_discrete(0),
        lambda press: press.write("mode", 1),
        lambda press: press.write_holding(0, [1]),
        lambda press: press.write_coils(0, [True]),
        lambda press: press.request(READ),
    ],
)
async def test_a_gateway_that_has_stopped_is_asked_nothing(bench, asks):
    operators = [Operator(bench.running, NO_FILE)]

    def operator() -> Operator:
        if not operators:
            raise RuntimeError("it has stopped")
        return operators[0]

    press = UnitClient(operator, "press")
    operators.clear()
    with pytest.raises(RuntimeError, match="it has stopped"):
        await asks(press)
    assert bench.device.heard == []


# --- cancelling ---


async def test_a_cancelled_request_that_waits_is_not_sent_and_frees_its_place(bench):
    press, sent = unit_of(bench, "press"), asyncio.create_task(unit_of(bench, "press").read_holding(0))
    await asyncio.sleep(0)
    waiting = [asyncio.create_task(press.write_holding(1, [each])) for each in range(4)]
    await asyncio.sleep(0)
    for each in waiting:
        each.cancel()
    await asyncio.wait(waiting)
    later = [asyncio.create_task(press.write_holding(2, [each])) for each in range(4)]  # the queue has room for 4
    assert await asyncio.gather(sent, *later) == [[0], *[None] * 4]
    assert bench.device.holding[1:3] == [0, 3]
    assert _audits(bench) == ["unwanted"] * 4 + ["ok"] * 4


async def test_a_cancelled_write_that_was_sent_stays_sent_and_is_audited(bench):
    writing = asyncio.create_task(unit_of(bench, "press").write("mode", "auto"))
    await asyncio.sleep(0.005)
    writing.cancel()
    with pytest.raises(asyncio.CancelledError):
        await writing
    await asyncio.sleep(1)
    assert bench.device.holding[2] == 1
    assert _audits(bench) == ["ok"]


async def test_a_time_limit_of_the_program_ends_its_wait_and_nothing_else(bench):
    bench.device.silent = True
    press = unit_of(bench, "press")
    with pytest.raises(TimeoutError):
        async with asyncio.timeout(0.1):
            await press.read_holding(0)
    with pytest.raises(AnswerOverdue):
        await press.read_holding(1)
    await asyncio.sleep(10)  # late answers are not awaited any more
    bench.device.silent = False
    async with asyncio.TaskGroup() as group:
        reads = [group.create_task(press.read_holding(at, 2)) for at in range(4)]
    assert [each.result() for each in reads] == [[0, 0]] * 4


def _audits(bench: GatewayBench) -> list[str]:
    return [event.result for event in bench.events if event.name == "write_audit"]


# --- reloads ---


async def test_a_unit_is_found_by_its_name_after_a_reload(bench):
    by_name, by_number = unit_of(bench, "press"), unit_of(bench, 46)
    await bench.reload(CONFIG.replace("as = 46", "as = 47"))
    assert await by_name.read_holding(0) == [0]
    with pytest.raises(NotConfigured, match="there is no unit 46"):
        await by_number.read_holding(0)
    await bench.reload(CONFIG.replace('"press"', '"stamp"'))
    with pytest.raises(NotConfigured, match='nothing has the name "press"'):
        await by_name.read("speed")
    assert await by_number.read_holding(0) == [0]
    assert by_number.name == "stamp"


async def test_devices_that_change_names_are_asked_by_those_in_force(bench):
    other = SimulatedDevice(7)
    bench.attach("hall", SimulatedLine("rtu", bench.device, other))
    bench.device.holding[0], other.holding[0] = 6, 7
    press, wired = unit_of(bench, "press"), unit_of(bench, "wired")
    assert [await press.read_holding(0), await wired.read_holding(0)] == [[6], [7]]
    swapped = CONFIG.replace("wired", "x").replace("press", "wired").replace('"x"', '"press"')
    await bench.reload(swapped)
    assert [await press.read_holding(0), await wired.read_holding(0)] == [[7], [6]]


async def test_between_two_requests_a_reload_that_changes_the_unit_is_told_and_nothing_more_is_sent(bench):
    bench.device.delay = 0.1
    reading = asyncio.create_task(unit_of(bench, "press").read_points())
    await asyncio.sleep(0.05)
    assert len(bench.device.heard) == 1
    await bench.reload(CONFIG.replace('"200 ms"', '"300 ms"'))
    with pytest.raises(Busy, match="unit 46 has changed by a reload"):
        await reading
    assert len(bench.device.heard) == 1


async def test_points_are_those_of_the_config_in_force(bench):
    press = unit_of(bench, "press")
    await press.read("mode")
    await bench.reload(CONFIG.replace('"mode"', '"state"'))
    assert (await press.read("state")).value == "off"
    with pytest.raises(NotConfigured, match='press has no point "mode"; known here: speed, state'):
        await press.read("mode")


async def test_a_read_of_points_ends_when_a_reload_gives_their_unit_another_device(bench):
    reading = asyncio.create_task(unit_of(bench, "press").read_points("speed", "count"))
    await asyncio.sleep(0.005)
    await bench.reload(CONFIG.replace("unit = 6, as", "unit = 8, as"))
    with pytest.raises((Busy, NoResponse), match=r"^press"):
        await reading


# --- ages ---

MIRRORED = """
[[image]]
unit = 100
name = "mirror"
of = "press"
read = [{ holding = "0-9", every = "1 s" }]
stale = "5 s"

[[image]]
unit = 101
name = "map"
map = [
  { at = 0, device = "press", holding = "0-1", every = "1 s" },
  { at = 10, device = "press", holding = "2", every = "4 s" },
]
stale = "20 s"
profile = "mapped"

[profile.mapped]
points = [{ name = "one", holding = 0 }, { name = "other", holding = 10 }]
"""


async def test_a_reading_is_as_old_as_the_poll_that_it_is_from():
    config = CONFIG.replace('name = "press",', 'name = "press", ') + MIRRORED
    async with gateway_bench(config) as bench:
        bench.device = SimulatedDevice(6)
        bench.attach("hall", SimulatedLine("rtu", bench.device))
        await asyncio.sleep(10)
        bench.device.silent = True
        await asyncio.sleep(3)
        assert 3.0 <= (await unit_of(bench, "mirror").read("speed")).age < 4.1
        ages = {name: each.age for name, each in (await unit_of(bench, "map").read_points()).items()}
        assert 3.0 <= ages["one"] < 4.1
        assert ages["one"] <= ages["other"] < 8.1
        await asyncio.sleep(4)
        with pytest.raises(StaleValue, match=r"^mirror, speed: exception 0B"):
            await unit_of(bench, "mirror").read("speed")


async def test_a_reading_of_a_device_is_as_old_as_its_answer(bench):
    reading = await unit_of(bench, "press").read("speed")
    assert reading.age < 1.0
