"""What other clients have asked is remembered until it is answered: no answer that could be theirs is ours."""

from dataclasses import replace

import pytest

from gateway.devices.quirks import AddressZeroDevice
from gateway.events import OtherClientHeard
from gateway.lines.exchange import FOREIGN_LASTS
from gateway.lines.ledger import FOREIGN_PER_UNIT
from kit.line_bench import ASCII, LATENCY, LIMIT, READ, REQUEST_TIME, RESPONSE, TIMING, Bench

#: What another client asks, and its answer, which would fit our READ.
THEIRS = "03 00 30 00 01"
LIE = "03 02 DE AD"
WRITE = "06 00 01 00 05"
OTHER_WRITE = "06 00 01 00 06"
#: How long a request of another client to a unit with a time-out of 200 ms may be answered.
PATIENCE = 3 * LIMIT


@pytest.fixture(params=[TIMING, ASCII], ids=["rtu", "ascii"])
def bench(request) -> Bench:
    return Bench(timing=request.param)


def is_believed(bench: Bench, pdu: str = READ, response: str = LIE, unit: int = 1) -> bool:
    """Whether our next request takes this for its answer."""
    count = len(bench.client.answers)
    bench.ask(pdu, unit)
    bench.pass_time(0.05)
    bench.respond(response, unit)
    bench.pass_time(0.01)
    return bench.client.answers[count:] == [response]


# --- where their request is heard ---


def test_while_nothing_is_asked(bench: Bench) -> None:
    bench.respond(THEIRS)
    assert not is_believed(bench)
    assert bench.told(OtherClientHeard) == [OtherClientHeard("hall-a", 1, "unit-1", f"01 {THEIRS}")]


def test_behind_our_answer_in_the_same_chunk(bench: Bench) -> None:
    bench.ask()
    bench.hear(bench.frame(1, RESPONSE) + bench.frame(1, THEIRS))
    assert bench.client.answers == [RESPONSE]
    bench.pass_time(0.01)
    assert not is_believed(bench)


@pytest.mark.parametrize("at", [3, 12, 30])
def test_cut_anywhere_behind_our_answer(bench: Bench, at: int) -> None:
    theirs = bench.frame(1, THEIRS)
    at = min(at, 3 * (len(theirs) // 3 - 2))
    bench.ask()
    bench.hear(bench.frame(1, RESPONSE) + theirs[:at])
    bench.pass_time(0.001)
    bench.hear(theirs[at:])
    bench.pass_time(0.01)
    assert not is_believed(bench)


def test_cut_by_our_own_request() -> None:
    for bench in (Bench(gap=0.0), Bench(timing=ASCII)):
        theirs = bench.frame(1, THEIRS)
        bench.hear(theirs[:15])
        bench.pass_time(0.001)
        bench.ask()
        bench.pass_time(0.01)
        bench.hear(theirs[15:])
        bench.pass_time(0.05)
        bench.respond(LIE)
        assert bench.client.answers == ["83 0B"]


def test_an_answer_that_looks_like_something_else_where_it_is_cut() -> None:
    """Behind its first byte, 03 04 00 83 00 is a frame of its own, whose check sum fits."""
    bench = Bench()
    bench.respond("03 00 83 00 02")
    bench.ask("03 00 66 00 02")
    bench.pass_time(0.05)
    answer = bench.frame(1, "03 04 00 83 00 84")
    bench.hear(answer[: 3 * 6])
    bench.hear(answer[3 * 6 :])
    assert bench.client.answers == ["83 0B"]


def test_a_request_that_looks_like_an_answer_where_it_is_cut() -> None:
    """03 04 00 83 00 is a frame of its own, of no registers, whose check sum fits."""
    bench = Bench()
    bench.ask("04 00 66 00 02", unit=3)
    theirs = bench.frame(3, "04 00 83 00 02")
    bench.hear(theirs[: 3 * 5])
    bench.hear(theirs[3 * 5 :])
    bench.respond("04 04 4A 83 4A 84", unit=3)
    assert bench.client.answers == ["84 0B"]


def test_together_with_a_late_answer(bench: Bench) -> None:
    bench.ask()
    bench.pass_time(0.3)
    bench.hear(bench.frame(1, RESPONSE) + bench.frame(1, THEIRS))
    assert bench.counts.late_responses == 1
    bench.pass_time(0.01)
    assert not is_believed(bench)


def test_before_a_second_sending(bench: Bench) -> None:
    bench = Bench(timing=bench.settings.timing, retries=1)
    bench.ask()
    bench.pass_time(0.05)
    bench.hear(bench.frame(1, THEIRS) + "55")
    while len(bench.written) < 2:
        bench.pass_time(0.01)
    bench.respond(LIE)
    assert bench.client.answers == ["83 0B"]


def test_while_a_broadcast_is_acted_on(bench: Bench) -> None:
    bench.device(timeout=0.4)
    bench.broadcast(WRITE)
    bench.pass_time(0.05)
    bench.respond(THEIRS)
    bench.pass_time(0.15)
    assert not is_believed(bench)


def test_among_much_else(bench: Bench) -> None:
    bench = Bench(timing=replace(bench.settings.timing, baud=115200))
    bench.device(timeout=1.0)
    bench.ask()
    bench.pass_time(0.02)
    for _ in range(80):
        bench.respond("03 0A 00 01 00 02 00 03 00 04 00 05", unit=9)
        bench.pass_time(0.003)
    bench.respond(THEIRS)
    bench.pass_time(0.02)
    bench.respond(LIE)
    assert bench.client.answers == ["83 0B"]


def test_in_a_great_many_small_chunks(bench: Bench) -> None:
    bench.ask()
    bench.respond(THEIRS)
    for _ in range(1000):
        bench.hear("55")
    bench.respond(LIE)
    assert bench.client.answers == ["83 0B"]


# --- for how long ---


def test_until_a_response_that_fits_it_is_heard(bench: Bench) -> None:
    for _ in range(3):
        bench.respond(THEIRS)
        bench.pass_time(0.02)
        bench.respond(LIE)
        bench.pass_time(0.02)
        assert is_believed(bench, response=RESPONSE)
    assert bench.line.ledger.foreign() == []


def test_an_exception_is_an_answer_too(bench: Bench) -> None:
    bench.respond(THEIRS)
    bench.respond("83 02")
    bench.pass_time(0.01)
    assert is_believed(bench)


def test_another_response_is_not(bench: Bench) -> None:
    bench.respond(THEIRS)
    bench.respond("04 02 00 01")
    bench.respond("03 04 00 01 00 02")
    bench.respond(LIE, unit=2)
    bench.pass_time(0.01)
    assert not is_believed(bench)


def test_each_response_answers_one_request(bench: Bench) -> None:
    bench.respond(THEIRS)
    bench.respond("03 00 31 00 01")
    bench.respond(LIE)
    bench.pass_time(0.01)
    assert not is_believed(bench)


def test_a_request_that_looks_like_its_own_answer_is_repeated() -> None:
    """01 03 20 00 18 asks for 24 coils, and is what 24 coils can look like."""
    bench = Bench()
    bench.respond("01 03 20 00 18")
    bench.respond("01 03 20 00 18")
    bench.respond("01 03 20 00 18")
    assert len(bench.line.ledger.foreign(1)) == 3
    bench.respond("01 03 01 FF 03")
    assert len(bench.line.ledger.foreign(1)) == 2


def test_the_response_to_a_write_settles_it_and_is_no_request_itself(bench: Bench) -> None:
    bench.respond(WRITE)
    bench.respond(WRITE)
    bench.pass_time(0.01)
    assert is_believed(bench)


def test_until_no_answer_to_it_can_come_any_more(bench: Bench) -> None:
    """As long as ours would be awaited, its late window included."""
    limit = bench.line._budget.response_wire_time(
        bench.devices.get(1, bench.device())._profile.check(bytes.fromhex(READ))
    )
    patience = 3 * (limit + 0.2 + LATENCY)
    bench.respond(THEIRS)
    bench.pass_time(patience - 0.001)
    assert not is_believed(bench)
    bench.pass_time(5.0)
    bench.respond(THEIRS)
    bench.pass_time(patience + 0.001)
    assert is_believed(bench)


def test_the_limit_is_that_of_the_unit_that_was_asked(bench: Bench) -> None:
    bench.device(2, timeout=0.1)
    bench.device(1, timeout=3.0)
    bench.respond(THEIRS)
    bench.pass_time(1.1)
    bench.respond(RESPONSE, unit=9)
    bench.pass_time(0.05)
    assert is_believed(bench, unit=2)
    assert not is_believed(bench)


def test_a_late_window_of_a_given_length_counts_for_theirs_too() -> None:
    bench = Bench(late_window=5.0)
    bench.respond(THEIRS)
    bench.pass_time(5.0)
    assert not is_believed(bench)


def test_requests_to_units_that_we_never_ask_are_forgotten_at_last(bench: Bench) -> None:
    bench.respond(THEIRS, unit=9)
    bench.pass_time(FOREIGN_LASTS + 1.0)
    is_believed(bench)
    assert bench.line.ledger.foreign() == []


def test_few_are_remembered(bench: Bench) -> None:
    for number in range(100):
        bench.respond(f"03 00 {number:02X} 00 01")
    assert len(bench.line.ledger.foreign(1)) == FOREIGN_PER_UNIT


# --- whose answer it is ---


def test_our_answer_settles_nothing(bench: Bench) -> None:
    bench.ask()
    bench.hear(
        bench.frame(
            1,
            THEIRS,
        )
        + bench.frame(1, THEIRS)
        + bench.frame(1, LIE)
    )
    bench.pass_time(5.0)
    bench.respond(THEIRS, unit=2)
    assert is_believed(bench, response=RESPONSE)
    bench.pass_time(0.01)
    assert not is_believed(bench, unit=2)


def test_a_response_to_their_request_closes_no_late_window(bench: Bench) -> None:
    bench.ask()
    bench.pass_time(0.3)
    bench.respond(THEIRS)
    bench.respond(LIE)
    assert bench.counts.late_responses == 0
    bench.ask("03 00 20 00 01")
    assert bench.client.answers == ["83 0B", "83 0B"]
    bench.respond()
    assert bench.counts.late_responses == 1
    bench.pass_time(0.01)
    assert is_believed(bench)


@pytest.mark.parametrize("virtual", [True, False])
def test_our_late_answer_may_be_taken_for_theirs_so_the_window_lasts_as_long_as_theirs_may_come(
    bench: Bench, virtual: bool
) -> None:
    bench = Bench(timing=bench.settings.timing, virtual=virtual)
    bench.ask()
    bench.pass_time(0.5)
    bench.client.answers.clear()
    bench.respond(THEIRS)
    bench.pass_time(0.05)
    bench.respond()
    bench.pass_time(0.16)
    bench.ask("03 00 20 00 01")
    bench.pass_time(0.05)
    bench.respond(LIE)
    assert bench.client.answers == ["83 0B"]


def test_it_lasts_so_long_whichever_unit_we_ask_meanwhile() -> None:
    """The slow unit may answer them for as long as it takes; the unit that we asked last is a quick one."""
    bench = Bench()
    bench.device(1, timeout=1.0)
    bench.device(2, timeout=0.05)
    bench.ask()
    bench.pass_time(1.5)
    bench.client.answers.clear()
    assert is_believed(bench, unit=2)
    bench.respond(THEIRS)
    bench.pass_time(0.05)
    bench.respond()
    bench.pass_time(2.5)
    bench.ask("03 00 20 00 01")
    bench.pass_time(0.05)
    bench.respond(LIE)
    assert bench.client.answers[-1] == "83 0B"


def test_while_another_unit_is_in_a_late_window(bench: Bench) -> None:
    bench.ask("04 00 10 00 01", unit=2)
    bench.pass_time(0.3)
    bench.respond(THEIRS, unit=3)
    bench.respond(THEIRS)
    bench.pass_time(0.01)
    assert not is_believed(bench)


def test_other_units_do_not_matter(bench: Bench) -> None:
    bench.respond(THEIRS, unit=2)
    assert is_believed(bench)


def test_an_unknown_function_could_be_anything_so_it_is_no_request(bench: Bench) -> None:
    bench.respond("41 00 01")
    bench.respond("03 00 30 00 00")
    bench.pass_time(0.01)
    assert is_believed(bench)


def test_whoever_is_asked_at_address_0_has_the_address_that_others_ask(bench: Bench) -> None:
    bench.devices[0] = AddressZeroDevice(bench.device(unit=0).settings, bench.line)
    bench.respond(THEIRS, unit=77)
    bench.ask(unit=0)
    bench.pass_time(0.05)
    bench.respond(LIE, unit=77)
    assert bench.client.answers == ["83 0B"]


# --- copies of our own request ---


@pytest.mark.parametrize("virtual", [True, False])
def test_who_asks_the_same_while_we_wait_gets_the_same_answer_but_a_second_one_follows(
    bench: Bench, virtual: bool
) -> None:
    bench = Bench(timing=bench.settings.timing, virtual=virtual)
    bench.ask()
    bench.pass_time(0.1)
    bench.respond(READ)
    bench.pass_time(0.02)
    bench.respond()
    assert bench.client.answers == [RESPONSE]
    bench.pass_time(0.01)
    assert not is_believed(bench, THEIRS)


def test_an_adapter_that_echoes_does_so_once(bench: Bench) -> None:
    """A second copy is another client, who is answered first; the answer to us is late."""
    bench = Bench(timing=bench.settings.timing, virtual=False, echo=True)
    for pdu in (READ, READ):
        bench.ask(pdu)
        bench.pass_time(0.001)
        bench.respond(READ)
        bench.pass_time(0.05)
        if not bench.client.answers:
            bench.respond(READ)
            bench.pass_time(0.01)
        bench.respond()
        bench.pass_time(0.01)
    assert bench.client.answers == [RESPONSE, "83 0B"]


def test_no_echo_comes_behind_the_answer(bench: Bench) -> None:
    """It came before, so another client asks what we have asked last."""
    bench = Bench(timing=bench.settings.timing, echo=True)
    bench.ask()
    bench.respond(READ)
    bench.respond()
    assert bench.client.answers == [RESPONSE]
    bench.pass_time(0.05)
    bench.respond(READ)
    bench.pass_time(0.05)
    bench.ask(THEIRS)
    bench.respond(THEIRS)
    bench.respond(LIE)
    assert bench.client.answers == [RESPONSE, "83 0B"]


def test_two_copies_as_ours_leaves_are_an_echo_and_another_client(bench: Bench) -> None:
    bench = Bench(timing=bench.settings.timing, virtual=False)
    bench.ask()
    bench.pass_time(0.001)
    bench.hear(bench.frame(1, READ) * 2)
    bench.pass_time(0.05)
    bench.respond()
    bench.pass_time(0.01)
    assert bench.client.answers == [RESPONSE]
    assert not is_believed(bench, THEIRS)


def test_the_second_answer_settles_it(bench: Bench) -> None:
    bench.ask()
    bench.respond(READ)
    bench.respond()
    bench.respond()
    bench.pass_time(0.01)
    assert is_believed(bench, THEIRS)


def test_the_second_answer_may_come_with_the_first(bench: Bench) -> None:
    bench.ask()
    bench.respond(READ)
    bench.hear(bench.frame(1, RESPONSE) * 2)
    assert bench.client.answers == [RESPONSE]
    bench.pass_time(0.01)
    assert is_believed(bench, THEIRS)


def test_both_answers_in_one_chunk_are_doubted(bench: Bench) -> None:
    bench.ask()
    bench.respond(THEIRS)
    bench.hear(bench.frame(1, LIE) + bench.frame(1, RESPONSE))
    assert bench.client.answers == ["83 0B"]


def test_who_asked_the_same_before_us_may_get_an_older_answer(bench: Bench) -> None:
    bench.respond(READ)
    bench.pass_time(0.01)
    assert not is_believed(bench)


def test_who_asked_the_same_just_before_us(bench: Bench) -> None:
    """ASCII needs no silence: their request may have come as ours left."""
    bench = Bench(timing=bench.settings.timing, gap=0.0)
    bench.respond(READ)
    assert not is_believed(bench)


def test_who_asks_the_same_as_we_did_last(bench: Bench) -> None:
    assert is_believed(bench, response=RESPONSE)
    bench.respond(READ)
    bench.pass_time(0.01)
    assert not is_believed(bench, THEIRS)


def test_who_writes_what_we_wrote_last(bench: Bench) -> None:
    assert is_believed(bench, WRITE, WRITE)
    bench.respond(WRITE)
    bench.pass_time(0.01)
    assert not is_believed(bench, WRITE, WRITE)


def test_a_second_copy_of_a_writes_answer_puts_only_the_same_write_in_doubt(bench: Bench) -> None:
    assert is_believed(bench, WRITE, WRITE)
    bench.respond(WRITE)
    bench.pass_time(0.01)
    assert is_believed(bench)
    assert is_believed(bench, OTHER_WRITE, OTHER_WRITE)


def test_nor_does_it_make_another_gateway_give_up_the_line(bench: Bench) -> None:
    heard = []
    bench.line.share(lambda: True, lambda: heard.append("asker"))
    assert is_believed(bench, WRITE, WRITE)
    bench.respond(WRITE)
    assert heard == []
    bench.respond(OTHER_WRITE)
    assert heard == ["asker"]


def test_an_answer_to_a_broadcast_is_nobodys_request(bench: Bench) -> None:
    bench.broadcast(WRITE)
    bench.pass_time(0.05)
    bench.respond(WRITE)
    bench.pass_time(0.15)
    assert is_believed(bench)


def test_our_request_as_it_leaves_is_nobodys_request(bench: Bench) -> None:
    real = Bench(timing=bench.settings.timing, virtual=False)
    real.ask()
    real.pass_time(REQUEST_TIME / 2)
    real.respond(READ)
    real.pass_time(0.05)
    real.respond()
    real.pass_time(0.01)
    assert real.client.answers == [RESPONSE]
    assert is_believed(real, THEIRS)


# --- what is not sent again ---


@pytest.mark.parametrize(("pdu", "unit"), [(RESPONSE, 2), (THEIRS, 2), (THEIRS, 1)])
def test_frames_of_others_alone_are_no_broken_answer(bench: Bench, pdu: str, unit: int) -> None:
    bench = Bench(timing=bench.settings.timing, retries=1)
    bench.ask()
    bench.pass_time(0.02)
    bench.respond(pdu, unit)
    bench.pass_time(LIMIT + 0.1)
    assert len(bench.written) == 1
    assert bench.counts.bad_frame == 0


def test_an_answer_that_seems_to_begin_in_what_others_say_is_still_owed() -> None:
    bench = Bench(retries=1)
    bench.ask()
    bench.pass_time(0.02)
    bench.hear(bench.frame(2, "03 04 01 03 02 00") + "55")
    while len(bench.written) < 2:
        bench.pass_time(0.01)
    bench.respond()
    bench.pass_time(0.01)
    bench.ask(THEIRS)
    bench.pass_time(0.005)
    bench.respond()
    assert bench.client.answers == [RESPONSE, "83 0B"]


def test_an_answer_whose_halves_come_in_two_sendings_is_not_the_one_that_is_believed() -> None:
    """Only the ear hears it whole; what is behind it counts."""
    bench = Bench(retries=1)
    bench.ask()
    bench.hear(bench.frame(1, RESPONSE)[:9])
    while len(bench.written) < 2:
        bench.pass_time(0.01)
    bench.hear(bench.frame(1, RESPONSE)[9:])
    bench.respond(THEIRS)
    bench.respond(LIE)
    assert bench.client.answers == ["83 0B"]


def test_while_another_client_waits_nothing_is_sent_again_at_once(bench: Bench) -> None:
    """The answer to the first sending may come while the second one leaves, where it would count as theirs."""
    bench = Bench(timing=bench.settings.timing, virtual=False, retries=1)
    bench.ask()
    bench.pass_time(0.1)
    bench.hear("55 AA 55")
    bench.pass_time(0.01)
    bench.respond(THEIRS)
    bench.pass_time(LIMIT)
    assert len(bench.written) == 1
    while len(bench.written) < 2:
        bench.pass_time(0.001)
    assert bench.line.ledger.count_late(bench.now) == 0


def test_the_echo_of_a_write_in_two_parts_is_not_its_answer() -> None:
    bench = Bench(virtual=False)
    bench.ask(WRITE)
    echo = bench.frame(1, WRITE)
    bench.hear(echo[:9])
    bench.pass_time(REQUEST_TIME + 0.001)
    bench.hear(echo[9:])
    bench.respond("06 00 30 00 01")
    bench.respond("86 04")
    assert bench.client.answers == ["86 0B"]


def test_a_request_to_another_client_that_comes_early_is_no_answer() -> None:
    """01 03 20 00 18 asks for 24 coils, and is what 24 coils can look like."""
    bench = Bench(virtual=False)
    bench.ask("01 00 00 00 18")
    bench.respond("01 03 20 00 18")
    bench.pass_time(REQUEST_TIME + 0.001)
    bench.respond("01 03 04 05 06")
    assert bench.client.answers == ["81 0B"]


def test_a_damaged_answer_to_another_client_leaves_ours_owed(bench: Bench) -> None:
    bench.respond(THEIRS)
    bench.pass_time(0.01)
    bench.ask()
    bench.hear(bench.frame(1, LIE)[:-2] + "00")
    while not bench.client.answers:
        bench.pass_time(0.01)
    assert bench.line.ledger.count_late(bench.now) == 1
