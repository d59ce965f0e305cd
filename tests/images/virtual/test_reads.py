"""Reads of a virtual unit: fresh values of its rows, its own registers, bits and ages."""

import pytest

from gateway.images.virtual.settings import FreshBits, SourceAge
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.profiles.point import Point
from gateway.profiles.profile import Profile
from tests.images.virtual.bench import Bench, Device, coils, holding, value

INT16 = Point("level", Area.HOLDING, 7, "int16", invalid=(-32768,))


@pytest.fixture
def bench():
    """Two meters side by side, and registers of its own behind them."""
    return Bench(holding(0, "a", 10, 2), holding(2, "b", 20), own={Area.HOLDING: ((3, 5),)})


def test_one_read_gets_the_values_of_all_devices(bench):
    assert bench["a"].has("03 04 00 01 00 02") == ["03 00 0A 00 02"]
    assert bench["b"].has("03 02 00 03") == ["03 00 14 00 01"]
    assert bench.client().ask("03 0000 0003") == ["03 06 00 01 00 02 00 03"]
    assert bench["a"].questions == bench["b"].questions == []


def test_a_read_waits_for_the_first_poll_of_each_row(bench):
    client = bench.client()
    assert client.ask("03 0000 0003") == []
    bench["a"].has("03 04 00 01 00 02")
    assert client.came() == []
    bench["b"].has("03 02 00 03")
    assert client.came() == ["03 06 00 01 00 02 00 03"]


def test_a_read_waits_for_the_rows_that_it_touches_only(bench):
    bench["b"].has("03 02 00 03")
    assert bench.client().ask("03 0002 0001") == ["03 02 00 03"]


def test_a_stale_value_is_never_sent(bench):
    bench["a"].has("03 04 00 01 00 02")
    bench["b"].has("03 02 00 03")
    client = bench.client()
    assert client.ask("03 0000 0003") == ["03 06 00 01 00 02 00 03"]
    bench.now = 1.0
    bench["b"].has("03 02 00 04")
    bench.now = 2.0
    assert client.ask("03 0000 0003") == ["03 06 00 01 00 02 00 04"]
    bench.now = 2.1
    assert client.ask("03 0000 0003") == ["83 0B"]
    assert client.why == "hall: a (holding 10-11) has not answered for too long"
    assert client.ask("03 0002 0001") == ["03 02 00 04"]
    assert bench.unit.answer_counts.exceptions == 1


def test_a_device_that_does_not_answer_ends_the_waiting(bench):
    client = bench.client()
    client.ask("03 0000 0001")
    bench["a"].has("83 0B")
    assert client.came() == ["83 0B"]
    assert client.why == "hall: a (holding 10-11) has not answered for too long"
    assert client.ask("03 0000 0001") == ["83 0B"]


def test_a_row_that_its_device_refuses(bench):
    client = bench.client()
    client.ask("03 0000 0001")
    bench["a"].has("83 02")
    assert client.came() == ["83 0B"]
    assert client.why == "hall: a (holding 10-11) is refused"
    bench["a"].rests = True
    bench.now = 1.0
    bench.poll(bench["a"])
    client.ask("03 0000 0001")
    assert client.why == "hall: a (holding 10-11) has not answered for too long"


@pytest.mark.parametrize(
    ("asked", "answer"),
    [
        ("03 0000 0007", "83 02"),
        ("03 0006 0001", "83 02"),
        ("04 0000 0001", "84 02"),
        ("01 0000 0001", "81 02"),
        ("03 0000 0000", "83 03"),
        ("17 0000 0001 0003 0001 02 0001", "97 01"),
        ("18 0000", "98 01"),
    ],
)
def test_what_is_neither_mapped_nor_its_own_does_not_exist(bench, asked, answer):
    assert bench.client().ask(asked) == [answer]


def test_the_profile_of_the_unit_holds():
    profile = Profile("narrow", functions=frozenset({3}), limits={3: 1}, areas={Area.HOLDING: ((0, 0),)})
    client = Bench(holding(0, "a", 10, 2), profile=profile).client()
    assert client.ask("04 0000 0001") == ["84 01"]
    assert client.ask("03 0000 0002") == ["83 03"]
    assert client.ask("03 0001 0001") == ["83 02"]
    assert client.ask("06 0000 0001") == ["86 01"]


def test_its_own_registers_are_those_of_an_image(bench):
    client = bench.client()
    assert client.ask("06 0004 1234") == ["06 00 04 12 34"]
    assert client.ask("03 0003 0003") == ["03 06 00 00 12 34 00 00"]
    assert client.ask("08 0000 1234") == ["08 00 00 12 34"]


def test_own_registers_that_persist_are_not_sent_before_they_are_loaded(bench):
    bench["a"].has("03 04 00 01 00 02")
    bench["b"].has("03 02 00 03")
    bench.own.has_started = False
    client = bench.client()
    assert client.ask("03 0000 0006") == ["83 04"]
    assert client.ask("03 0000 0003") == ["03 06 00 01 00 02 00 03"]
    bench.own.has_started = True
    assert client.ask("03 0000 0006") == ["03 0C 00 01 00 02 00 03 00 00 00 00 00 00"]


def test_a_read_of_rows_and_own_registers(bench):
    bench["b"].has("03 02 00 03")
    client = bench.client()
    client.ask("10 0003 0002 04 0004 0005")
    assert client.ask("03 0002 0003") == ["03 06 00 03 00 04 00 05"]
    client.ask("06 0003 0009")
    assert client.ask("03 0002 0003") == ["03 06 00 03 00 09 00 05"]


def test_coils_and_registers_of_several_devices():
    bench = Bench(coils(0, "a", 100, 3), coils(3, "b", 5), own={Area.COILS: ((4, 5),)})
    assert bench["a"].has("01 01 05") == ["01 00 64 00 03"]
    bench["b"].has("01 01 01")
    client = bench.client()
    client.ask("05 0005 FF00")
    assert client.ask("01 0000 0006") == ["01 01 2D"]
    assert client.ask("01 0002 0002") == ["01 01 03"]


# --- values that are not there -----------------------------------------------------------------------


def test_a_value_that_is_invalid_counts_as_stale():
    bench = Bench(value(0, "a", INT16))
    bench["a"].has("03 02 80 00")
    client = bench.client()
    assert client.ask("03 0000 0001") == ["83 0B"]
    assert client.why == "hall: a (holding 7) has no valid value"
    bench.now = 1.0
    bench["a"].has("03 02 00 05")
    assert client.ask("03 0000 0001") == ["03 02 00 05"]
    bench.now = 2.0
    bench["a"].has("03 02 80 00")
    assert client.ask("03 0000 0001") == ["83 0B"]


def test_a_value_that_does_not_fit_counts_as_stale():
    bench = Bench(value(0, "a", INT16, Point("", Area.HOLDING, 0, "uint16")))
    bench["a"].has("03 02 FF FF")
    client = bench.client()
    assert client.ask("03 0000 0001") == ["83 0B"]
    assert client.why == "hall: the value of a (holding 7) does not fit its row"


def test_a_row_may_hold_its_last_value():
    bench = Bench(holding(0, "a", 10, when_stale="hold"), holding(1, "b", 20))
    client = bench.client()
    client.ask("03 0000 0001")
    bench["a"].has("83 0B")
    assert client.came() == ["83 0B"]
    bench.now = 1.0
    bench["a"].has("03 02 00 05")
    bench["b"].has("03 02 00 06")
    bench.now = 2.5
    bench["a"].has("83 0B")
    bench["b"].has("03 02 00 07")
    bench.now = 3.5
    assert client.ask("03 0000 0002") == ["03 04 00 05 00 07"]


def test_a_row_with_a_value_that_is_not_valid_holds_the_one_before():
    bench = Bench(value(0, "a", INT16, when_stale="hold"))
    bench["a"].has("03 02 00 05")
    bench.now = 1.0
    bench["a"].has("03 02 80 00")
    assert bench.client().ask("03 0000 0001") == ["03 02 00 05"]


def test_a_number_stands_for_each_stale_register():
    bench = Bench(holding(0, "a", 10, 2, when_stale=0x7FC0), holding(2, "b", 20), coils(0, "a", 0, 2, when_stale=1))
    bench["b"].has("03 02 00 03")
    client = bench.client()
    assert client.ask("03 0000 0003") == []
    bench["a"].has("83 0B")
    assert client.came() == ["03 06 7F C0 7F C0 00 03"]
    assert client.ask("03 0001 0002") == ["03 04 7F C0 00 03"]
    assert client.ask("01 0001 0001") == ["01 01 01"]
    bench.now = 1.0
    bench["a"].has("03 04 00 01 00 02") if bench["a"].asked else None
    bench.now = 1.5
    for asked in bench.poll(bench["a"]):
        bench["a"].answers("03 04 00 01 00 02" if asked.startswith("03") else "01 01 00")
    assert client.ask("03 0000 0003") == ["03 06 00 01 00 02 00 03"]
    assert client.ask("01 0000 0002") == ["01 01 00"]


def test_a_coil_may_stand_for_a_stale_one():
    bench = Bench(coils(0, "a", 0, when_stale=0), coils(1, "a", 20, when_stale=1))
    bench["a"].has("81 0B")
    assert bench.client().ask("01 0000 0002") == ["01 01 02"]


# --- fresh and age -----------------------------------------------------------------------------------


def watched(**keys):
    return Bench(
        holding(0, "a", 10, when_stale="hold"),
        holding(1, "b", 20, when_stale="hold"),
        fresh=(
            FreshBits(Span(Area.HOLDING, 2, 1), ("a", "b")),
            FreshBits(Span(Area.COILS, 0, 2), ("a", "b")),
        ),
        ages=(SourceAge(Span(Area.HOLDING, 3, 1), "b"),),
        **keys,
    )


def test_bits_say_which_devices_are_fresh():
    bench, client = watched(), None
    client = bench.client()
    assert client.ask("03 0002 0002") == ["03 04 00 00 FF FF"]
    bench["b"].has("03 02 00 05")
    assert client.ask("03 0002 0002") == ["03 04 00 02 00 00"]
    assert client.ask("01 0000 0002") == ["01 01 02"]
    assert client.ask("01 0001 0001") == ["01 01 01"]
    bench.now = 1.9
    bench["a"].has("03 02 00 06")
    assert client.ask("03 0002 0002") == ["03 04 00 03 00 01"]
    bench.now = 3.0
    assert client.ask("03 0000 0004") == ["03 08 00 06 00 05 00 01 00 03"]
    bench.now = 80_000.0
    assert client.ask("03 0002 0002") == ["03 04 00 00 FF FE"]


def test_the_age_is_that_of_the_last_answer():
    bench = Bench(holding(0, "a", 10), coils(0, "a", 5), ages=(SourceAge(Span(Area.HOLDING, 3, 1), "a"),))
    bench.poll(bench["a"])
    bench["a"].answers("01 01 00")
    bench["a"].answers("03 02 00 05")
    bench.now = 5.0
    bench.poll(bench["a"])
    bench["a"].answers("01 01 00")
    bench.now = 7.0
    assert bench.client().ask("03 0003 0001") == ["03 02 00 02"]


def test_bits_of_more_than_sixteen_devices_fill_the_next_register():
    rows = [holding(at, f"m{at}", 0) for at in range(18)]
    bench = Bench(*rows, fresh=(FreshBits(Span(Area.HOLDING, 18, 2), tuple(f"m{at}" for at in range(18))),))
    for at in (0, 15, 16):
        bench[f"m{at}"].has("03 02 00 01")
    assert bench.client().ask("03 0012 0002") == ["03 04 80 01 00 01"]


# --- operators, reloads ------------------------------------------------------------------------------


def test_the_state_of_a_row():
    bench = Bench(value(0, "a", INT16))
    (row,) = bench.unit.block.rows
    assert (row.state(0.0, 2.0), row.age(0.0), row.items) == ("unknown", None, None)
    bench["a"].has("03 02 00 05")
    assert (row.state(1.5, 2.0), row.age(1.5), row.items) == ("fresh", 1.5, b"\0\5")
    assert row.state(2.5, 2.0) == "stale"
    bench.now = 1.0
    bench["a"].has("03 02 80 00")
    assert row.state(1.0, 2.0) == "invalid"


def test_what_lies_at_addresses():
    bench = watched(own={Area.HOLDING: ((4, 9),)})
    touched = bench.unit.block.touched(Span(Area.HOLDING, 1, 4))
    assert [row.mapped.device for row in touched.rows] == ["b"]
    assert [each.place.start for each in touched.others] == [2, 3, 4]
    assert bench.unit.block.touched(Span(Area.HOLDING, 10, 5)).others == ()


def test_a_reload_keeps_the_values_of_equal_rows():
    bench = Bench(holding(0, "a", 10), holding(1, "b", 20, when_stale="hold"))
    bench["a"].has("03 02 00 05")
    bench["b"].has("03 02 00 06")
    bench.now = 1.0
    bench.reload(bench.made(holding(3, "a", 11), holding(0, "a", 10), holding(1, "b", 20, when_stale="hold")))
    client = bench.client()
    assert client.ask("03 0000 0002") == ["03 04 00 05 00 06"]
    assert client.ask("03 0003 0001") == []
    bench.now = 2.5
    assert client.ask("03 0001 0001") == []  # behind the one that waits
    bench["a"].has("83 0B")
    assert client.came() == ["83 0B", "03 02 00 06"]


def test_a_reload_does_not_take_the_values_of_a_device_that_was_rebuilt():
    bench = Bench(holding(0, "a", 10))
    bench["a"].has("03 02 00 05")
    bench.devices["a"] = Device("a", bench)
    bench.reload(bench.made(holding(0, "a", 10)))
    assert bench.client().ask("03 0000 0001") == []


def test_a_reload_does_not_take_the_value_of_another_place():
    bench = Bench(holding(0, "a", 10))
    bench["a"].has("03 02 00 05")
    bench.reload(bench.made(holding(0, "a", 11)))
    assert bench.client().ask("03 0000 0001") == []


def test_reads_that_wait_fail_when_nobody_polls_any_more(bench):
    client = bench.client()
    client.ask("03 0000 0001")
    bench.unit.close(0.0)
    assert client.came() == ["83 0B"]
    assert client.why == "hall is no longer polled"


def test_a_unit_that_is_closed_answers_no_read_that_it_has_answered_before(bench):
    bench["b"].has("03 02 00 03")
    client = bench.client()
    assert client.ask("03 0002 0001") == client.ask("03 0002 0001") == ["03 02 00 03"]
    bench.unit.close(0.0)
    assert client.ask("03 0002 0001") == ["83 0B"]


def test_the_trace_has_what_is_answered_here(bench):
    bench["b"].has("03 02 00 03")
    client = bench.client()
    client.ask("03 0002 0001")
    client.ask("03 0002 0001")
    client.ask("03 0000 0001")
    bench["a"].has("83 0B")
    records = bench.ring.after(0)
    assert [(record.name, record.request.hex()) for record in records] == [
        ("hall", "0300020001"),
        ("hall", "0300020001"),
        ("hall", "0300000001"),
    ]
