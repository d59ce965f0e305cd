"""Writes to a virtual unit: each reaches one device, or the unit's own registers, or nothing."""

import pytest

from gateway.errors import ResponseTimeout
from gateway.images.virtual.settings import FreshBits
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.profiles.point import Point
from gateway.profiles.profile import Profile
from tests.images.virtual.bench import Bench, coils, holding, value

#: A temperature in tenths, and the same as a float with its words swapped.
TENTHS = Point("temperature", Area.HOLDING, 30, "int16", scale=0.1, write="yes")
FLOAT = Point("", Area.HOLDING, 0, "float32", "words", count=2)


@pytest.fixture
def bench():
    return Bench(
        holding(0, "a", 10, 4, write=True),
        holding(4, "b", 20),
        value(5, "b", TENTHS, FLOAT, write=True),
        coils(0, "a", 100, 8, write=True),
        coils(8, "b", 7),
        own={Area.HOLDING: ((7, 8),), Area.COILS: ((9, 12),)},
        fresh=(FreshBits(Span(Area.HOLDING, 9, 1), ("a",)),),
    )


@pytest.mark.parametrize(
    ("asked", "sent", "reply"),
    [
        ("06 0003 1234", "06 00 0D 12 34", "06 00 0D 12 34"),
        ("10 0001 0002 04 0001 0002", "10 00 0B 00 02 04 00 01 00 02", "10 00 0B 00 02"),
        ("16 0000 FFF0 0001", "16 00 0A FF F0 00 01", "16 00 0A FF F0 00 01"),
        ("05 0007 FF00", "05 00 6B FF 00", "05 00 6B FF 00"),
        ("0F 0001 0003 01 05", "0F 00 65 00 03 01 05", "0F 00 65 00 03"),
    ],
)
def test_registers_as_they_are_are_written_with_their_address_moved(bench, asked, sent, reply):
    client = bench.client()
    assert client.ask(asked) == []
    assert bench["a"].questions == [sent]
    assert bench["b"].questions == []
    bench["a"].answers(reply)
    echo = asked if asked[:2] in ("05", "06", "16") else asked[: len("10 0001 0002")]
    assert [each.replace(" ", "") for each in client.came()] == [echo.replace(" ", "")]
    assert [(write.span, write.client) for write in bench.unit.last_writes] == [
        (
            Span(Area.COILS if asked[:2] in ("05", "0F") else Area.HOLDING, int(asked[3:7], 16), _count(asked)),
            client.caller.client,
        )
    ]


def _count(asked):
    return int(asked[8:12], 16) if asked[:2] in ("0F", "10") else 1


@pytest.mark.parametrize(
    ("asked", "answer"),
    [
        ("06 0004 0001", "86 02"),  # a row without `write`
        ("05 0008 FF00", "85 02"),
        ("10 0003 0002 04 0001 0002", "90 02"),  # two rows
        ("0F 0007 0002 01 03", "8F 02"),
        ("10 0004 0003 06 0001 0002 0003", "90 02"),
        ("10 0006 0002 04 0001 0002", "90 02"),  # a row and own registers
        ("0F 0008 0002 01 03", "8F 02"),
        ("10 0008 0002 04 0001 0002", "90 02"),  # own registers and computed ones
        ("06 0009 0001", "86 02"),
        ("06 000A 0001", "86 02"),  # nothing
        ("10 0008 0003 06 0001 0002 0003", "90 02"),
        ("06 0005 0001", "86 03"),  # half a value
        ("10 0006 0001 02 0001", "90 03"),
        ("16 0005 0000 0001", "96 03"),
        ("10 0005 0002 04 0000 7FC0", "90 03"),  # no number
        ("10 0005 0002 04 0000 7F80", "90 03"),
        ("10 0005 0002 04 0000 4974", "90 03"),  # a million tenths do not fit
        ("17 0000 0001 0000 0001 02 0001", "97 01"),
        ("05 0000 1234", "85 03"),
        ("10 0000 0001 02 00", "90 03"),
    ],
)
def test_what_cannot_be_written_reaches_nobody(bench, asked, answer):
    client = bench.client()
    assert client.ask(asked) == [answer]
    assert bench["a"].questions == bench["b"].questions == []
    assert bench.own.tables[Area.HOLDING].values(7, 2) == (0, 0)
    assert bench.own.tables[Area.COILS].values(9, 4) == (0, 0, 0, 0)
    assert client.requests[0].device == ""


@pytest.mark.parametrize(
    ("asked", "sent"),
    [
        ("10 0005 0002 04 0000 4248", "06 00 1E 01 F4"),  # 50
        ("10 0005 0002 04 0000 424A", "06 00 1E 01 F9"),  # 50.5
        ("10 0005 0002 04 0000 C120", "06 00 1E FF 9C"),  # -10
        ("10 0005 0002 04 CCCD 3D4C", "06 00 1E 00 01"),  # 0.05
        ("10 0005 0002 04 D70A 3D23", "06 00 1E 00 00"),  # 0.04
    ],
)
def test_a_value_is_converted_and_written_by_the_function_of_its_point(bench, asked, sent):
    client = bench.client()
    assert client.ask(asked) == []
    assert bench["b"].questions == [sent]
    bench["b"].answers(sent)
    assert client.came() == ["10 00 05 00 02"]
    assert client.requests[0].device == "b"


@pytest.mark.parametrize(
    ("reply", "came"),
    [("86 02", "90 02"), ("86 04", "90 04"), ("86 06", "90 06"), ("86 0B", "90 0B"), ("86 0A", "90 0A")],
)
def test_an_exception_has_the_code_of_the_device_and_the_function_of_the_client(bench, reply, came):
    client = bench.client()
    client.ask("10 0005 0002 04 0000 4248")
    bench["b"].answers(reply)
    assert client.came() == [came]


def test_a_write_without_an_answer_tells_why(bench):
    client = bench.client()
    client.ask("10 0005 0002 04 0000 4248")
    bench["b"].asked.pop().fail(ResponseTimeout("nothing came"))
    assert client.came() == ["90 0B"]
    assert isinstance(client.requests[0].error, ResponseTimeout)
    assert list(bench.unit.last_writes) == []


# --- how a point is written --------------------------------------------------------------------------


def sent_for(point, asked, target=None, profile=None):
    bench = Bench(value(0, "a", point, target, write=True), profiles={"a": profile} if profile else {})
    client = bench.client()
    came = client.ask(asked)
    assert came == [] or bench["a"].asked == []
    return [(request.pdu.hex(" ").upper(), request.in_one_turn) for request in bench["a"].asked] or came


def test_a_point_as_the_device_has_it_is_checked_too():
    number = Point("n", Area.HOLDING, 5, "uint32", "words", count=2, write="yes", invalid=(7,))
    assert sent_for(number, "10 0000 0002 04 0009 0000") == [("10 00 05 00 02 04 00 09 00 00", 0)]
    assert sent_for(number, "10 0000 0002 04 0007 0000") == ["90 03"]


def test_bits_are_written_without_the_others():
    bits = Point("mode", Area.HOLDING, 5, bits=(4, 6), write="yes")
    target = Point("", Area.HOLDING, 0)
    assert sent_for(bits, "06 0000 0003", target) == [("16 00 05 FF 8F 00 30", 6)]
    assert sent_for(bits, "06 0000 0008", target) == ["86 03"]
    assert sent_for(bits, "06 0000 FFFF") == [("16 00 05 FF 8F 00 70", 6)]
    only_16 = Profile("only 16", functions=frozenset({3, 16}))
    assert sent_for(bits, "06 0000 0003", target, only_16) == [("16 00 05 FF 8F 00 30", 16)]
    knows_22 = Profile("knows 22", functions=frozenset({3, 6, 22}))
    assert sent_for(bits, "06 0000 0003", target, knows_22) == [("16 00 05 FF 8F 00 30", 0)]


def test_a_bit_of_a_register_as_a_coil():
    bit = Point("run", Area.HOLDING, 5, bits=(3, 3), write="yes")
    target = Point("", Area.COILS, 0, "bit")
    assert sent_for(bit, "05 0000 FF00", target) == [("16 00 05 FF F7 00 08", 6)]
    assert sent_for(bit, "0F 0000 0001 01 00", target) == [("16 00 05 FF F7 00 00", 6)]


def test_a_coil_as_a_register():
    coil = Point("run", Area.COILS, 5, "bit", write="yes")
    target = Point("", Area.HOLDING, 0)
    assert sent_for(coil, "06 0000 0001", target) == [("05 00 05 FF 00", 0)]
    assert sent_for(coil, "06 0000 0002", target) == ["86 03"]


def test_the_place_and_the_function_of_its_point():
    point = Point("n", Area.INPUT, 5, write="yes", write_at=90, write_function="multiple")
    assert sent_for(point, "06 0000 0003") == [("10 00 5A 00 01 02 00 03", 0)]
    assert sent_for(Point("n", Area.HOLDING, 5, write="yes"), "10 0000 0001 02 0003") == [("06 00 05 00 03", 0)]


def test_bits_of_a_value_are_not_written():
    assert sent_for(Point("n", Area.HOLDING, 5, write="yes"), "16 0000 FFF0 0001") == ["96 03"]


def test_a_coil_is_on_or_off():
    profile = Profile("relays", any_coil=True)
    assert Bench(coils(0, "a", 5, write=True), profile=profile).client().ask("05 0000 1234") == ["85 03"]


def test_too_many_registers_for_the_device():
    number = Point("n", Area.HOLDING, 5, "uint64", count=4, write="yes")
    assert sent_for(number, "10 0000 0004 08 0000000000000001", profile=Profile("few", limits={16: 2})) == ["90 03"]


def test_a_value_with_a_scale_register_needs_it():
    point = Point("power", Area.HOLDING, 5, "int16", write="yes", scale_at=6)
    bench = Bench(value(0, "a", point, Point("", Area.HOLDING, 0, "int32", count=2), write=True))
    client = bench.client()
    assert client.ask("10 0000 0002 04 0000 0064") == ["90 0B"]
    bench["a"].has("03 04 00 05 00 01")
    assert client.ask("03 0000 0002") == ["03 04 00 00 00 32"]
    client.ask("10 0000 0002 04 0000 0064")
    assert bench["a"].questions == ["06 00 05 00 0A"]
    bench["a"].answers("86 06")
    bench.now = 2.5
    client.came()
    assert client.ask("10 0000 0002 04 0000 0064") == ["90 0B"]
    before = Point("power", Area.HOLDING, 5, "int16", write="yes", scale_at=4)
    bench = Bench(value(0, "a", before, write=True))
    bench["a"].has("03 04 00 01 00 05")
    bench.client().ask("06 0000 0007")
    assert bench["a"].questions == ["06 00 05 00 07"]


@pytest.mark.parametrize(("scale_at", "read"), [(6, "03 04 00 64 FF FF"), (4, "03 04 FF FF 00 64")])
def test_a_value_as_it_is_beside_its_scale_register(scale_at, read):
    point = Point("power", Area.HOLDING, 5, "int16", write="yes", scale_at=scale_at)
    bench = Bench(value(0, "a", point, write=True))
    bench["a"].has(read)
    client = bench.client()
    assert client.ask("06 0000 01F4") == []
    assert bench["a"].questions == ["06 00 05 01 F4"]


# --- in one turn -------------------------------------------------------------------------------------


def test_bits_of_a_register_as_it_is_are_passed_on_in_one_turn(bench):
    client = bench.client()
    assert client.ask("16 0000 FFFE 0001", in_one_turn=6) == []
    assert [(each.pdu.hex(), each.in_one_turn) for each in bench["a"].asked] == [("16000afffe0001", 6)]
    bench["a"].answers("16 000A FFFE 0001")
    assert client.came() == ["16 00 00 FF FE 00 01"]


@pytest.mark.parametrize(("functions", "sent_with"), [((3, 16), 16), ((3, 6), 6), ((3, 6, 16), 6)])
def test_bits_are_written_with_a_function_that_the_device_has(functions, sent_with):
    bench = Bench(holding(0, "a", 10, write=True), profiles=[("a", Profile("p", functions=frozenset(functions)))])
    bench.client().ask("16 0000 FFFE 0001", in_one_turn=6)
    assert [each.in_one_turn for each in bench["a"].asked] == [sent_with]


def test_bits_of_own_registers_and_of_values(bench):
    client = bench.client()
    assert client.ask("16 0007 FFFE 0001", in_one_turn=6) == ["16 00 07 FF FE 00 01"]
    assert bench.own.tables[Area.HOLDING].values(7, 1) == (1,)
    assert client.ask("16 0005 FFFE 0001", in_one_turn=6) == ["96 03"]
    profile = Profile("no 22", functions=frozenset({3, 6}))
    client = Bench(holding(0, "a", 10), own={Area.HOLDING: ((7, 8),)}, profile=profile).client()
    assert client.ask("16 0007 FFFE 0001", in_one_turn=6) == ["16 00 07 FF FE 00 01"]
    assert client.ask("16 0007 FFFE 0001") == ["96 01"]


# --- order -------------------------------------------------------------------------------------------


def test_a_read_waits_for_a_poll_after_the_write():
    bench = Bench(value(5, "b", TENTHS, FLOAT, write=True))
    client, other = bench.client(), bench.client("10.0.0.7:1")
    bench["b"].has("03 02 00 63")
    bench.now = 0.5
    client.ask("10 0005 0002 04 0000 4248")
    assert client.ask("03 0005 0002") == []
    bench["b"].answers("06 00 1E 01 F4")
    assert client.came() == ["10 00 05 00 02"]
    assert other.ask("03 0005 0002") == []
    assert bench.poll(bench["b"]) == ["03 00 1E 00 01"]
    bench["b"].answers("03 02 01 F4")
    assert client.came() == other.came() == ["03 04 00 00 42 48"]


@pytest.mark.parametrize(("clients", "writes"), [(300, 1), (1, 300)])
def test_any_number_of_requests_behind_reads_is_carried_out_when_the_poll_is_answered(clients, writes):
    bench = Bench(holding(0, "a", 10), own={Area.HOLDING: ((5, 5),)})
    bench.poll(bench["a"])
    clients = [bench.client(f"10.0.0.9:{port}") for port in range(clients)]
    for client in clients:
        assert client.ask("03 0000 0001") == []
        for _ in range(writes):
            assert client.ask("06 0005 0001") == []
    bench["a"].answers("03 02 0007")
    for client in clients:
        assert client.came() == ["03 02 00 07", *["06 00 05 00 01"] * writes]


def test_the_bit_of_a_device_stays_when_it_is_written_to():
    bench = Bench(holding(0, "a", 10, write=True), fresh=(FreshBits(Span(Area.HOLDING, 9, 1), ("a",)),))
    bench["a"].has("03 02 0001")
    client = bench.client()
    assert client.ask("03 0009 0001") == ["03 02 00 01"]
    client.ask("06 0000 0007")
    bench["a"].answers("06 000A 0007")
    assert client.came() == ["06 00 00 00 07"]
    assert client.ask("03 0009 0001") == ["03 02 00 01"]
    bench["a"].has("83 0B")
    assert client.ask("03 0009 0001") == ["03 02 00 00"]


def test_requests_of_a_client_are_carried_out_one_after_another(bench):
    client, other = bench.client(), bench.client("10.0.0.7:1")
    client.ask("06 0000 0001")
    client.ask("10 0005 0002 04 0000 4248")
    client.ask("06 0007 0005")
    assert (bench["a"].questions, bench["b"].questions) == (["06 00 0A 00 01"], [])
    assert other.ask("06 0008 0006") == ["06 00 08 00 06"]
    bench["a"].answers("06 00 0A 00 01")
    assert bench["b"].questions == ["06 00 1E 01 F4"]
    bench["b"].answers("06 00 1E 01 F4")
    assert client.came() == ["06 00 00 00 01", "10 00 05 00 02", "06 00 07 00 05"]


def test_a_read_of_another_device_waits_for_the_write_before_it():
    bench = Bench(holding(0, "a", 10, write=True), holding(1, "b", 20))
    bench["b"].has("03 02 00 05")
    client = bench.client()
    assert client.ask("03 0001 0001") == ["03 02 00 05"]
    client.ask("06 0000 0001")
    assert client.ask("03 0001 0001") == []
    bench["a"].answers("06 00 0A 00 01", which=-1)
    assert client.came() == ["06 00 00 00 01", "03 02 00 05"]


def test_a_value_that_is_written_elsewhere_is_unknown_after_the_write():
    point = Point("n", Area.HOLDING, 5, write="yes", write_at=90)
    bench = Bench(value(0, "a", point, write=True))
    bench["a"].has("03 02 00 01")
    client = bench.client()
    assert client.ask("03 0000 0001") == ["03 02 00 01"]
    client.ask("06 0000 0002")
    bench["a"].answers("06 00 5A 00 02")
    assert client.came() == ["06 00 00 00 02"]
    assert client.ask("03 0000 0001") == []
    bench["a"].has("03 02 00 02")
    assert client.came() == ["03 02 00 02"]
