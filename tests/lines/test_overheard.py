"""Other clients on the line: when one of them has asked the same unit, the next response is nobody's for sure."""

import pytest

from gateway.devices.quirks import AddressZeroDevice
from gateway.events import ForeignFrame, OtherClientHeard
from gateway.modbus import ascii as ascii_framing
from gateway.modbus import rtu
from kit.line_bench import ASCII, LIMIT, READ, RESPONSE, TIMING, Bench

#: What another client asks, and its answer, which would fit our READ.
THEIRS = "03 00 30 00 01"
THEIR_RESPONSE = "03 02 DE AD"

ENCODE = {"rtu": rtu.encode, "ascii": ascii_framing.encode}


def adu(mode: str, unit: int, pdu: str) -> bytes:
    return ENCODE[mode](unit, bytes.fromhex(pdu))


@pytest.fixture(params=[TIMING, ASCII], ids=["rtu", "ascii"])
def bench(request) -> Bench:
    return Bench(timing=request.param)


def test_a_response_after_another_clients_request_to_the_unit_is_ambiguous(bench: Bench) -> None:
    bench.ask()
    bench.respond(THEIRS)
    bench.pass_time(0.05)
    bench.respond(THEIR_RESPONSE)
    assert bench.client.answers == ["83 0B"]
    assert bench.counts.ambiguous == 1
    assert bench.counts.responses == 0
    assert bench.told(OtherClientHeard) == [OtherClientHeard("hall-a", 1, "unit-1", f"01 {THEIRS}")]


def test_the_answer_that_follows_an_ambiguous_one_is_late(bench: Bench) -> None:
    bench.ask()
    bench.respond(THEIRS)
    bench.respond(THEIR_RESPONSE)
    bench.ask("03 00 20 00 01")
    bench.respond()
    assert bench.client.answers == ["83 0B", "83 0B"]
    assert bench.counts.late_responses == 1
    (times,) = bench.devices[1].counts.times.values()
    assert (times.late, times.latest) == (0, 0.0)  # it came within its limit
    assert "late" not in bench.devices[1].counts.last_times


def test_nobody_speaks_into_the_true_answer_that_comes_after_an_ambiguous_one(bench: Bench) -> None:
    bench.ask()
    bench.respond(THEIRS)
    bench.respond(THEIR_RESPONSE)
    bench.ask(unit=2)
    bench.pass_time(LIMIT - 0.01)
    assert len(bench.written) == 1
    bench.pass_time(0.05)
    assert len(bench.written) == 2


def test_the_late_window_of_an_ambiguous_answer_counts_from_the_limits_end(bench: Bench) -> None:
    bench.ask()
    bench.respond(THEIRS)
    bench.respond(THEIR_RESPONSE)
    bench.pass_time(2.9 * LIMIT)
    bench.ask("03 00 20 00 01")
    assert len(bench.written) == 1
    bench.pass_time(LIMIT)
    assert len(bench.written) == 2


def test_an_ambiguous_response_is_no_failure_of_the_unit(bench: Bench) -> None:
    for _ in range(4):
        bench.ask()
        bench.respond(THEIRS)
        bench.respond()
        bench.pass_time(1.0)
    assert bench.client.answers == ["83 0B"] * 4
    assert bench.devices[1].breaker.failures == 0


def test_another_clients_request_to_another_unit_does_not_matter(bench: Bench) -> None:
    bench.ask()
    bench.respond(THEIRS, unit=2)
    bench.respond(THEIR_RESPONSE, unit=2)
    bench.respond()
    assert bench.client.answers == [RESPONSE]
    assert (bench.counts.ambiguous, len(bench.told(ForeignFrame))) == (0, bench.counts.foreign_frames)
    assert bench.counts.foreign_frames > 0


def test_another_clients_exception_is_ambiguous_too(bench: Bench) -> None:
    bench.ask()
    bench.respond("03 00 30 00 0A")
    bench.respond("83 02")
    assert bench.client.answers == ["83 0B"]
    assert bench.counts.exception == 0


@pytest.mark.parametrize("theirs", ["04 00 10 00 01", "06 00 01 00 05"])
def test_what_answers_another_clients_request_for_another_function_is_not_ours(bench: Bench, theirs: str) -> None:
    bench.ask()
    bench.respond(theirs)
    bench.respond()
    assert bench.client.answers == [RESPONSE]


def test_another_clients_request_alone_is_foreign(bench: Bench) -> None:
    bench.ask()
    bench.respond("06 00 01 00 05")
    bench.pass_time(1.0)
    assert bench.client.answers == ["83 0B"]
    assert (bench.counts.ambiguous, bench.counts.foreign_frames, bench.counts.bad_frame) == (0, 1, 1)


def test_on_a_real_port_a_request_heard_while_ours_leaves_counts_too(bench: Bench) -> None:
    real = Bench(timing=bench.settings.timing, virtual=False)
    real.ask()
    real.respond(THEIRS)
    real.pass_time(0.05)
    real.respond(THEIR_RESPONSE)
    assert real.client.answers == ["83 0B"]


def test_a_lone_devices_answer_is_ambiguous_when_its_own_address_was_asked(bench: Bench) -> None:
    bench.devices[0] = AddressZeroDevice(bench.device(unit=0).settings, bench.line)
    bench.ask(unit=0)
    bench.respond(THEIRS, unit=77)
    bench.respond(THEIR_RESPONSE, unit=77)
    assert bench.client.answers == ["83 0B"]


def test_lower_case_digits_and_parity_bits_hide_no_request() -> None:
    bench = Bench(timing=ASCII)
    bench.ask()
    bench.hear(adu("ascii", 1, THEIRS).lower().hex())
    bench.hear(bytes(character | 0x80 for character in adu("ascii", 1, RESPONSE).lower()).hex())
    assert bench.client.answers == ["83 0B"]


def test_lower_case_digits_are_no_second_client() -> None:
    bench = Bench(timing=ASCII)
    write = "06 00 01 00 AB"
    bench.ask(write)
    bench.hear(b"zz".hex() + adu("ascii", 1, write).lower().hex())
    assert bench.client.answers == [write]


def test_babble_does_not_hide_a_request() -> None:
    bench = Bench()
    bench.ask()
    bench.respond(THEIRS)
    for _ in range(20):
        bench.hear("55" * 100)
    bench.respond(THEIR_RESPONSE)
    assert bench.client.answers == ["83 0B"]
    assert len(bench.line._receiver._text) <= 1024 + 100


def test_what_comes_before_the_request_has_left_is_bounded_too() -> None:
    bench = Bench(virtual=False)
    bench.ask()
    for _ in range(100):
        bench.hear("55" * 100)
    assert len(bench.line._receiver._text) <= 1024 + 100


#: Another client's read of 24 coils. As a response, it has 24 coils.
TWOFOLD = "01 03 10 00 18"
COILS = "01 00 20 00 18"


@pytest.fixture(params=[TIMING, ASCII], ids=["rtu", "ascii"])
def shared(request) -> Bench:
    """A line on which another client was heard."""
    bench = Bench(timing=request.param, virtual=False)
    bench.device(1)
    bench.respond(THEIRS)
    bench.pass_time(0.05)
    bench.respond(THEIR_RESPONSE)
    bench.pass_time(0.1)
    return bench


def ask_coils(bench: Bench) -> None:
    bench.ask(COILS)
    bench.pass_time(0.03)


def test_a_request_that_looks_like_the_response_is_none(shared: Bench) -> None:
    ask_coils(shared)
    shared.respond(TWOFOLD)
    assert shared.client.answers == ["81 0B"]


def test_nor_is_it_the_response_that_is_late(shared: Bench) -> None:
    ask_coils(shared)
    shared.pass_time(0.3)
    shared.respond(TWOFOLD)
    assert shared.line.ledger.count_late(shared.now) == 1


def test_it_is_answered_though_it_may_answer_an_earlier_one(shared: Bench) -> None:
    shared.respond("01 00 00 00 18")
    shared.pass_time(0.1)
    shared.respond(TWOFOLD)
    shared.pass_time(0.05)
    ask_coils(shared)
    shared.respond("01 03 AA AA AA")
    assert shared.client.answers == ["81 0B"]


def test_it_makes_no_other_gateway_give_up_the_line(shared: Bench) -> None:
    heard: list[str] = []
    shared.line.share(lambda: True, lambda: heard.append("another client"))
    ask_coils(shared)
    shared.respond(TWOFOLD)
    assert heard == []


def test_a_client_that_asks_what_we_asked_is_another_one(bench: Bench) -> None:
    bench.ask()
    bench.respond()
    bench.pass_time(1.0)
    bench.respond(READ)
    bench.pass_time(0.05)
    bench.respond()
    bench.pass_time(0.1)
    ask_coils(bench)
    bench.respond(TWOFOLD)
    assert bench.client.answers == [RESPONSE, "81 0B"]


def test_the_line_that_follows_knows_of_the_other_client(shared: Bench) -> None:
    later = shared
    for _ in range(2):
        earlier, later = later, Bench(timing=shared.settings.timing, virtual=False)
        later.now = earlier.now + 50.0
        later.line.ledger.take_over(earlier.line.ledger.handed_on(later.now, 1.0), 1.0)
    ask_coils(later)
    later.respond(TWOFOLD)
    assert (later.client.answers, later.line.ledger.count_late(later.now)) == (["81 0B"], 1)


def test_an_earlier_line_has_heard_a_client_earlier(shared: Bench) -> None:
    earlier = shared.line.ledger.handed_on(shared.now, 1.0)
    shared.pass_time(200.0)
    shared.respond(THEIRS)
    shared.line.ledger.take_over([each for each in earlier if not each.owed], 1.0)
    shared.pass_time(200.0)
    ask_coils(shared)
    shared.respond(TWOFOLD)
    assert shared.client.answers == ["81 0B"]


def test_behind_our_answer_a_copy_is_no_echo_if_that_was_first() -> None:
    """Another client reads the coils that we have read, and gets an exception."""
    bench = Bench(virtual=False, echo=True)
    bench.ask(TWOFOLD)
    bench.hear(bench.frame(1, TWOFOLD))
    bench.pass_time(0.03)
    bench.respond("01 03 00 00 FF")
    bench.pass_time(0.1)
    bench.respond(TWOFOLD)
    bench.pass_time(0.01)
    bench.ask(COILS)
    bench.hear(bench.frame(1, COILS))
    bench.pass_time(0.03)
    bench.respond("81 02")
    assert bench.client.answers == ["01 03 00 00 FF", "81 0B"]


def test_the_response_to_another_clients_copy_may_be_for_our_request_and_as_late(bench: Bench) -> None:
    """On a virtual port the copy may come before all of our request can have been sent."""
    bench.ask()
    sent_at = bench.now
    bench.respond(READ)
    bench.respond("83 02")
    (theirs,) = bench.line.ledger.foreign()
    assert theirs.asked_at > sent_at + 0.003


def test_a_response_to_an_earlier_sending_does_not_stand_for_another_clients() -> None:
    """It comes while the second sending is on its way."""
    bench = Bench(virtual=False, retries=1)
    bench.ask()
    bench.pass_time(0.02)
    bench.hear("55")
    while len(bench.written) < 2:
        bench.pass_time(0.001)
    bench.respond(THEIRS)
    bench.respond()
    bench.pass_time(0.05)
    bench.respond(THEIR_RESPONSE)
    assert bench.client.answers == ["83 0B"]


def test_coils_are_no_request_where_nobody_else_was_heard_for_long(shared: Bench) -> None:
    shared.pass_time(301)
    ask_coils(shared)
    shared.respond(TWOFOLD)
    assert shared.client.answers == [TWOFOLD]


def test_most_coils_are_no_request(shared: Bench) -> None:
    ask_coils(shared)
    shared.respond("01 03 10 08 18")  # as a request, it would be for more coils than one response can have
    assert shared.client.answers == ["01 03 10 08 18"]


def test_a_counter_of_diagnostics_is_no_request(shared: Bench) -> None:
    shared.ask("08 00 0B 00 00")
    shared.pass_time(0.03)
    shared.respond("08 00 0B 00 05")
    assert shared.client.answers == ["08 00 0B 00 05"]


def test_a_counter_that_is_zero_may_be_the_request_of_another_client(shared: Bench) -> None:
    shared.ask("08 00 0B 00 00")
    shared.pass_time(0.03)
    shared.respond("08 00 0B 00 00")
    shared.pass_time(0.02)
    shared.respond("08 00 0B 00 05")
    assert shared.client.answers == ["88 0B"]


@pytest.mark.parametrize("response", ["08 00 0B 00 05", "08 00 0B 00 00", "06 00 01 00 05", TWOFOLD])
def test_a_response_that_comes_twice_shows_no_other_client(bench: Bench, response: str) -> None:
    heard: list[str] = []
    bench.line.share(lambda: True, lambda: heard.append("another client"))
    bench.ask({"08": "08 00 0B 00 00", "06": response, "01": COILS}[response[:2]])
    bench.pass_time(0.03)
    bench.respond(response)
    bench.pass_time(0.01)
    bench.respond(response)
    bench.pass_time(1.0)
    ask_coils(bench)
    bench.respond(TWOFOLD)
    assert (bench.client.answers, heard) == ([response, TWOFOLD], [])


@pytest.mark.parametrize(
    ("pdu", "late", "other", "their_response"),
    [
        ("08 00 0B 00 00", "08 00 0B 00 05", "08 00 0B 00 00", "08 00 0B 00 06"),
        ("01 03 00 00 18", "01 03 11 11 11", "01 00 10 00 18", "01 03 22 22 22"),
    ],
)
def test_one_who_asks_what_we_ask_in_place_of_a_response_is_remembered(
    shared: Bench, pdu: str, late: str, other: str, their_response: str
) -> None:
    shared.ask(pdu)
    shared.pass_time(0.03)
    shared.respond(pdu)
    shared.pass_time(0.1)
    shared.respond(late)
    shared.pass_time(0.1)
    shared.ask(other)
    shared.pass_time(0.05)
    shared.respond(their_response)
    assert [answer[3:] for answer in shared.client.answers] == ["0B", "0B"]


@pytest.mark.parametrize("start", range(0x0B, 0x0D))
def test_what_may_be_a_request_makes_nobody_forget_a_real_one(shared: Bench, start: int) -> None:
    shared.device(timeout=1.0)
    shared.respond(THEIRS)
    for _ in range(9):
        shared.pass_time(0.01)
        shared.respond(f"08 00 {start:02X} 00 00")
        shared.pass_time(0.01)
        shared.respond(f"08 00 {start:02X} 00 00")
    shared.ask()
    shared.pass_time(0.05)
    shared.respond(THEIR_RESPONSE)
    assert shared.client.answers == ["83 0B"]


def test_a_read_of_registers_is_a_request_wherever_they_are(shared: Bench) -> None:
    heard: list[str] = []
    shared.line.share(lambda: True, lambda: heard.append("another client"))
    for _ in range(3):
        shared.respond("03 03 00 00 01")
        shared.pass_time(0.1)
    assert len(heard) == 3
