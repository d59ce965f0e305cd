"""What a monitor line takes for transactions of others, and which of their values it believes."""

import random

import pytest

from gateway.trace.records import Heard, Sent
from kit.monitor_bench import ASCII, CLEAR, RTU, WINDOW, MonitorBench

READ, ANSWER = "03 00 10 00 02", "03 04 11 22 33 44"
OTHER_READ, OTHER_ANSWER = "03 00 20 00 02", "03 04 55 66 77 88"
#: A read of 24 coils from 0310 on, and a response with 24 coils.
BOTH_WAYS = "01 03 10 00 18"


@pytest.fixture(params=[RTU, ASCII], ids=["rtu", "ascii"])
def bench(request) -> MonitorBench:
    return MonitorBench(request.param)


def exchange(bench: MonitorBench, unit: int = 3, request: str = READ, response: str = ANSWER) -> None:
    """A request and its answer, in good time."""
    bench.hears(unit, request)
    bench.passes(0.02)
    bench.hears(unit, response)
    bench.passes(0.05)


def is_believed(bench: MonitorBench, unit: int = 3, request: str = READ, response: str = ANSWER) -> bool:
    """Whether the values of the next good transaction are taken."""
    bench.take()
    exchange(bench, unit, request, response)
    ((_, asked, answered, is_sure),) = bench.take()
    assert (asked, answered) == (request, response)
    return is_sure


def test_a_request_and_its_answer_are_a_transaction_whose_values_are_taken(bench: MonitorBench) -> None:
    at = bench.now
    exchange(bench)
    (heard,) = bench.heard
    assert (heard.asked_at, round(heard.answered_at - at, 3)) == (at, 0.02)
    assert bench.take() == [(3, READ, ANSWER, True)]


def test_both_in_one_piece_are_the_same(bench: MonitorBench) -> None:
    bench.receives(bench.frame(3, READ) + bench.frame(3, ANSWER) + bench.frame(4, READ) + bench.frame(4, OTHER_ANSWER))
    assert bench.take() == [(3, READ, ANSWER, True), (4, READ, OTHER_ANSWER, True)]


def test_the_pieces_in_which_bytes_come_make_no_difference(bench: MonitorBench) -> None:
    dice = random.Random(1)
    expected = []
    for at in range(40):
        value = f"03 02 {at:02X} {dice.randrange(256):02X}"
        data = bench.frame(3, f"03 00 {at:02X} 00 01") + bench.frame(3, value)
        expected.append((3, f"03 00 {at:02X} 00 01", value, True))
        while data:
            size = dice.randint(1, len(data))
            bench.receives(data[:size])
            data = data[size:]
            bench.passes(dice.uniform(0.0, 0.02))
    assert bench.take() == expected


def test_an_exception_is_an_answer(bench: MonitorBench) -> None:
    exchange(bench, response="83 02")
    assert bench.take() == [(3, READ, "83 02", True)]


def test_a_request_without_an_answer_is_told_when_its_window_has_ended(bench: MonitorBench) -> None:
    bench.hears(3, READ)
    bench.passes(WINDOW)
    assert bench.take() == []
    bench.passes(1.0)
    assert bench.take() == [(3, READ, None, False)]
    assert is_believed(bench)


def test_a_late_answer_is_not_taken_for_that_to_the_next_request(bench: MonitorBench) -> None:
    bench.hears(3, READ)
    bench.passes(1.0)
    bench.hears(3, OTHER_READ)
    bench.passes(0.02)
    bench.hears(3, ANSWER)  # the late one, right behind the second request
    bench.passes(0.02)
    bench.hears(3, OTHER_ANSWER)
    assert bench.take() == [(3, OTHER_READ, ANSWER, False)]
    assert bench.monitor.counts.strays == 1
    bench.passes(WINDOW)
    assert bench.take() == [(3, READ, None, False)]
    assert is_believed(bench)


def test_after_one_answer_to_two_requests_nothing_is_believed_until_the_window_of_the_second_has_ended(
    bench: MonitorBench,
) -> None:
    bench.hears(3, READ)
    bench.passes(1.0)
    bench.hears(3, OTHER_READ)
    bench.passes(0.02)
    bench.hears(3, ANSWER)
    bench.passes(WINDOW - 0.5)
    assert not is_believed(bench, request="03 00 30 00 02")
    bench.passes(1.5)
    assert is_believed(bench, request="03 00 30 00 02")


def test_a_unit_that_answers_one_request_behind_is_not_believed_however_long_that_goes_on(bench: MonitorBench) -> None:
    bench.hears(3, READ)
    bench.passes(1.0)
    for at in range(40):
        bench.hears(3, f"03 00 {at:02X} 00 02")
        bench.passes(0.02)
        bench.hears(3, f"03 04 {at - 1 & 255:02X} 00 00 00")
        bench.passes(0.5)
    assert not any(each.is_sure for each in bench.heard)
    bench.passes(CLEAR)
    assert is_believed(bench)


@pytest.mark.parametrize("late", [True, False])
def test_after_some_pauses_in_which_nothing_came_a_unit_owes_nothing_more(bench: MonitorBench, late: bool) -> None:
    lost_at = bench.now
    bench.hears(3, READ)
    bench.passes(0.5)
    for at in range(60):
        bench.hears(3, f"03 00 {at + 32:02X} 00 02")
        bench.passes(0.02)
        bench.hears(3, ANSWER[:-2] + f"{at:02X}")
        if late and at % 3 == 1:
            bench.passes(0.05)
            bench.hears(3, OTHER_ANSWER[:-2] + f"{at:02X}")  # what was owed
        bench.passes(0.9)
    sure = [each.asked_at - lost_at for each in bench.heard if each.is_sure]
    assert not sure if late else 0.0 < sure[0] - WINDOW < 1.2


def test_an_answer_that_comes_twice_is_not_the_one_that_is_still_owed(bench: MonitorBench) -> None:
    bench.windows[3] = 0.5
    bench.hears(3, READ)
    bench.passes(0.45)
    bench.hears(3, OTHER_READ)
    for _ in range(2):
        bench.passes(0.01)
        bench.hears(3, ANSWER)  # to the first
    bench.passes(0.25)  # now only the second is without an answer
    assert not is_believed(bench, 3, "03 00 30 00 02", OTHER_ANSWER)
    assert bench.monitor.counts.strays == 1


def test_an_answer_that_only_the_last_request_can_have_got_shows_that_nothing_is_owed_any_more(
    bench: MonitorBench,
) -> None:
    bench.hears(3, READ)
    bench.passes(WINDOW - 0.5)
    assert not is_believed(bench, request=OTHER_READ)
    bench.passes(1.0)
    assert not is_believed(bench, request=READ)  # the answer may have been that to the one before
    assert is_believed(bench, 3, "04 00 10 00 01", "04 02 11 22")
    assert is_believed(bench, request=OTHER_READ)


def test_other_functions_and_units_are_believed_meanwhile(bench: MonitorBench) -> None:
    bench.hears(3, READ)
    bench.passes(1.0)
    assert is_believed(bench, 3, "04 00 10 00 02", "04 04 11 22 33 44")
    assert is_believed(bench, 4)
    assert not is_believed(bench, 3, OTHER_READ)


def test_each_unit_has_a_window_of_its_own(bench: MonitorBench) -> None:
    bench.windows[3] = 0.4
    bench.hears(3, READ)
    bench.passes(2.0)
    assert is_believed(bench, 3, OTHER_READ)


def test_an_answer_to_a_repeated_request_is_believed_as_of_the_first(bench: MonitorBench) -> None:
    first = bench.now
    bench.hears(3, READ)
    bench.passes(1.0)
    exchange(bench)
    assert [each.asked_at for each in bench.heard] == [first]
    assert bench.take() == [(3, READ, ANSWER, True)]
    assert not is_believed(bench, request=OTHER_READ)  # the other one may still be answered


def test_a_late_answer_of_another_unit_between_is_in_the_way(bench: MonitorBench) -> None:
    bench.hears(4, READ)
    bench.passes(1.0)
    bench.hears(3, READ)
    bench.passes(0.01)
    bench.hears(4, OTHER_ANSWER)
    bench.passes(0.01)
    bench.hears(3, ANSWER)
    assert bench.take() == [(4, READ, OTHER_ANSWER, False), (3, READ, ANSWER, False)]


def test_a_response_of_another_size_or_function_is_none(bench: MonitorBench) -> None:
    for response in ("03 02 11 22", "04 04 11 22 33 44", "84 02"):
        bench.hears(3, READ)
        bench.passes(0.01)
        bench.hears(3, response)
        bench.passes(CLEAR)
        assert bench.take() == [(3, READ, None, False)]
    assert bench.monitor.counts.strays == 3


def test_after_opening_nothing_is_believed_that_may_answer_an_earlier_request() -> None:
    bench = MonitorBench(is_clear=False)
    assert not is_believed(bench)
    bench.passes(CLEAR)
    assert is_believed(bench)


def test_after_the_port_was_lost_the_same_holds_and_open_requests_are_told(bench: MonitorBench) -> None:
    bench.hears(3, READ)
    bench.monitor.port_down(bench.now)
    assert bench.take() == [(3, READ, None, False)]
    assert bench.monitor.deadline() is None
    bench.passes(1.0)
    bench.monitor.port_up(bench.now)
    assert not is_believed(bench)
    bench.passes(CLEAR)
    assert is_believed(bench)


def test_after_a_broken_frame_that_may_have_been_a_request_nothing_is_believed(bench: MonitorBench) -> None:
    broken = bytearray(bench.frame(3, OTHER_READ))
    broken[6] ^= 1
    bench.receives(bytes(broken))
    bench.passes(0.5)
    assert not is_believed(bench)
    assert not is_believed(bench, 4)
    bench.passes(CLEAR)
    assert is_believed(bench)


def test_a_broken_request_with_its_answer_behind_it_is_over(bench: MonitorBench) -> None:
    broken = bytearray(bench.frame(3, OTHER_READ))
    broken[-4] ^= 1
    bench.receives(bytes(broken))
    bench.passes(0.02)
    bench.hears(3, OTHER_ANSWER)
    bench.passes(0.02)
    assert bench.take() == []
    assert is_believed(bench)


def test_a_broken_answer_leaves_only_its_request_without_one(bench: MonitorBench) -> None:
    bench.hears(3, READ)
    bench.passes(0.02)
    broken = bytearray(bench.frame(3, ANSWER))
    broken[-4] ^= 1
    bench.receives(bytes(broken))
    bench.passes(0.5)
    assert is_believed(bench, 4)
    assert not is_believed(bench, 3, OTHER_READ)


def test_a_cut_answer_may_hide_anything(bench: MonitorBench) -> None:
    bench.hears(3, READ)
    bench.passes(0.02)
    bench.receives(bench.frame(3, ANSWER)[:6])
    bench.passes(0.5)
    exchange(bench, 4)
    assert bench.take() == [(4, READ, ANSWER, False)]


def test_damaged_bytes_put_everything_in_doubt(bench: MonitorBench) -> None:
    bench.receives(bench.frame(4, OTHER_READ), damaged=True)
    bench.passes(0.5)
    assert not is_believed(bench)
    bench.passes(CLEAR)
    assert is_believed(bench)
    bench.receives(bench.frame(4, READ), damaged=True)
    bench.receives(b"\x01")
    bench.passes(CLEAR)
    assert bench.take() == []


def test_bytes_between_request_and_answer_make_it_unsure(bench: MonitorBench) -> None:
    bench.hears(3, READ)
    bench.receives(b"\0")
    bench.passes(0.02)
    bench.hears(3, ANSWER)
    bench.passes(0.1)
    assert bench.take() == [(3, READ, ANSWER, False)]


def test_what_switching_a_driver_leaves_before_a_request_is_no_request(bench: MonitorBench) -> None:
    for glitch in (b"\0", b"\xff", b"\xfe\0\xf0"):
        bench.receives(glitch)
        assert is_believed(bench)
    bench.receives(b"\x03\x03")  # the beginning of a request
    bench.passes(0.01)
    assert not is_believed(bench)


def test_a_frame_that_can_be_read_both_ways_is_no_value_but_is_recorded(bench: MonitorBench) -> None:
    exchange(bench, 3, "01 00 00 00 18", BOTH_WAYS)
    assert bench.take() == [(3, "01 00 00 00 18", BOTH_WAYS, False)]
    assert not is_believed(bench, 3, "01 00 00 00 08", "01 01 55")  # it may have been a request
    assert is_believed(bench)
    exchange(bench, 4, BOTH_WAYS, "01 03 FF FF FF")
    assert bench.take() == [(4, BOTH_WAYS, "01 03 FF FF FF", False)]


def test_a_request_that_ends_with_nul_is_no_response_without_it() -> None:
    bench = MonitorBench()
    frames = (bench.frame(unit, f"03 02 {at:02X} 00 03") for unit in range(4, 40) for at in range(256))
    request = next(each for each in frames if each[-1] == 0)
    unit = request[0]
    for delay in (0.0, 0.01):
        bench.hears(unit, "03 00 10 00 01")
        bench.passes(1.0)
        bench.receives(request[:7])
        bench.passes(delay)
        bench.receives(request[7:])
        bench.passes(0.01)
        bench.hears(unit, "03 02 AB CD")
        assert not any(each.is_sure for each in bench.heard)
        bench.passes(CLEAR)
    bench.take()
    bench.receives(request)
    bench.hears(unit, "03 06 11 22 33 44 55 66")
    assert [(answer, is_sure) for _, _, answer, is_sure in bench.take()] == [("03 06 11 22 33 44 55 66", True)]


def test_nul_behind_a_response_does_not_make_it_a_request() -> None:
    bench = MonitorBench()
    bench.receives(bench.frame(3, "03 00 10 00 01") + bench.frame(3, "03 02 AB CD") + bench.frame(0, "06 00 10 12 34"))
    assert bench.take() == [(3, "03 00 10 00 01", "03 02 AB CD", True), (0, "06 00 10 12 34", None, False)]


def test_a_frame_inside_the_data_of_another_is_none() -> None:
    bench = MonitorBench()
    inner = bench.frame(4, READ) + bench.frame(4, ANSWER) + b"\0"
    exchange(bench, 3, f"03 00 00 00 {len(inner) // 2:02X}", f"03 {len(inner):02X} {inner.hex(' ').upper()}")
    assert [(unit, is_sure) for unit, _, _, is_sure in bench.take()] == [(3, True)]


def test_a_broadcast_is_told_at_once(bench: MonitorBench) -> None:
    bench.hears(0, "06 00 10 12 34")
    assert bench.take() == [(0, "06 00 10 12 34", None, False)]
    bench.passes(0.02)
    assert is_believed(bench)


def test_who_asks_at_address_0_may_be_answered_from_any(bench: MonitorBench) -> None:
    bench.hears(0, READ)
    assert bench.take() == [(0, READ, None, False)]
    bench.passes(0.5)
    assert not is_believed(bench)


def test_a_write_and_its_response_are_a_transaction(bench: MonitorBench) -> None:
    for request, response in (
        ("06 00 10 12 34", "06 00 10 12 34"),
        ("05 00 10 FF 00", "05 00 10 FF 00"),
        ("10 00 10 00 01 02 12 34", "10 00 10 00 01"),
        ("0F 00 10 00 08 01 55", "0F 00 10 00 08"),
        ("16 00 10 00 F2 00 25", "16 00 10 00 F2 00 25"),
        ("17 00 10 00 01 00 20 00 01 02 12 34", "17 02 AA BB"),
    ):
        exchange(bench, 3, request, response)
        (heard,) = bench.take()
        assert heard[:3] == (3, request, response)
        assert is_believed(bench)


def test_a_write_without_an_answer_is_told(bench: MonitorBench) -> None:
    bench.hears(3, "10 00 10 00 01 02 12 34")
    bench.passes(CLEAR)
    assert bench.take() == [(3, "10 00 10 00 01 02 12 34", None, False)]


def test_a_request_that_violates_the_specification_is_one_all_the_same(bench: MonitorBench) -> None:
    bench.hears(3, "03 00 10 00 00")
    bench.passes(0.5)
    assert not is_believed(bench)
    assert is_believed(bench, 4)
    bench.passes(CLEAR)
    assert is_believed(bench)


def test_who_answers_what_was_not_heard_may_have_been_asked_more(bench: MonitorBench) -> None:
    bench.hears(3, "03 02 00 01")  # or a request for 01 00 to 00 02 in ASCII, of which one byte of 00 was lost
    bench.passes(0.5)
    assert not is_believed(bench)
    assert is_believed(bench, 4)
    bench.passes(CLEAR)
    exchange(bench)
    bench.hears(3, ANSWER)  # the same once more
    bench.passes(0.5)
    bench.take()
    assert is_believed(bench, request=OTHER_READ)


def test_silence_ends_frames_of_functions_that_nobody_knows() -> None:
    bench = MonitorBench()
    exchange(bench, 3, "41 01 02 03 04 05 06 07", "41 09 08")
    assert bench.take() == [(3, "41 01 02 03 04 05 06 07", "41 09 08", True)]
    exchange(bench, 3, "08 00 00 12 34", "08 00 00 12 34")
    assert bench.take() == [(3, "08 00 00 12 34", "08 00 00 12 34", False)]
    assert is_believed(bench)


def test_a_window_that_ended_while_the_gateway_stood_still_counts_as_open(bench: MonitorBench) -> None:
    bench.hears(3, READ)
    bench.passes(1.0)
    bench.stands_still = True
    bench.passes(20.0)
    bench.receives(bench.frame(3, OTHER_READ) + bench.frame(3, ANSWER))
    assert bench.take() == [(3, OTHER_READ, ANSWER, False)]


def test_what_was_read_late_is_as_old_as_it_may_be(bench: MonitorBench) -> None:
    bench.passes(3.0)
    before = bench.now
    bench.stands_still = True
    bench.passes(20.0)
    bench.receives(bench.frame(3, READ) + bench.frame(3, ANSWER))
    (heard,) = bench.heard
    assert before - 1.1 < heard.asked_at <= before


def test_a_quiet_bus_makes_nothing_old(bench: MonitorBench) -> None:
    bench.passes(600.0)
    at = bench.now
    exchange(bench)
    (heard,) = bench.heard
    assert heard.asked_at == at


def test_what_was_heard_is_in_the_trace(bench: MonitorBench) -> None:
    exchange(bench)
    exchange(bench, 4)
    bench.hears(7, ANSWER)
    bench.receives(b"\x12\x34\x56\x78\x9a")
    bench.passes(CLEAR)
    first, second, stray, noise = bench.ring.after(0)
    assert isinstance(first, Sent)
    assert (first.unit, first.address, first.name, first.result) == (63, 3, "boiler", "ok")
    assert (first.at - first.ends_at, first.ends_at - first.sent_at) == (
        pytest.approx(0.02),
        pytest.approx(bench.timing.frame(5)),
    )
    assert isinstance(second, Sent)
    assert (second.unit, second.name) == (4, "")
    assert isinstance(stray, Heard)
    assert (stray.kind, stray.frame.hex()) == ("nobody", "07" + ANSWER.replace(" ", ""))
    assert isinstance(noise, Heard)
    assert (noise.kind, noise.count) == ("noise", 5)


def test_memory_is_bounded_whatever_comes(bench: MonitorBench) -> None:
    dice = random.Random(2)
    for _ in range(2000):
        bench.receives(bench.frame(dice.randint(1, 247), f"03 {dice.randrange(65536):04X} 00 01"))
        bench.passes(0.001)
    counts = bench.monitor.counts
    assert counts.requests - counts.unanswered - counts.answers <= 256
    bench.receives(dice.randbytes(200_000))
    bench.passes(CLEAR)
    bench.passes(CLEAR)
    assert is_believed(bench)


def test_the_share_of_time_is_that_of_requests_until_their_answers(bench: MonitorBench) -> None:
    exchange(bench)
    assert bench.monitor.busy == pytest.approx(bench.timing.frame(5) + 0.02)
    ((who, use),) = bench.monitor.usage.take().items()
    assert (who, use.transactions) == (("another client", 3, 3), 1)
