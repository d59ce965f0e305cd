"""Late windows: after a time-out no answer is taken for another one, and the rest of the line goes on."""

import pytest

from gateway.devices.addresses import UnitAddresses
from gateway.devices.quirks import AddressZeroDevice, MovableDevice
from gateway.events import BadFrame, ForeignFrame, LateResponse, OtherClientHeard, RequestTimeout
from gateway.lines.exchange import Exchange
from gateway.lines.ledger import WORTH_WAITING
from gateway.profiles.profile import Profile
from gateway.timing.budget import AnswerTime
from gateway.timing.table import Point, TimingTable
from kit.asker import Asker
from kit.line_bench import ASCII, LIMIT, READ, REQUEST_TIME, RESPONSE, Bench, is_empty

OTHER = "03 00 20 00 01"
WRITE = "06 00 01 00 05"
EXCEPTION = "83 02"
#: The window after READ has timed out: twice the limit.
WINDOW = 2 * LIMIT


@pytest.fixture
def bench() -> Bench:
    return Bench()


def time_out(bench: Bench, pdu: str = READ, unit: int = 1) -> None:
    """A request fails; its window begins now."""
    bench.ask(pdu, unit)
    while not bench.client.answers:
        bench.pass_time(bench.line.deadline() - bench.now)
    bench.written.clear()
    bench.client.answers.clear()


#: Nobody on the line is answered later than so many seconds after it has asked.
PATIENCE = 1.0


def succeed(bench: Bench) -> Bench:
    """Another line on the same port, as after a reload or a restart."""
    other = Bench()
    other.now = bench.now
    other.plug()
    other.line.ledger.take_over(bench.line.ledger.handed_on(bench.now, PATIENCE), PATIENCE)
    other.pass_time(0.01)
    return other


# --- what a window forbids ---


def test_after_a_time_out_the_same_function_of_the_unit_gets_0b_at_once(bench: Bench) -> None:
    time_out(bench)
    bench.ask()
    bench.ask(OTHER)
    assert bench.client.answers == ["83 0B", "83 0B"]
    assert bench.written == []
    assert bench.counts.overdue == 2


def test_other_functions_and_other_units_go_on(bench: Bench) -> None:
    time_out(bench)
    bench.ask("04 00 10 00 01")
    bench.respond("04 02 00 07")
    bench.ask(unit=2)
    bench.pass_time(0.01)
    bench.respond(unit=2)
    assert bench.client.answers == ["04 02 00 07", RESPONSE]


@pytest.mark.parametrize("waits", [WORTH_WAITING - 0.001, WORTH_WAITING + 0.001])
def test_a_request_waits_for_the_end_of_a_window_that_is_near(bench: Bench, waits: float) -> None:
    time_out(bench)
    bench.pass_time(WINDOW - waits)
    bench.ask(OTHER)
    if waits > WORTH_WAITING:
        assert bench.client.answers == ["83 0B"]
        return
    bench.pass_time(waits - 0.0005)
    assert (bench.written, bench.client.answers) == ([], [])
    bench.pass_time(0.001)
    assert bench.written == [bench.frame(1, OTHER)]


def test_while_one_waits_for_a_window_other_units_and_clients_go_on(bench: Bench) -> None:
    time_out(bench)
    bench.pass_time(WINDOW - 0.2)
    bench.ask()
    bench.ask(WRITE)
    bench.ask(unit=2)
    assert bench.written == [bench.frame(2, READ)]
    bench.respond(unit=2)
    bench.pass_time(0.3)
    bench.respond()
    bench.pass_time(0.01)
    assert bench.written == [bench.frame(2, READ), bench.frame(1, READ), bench.frame(1, WRITE)]


def test_a_window_lasts_twice_the_limit(bench: Bench) -> None:
    time_out(bench)
    bench.pass_time(WINDOW - 0.001)
    assert bench.line.ledger.forbid_until(transaction(bench), bench.now) is not None
    bench.pass_time(0.002)
    assert bench.asks() is not None
    assert bench.written == [bench.frame(1, READ)]


def test_a_window_lasts_as_long_as_the_devices_slowest_answer_if_that_is_more(bench: Bench) -> None:
    table = TimingTable.of({3: [Point(1, 0.1)], 4: [Point(1, 0.8)]})
    bench.device().answer_time = AnswerTime(table, margin=1.5, timeout=0.3)
    bench.ask()
    bench.pass_time(REQUEST_TIME + LIMIT)
    until = bench.line.ledger.forbid_until(transaction(bench), bench.now)
    assert until is not None
    assert until - bench.now == pytest.approx(1.2, abs=0.06)


@pytest.mark.parametrize("length", [0.0, 0.3, 10.0])
def test_late_window_sets_the_length(length: float) -> None:
    bench = Bench(late_window=length)
    time_out(bench)
    if length:
        bench.pass_time(length - 0.001)
        assert bench.line.ledger.forbid_until(transaction(bench), bench.now) == pytest.approx(
            bench.now + 0.001, abs=1e-4
        )
        bench.pass_time(0.002)
    bench.ask()
    assert bench.written == [bench.frame(1, READ)]


def test_a_waiting_request_fails_at_once_when_a_window_makes_it_overdue(bench: Bench) -> None:
    clients = [Asker(f"10.0.0.{number}:1") for number in range(3)]
    bench.ask()
    for client in clients:
        bench.ask(OTHER, client=client)
    bench.ask("04 00 10 00 01")
    bench.pass_time(REQUEST_TIME + LIMIT + 1e-6)
    assert [client.answers for client in clients] == [["83 0B"]] * 3
    assert bench.written == [bench.frame(1, READ), bench.frame(1, "04 00 10 00 01")]
    assert bench.counts.overdue == 3


def test_a_client_that_asks_one_unit_after_the_other_does_not_freeze(bench: Bench) -> None:
    """Unit 1 is silent. Its requests cost their limit once, then nothing until the window ends."""
    began, rounds = bench.now, 0
    while bench.now < began + 10.0:
        rounds += 1
        for unit in (1, 2, 3):
            bench.ask(unit=unit)
            bench.pass_time(0.01)
            if bench.line.ledger.current is not None and unit != 1:
                bench.respond(unit=unit)
            bench.pass_time(0.01)
            while bench.line.ledger.current is not None:
                bench.pass_time(0.01)
    assert rounds > 100


# --- late responses ---


def test_a_late_response_is_dropped_told_with_its_delay_and_closes_the_window(bench: Bench) -> None:
    time_out(bench)
    bench.pass_time(0.1)
    bench.respond()
    assert bench.client.answers == []
    told = bench.told(LateResponse)[0]
    assert (told.unit, told.function) == (1, 3)
    assert told.elapsed_ms == round((LIMIT + 0.1) * 1000, 1)
    assert told.limit_ms == round(LIMIT * 1000, 1)
    assert (bench.counts.late_responses, bench.counts.foreign_frames) == (1, 0)
    bench.ask(OTHER)
    bench.pass_time(0.01)
    assert bench.written == [bench.frame(1, OTHER)]


def test_a_late_exception_closes_the_window_too(bench: Bench) -> None:
    time_out(bench)
    bench.respond(EXCEPTION)
    assert bench.counts.late_responses == 1
    assert not bench.line.ledger.owed()


@pytest.mark.parametrize(
    ("pdu", "unit"),
    [("03 04 01 10 01 10", 1), ("04 02 01 10", 1), ("84 02", 1), (RESPONSE, 2)],
    ids=["another size", "another function", "another function's exception", "another unit"],
)
def test_what_does_not_fit_the_request_leaves_the_window_open(bench: Bench, pdu: str, unit: int) -> None:
    time_out(bench)
    bench.respond(pdu, unit)
    assert bench.counts.late_responses == 0
    assert bench.line.unasked_bytes > 0
    bench.ask()
    assert bench.client.answers == ["83 0B"]


def test_the_rest_of_a_response_that_was_half_there_at_the_limit_is_late(bench: Bench) -> None:
    whole = bench.frame(1, RESPONSE)
    bench.ask()
    bench.pass_time(0.2)
    bench.hear(whole[:9])
    bench.pass_time(0.1)
    bench.hear(whole[9:])
    assert bench.client.answers == ["83 0B"]
    assert bench.counts.late_responses == 1


def test_half_an_ascii_response_too() -> None:
    bench = Bench(timing=ASCII)
    whole = bench.frame(1, RESPONSE)
    bench.ask()
    bench.pass_time(0.22)
    bench.hear(whole[:18])
    bench.pass_time(0.1)
    bench.hear(whole[18:])
    assert bench.client.answers == ["83 0B"]
    assert bench.counts.late_responses == 1


def test_after_the_window_a_response_is_unasked_bytes(bench: Bench) -> None:
    time_out(bench)
    bench.pass_time(WINDOW + 0.001)
    bench.respond()
    assert (bench.counts.late_responses, bench.line.unasked_bytes) == (0, 7)


def test_each_request_that_timed_out_has_a_window_of_its_own() -> None:
    bench = Bench(late_window=1.0)
    time_out(bench)
    time_out(bench, "04 00 10 00 01")
    bench.respond("04 02 00 07")
    assert bench.counts.late_responses == 1
    bench.ask()
    assert bench.client.answers == ["83 0B"]
    bench.respond()
    assert bench.counts.late_responses == 2
    assert not bench.line.ledger.owed()


@pytest.mark.parametrize("timing", [Bench().settings.timing, ASCII], ids=["rtu", "ascii"])
def test_a_late_response_while_another_unit_is_asked_disturbs_nothing(timing: object) -> None:
    bench = Bench(timing=timing)
    bench.ask()
    bench.pass_time(0.3)
    bench.client.answers.clear()
    bench.ask(unit=2)
    bench.pass_time(0.05)
    bench.respond("03 02 AA AA")
    assert bench.client.answers == []
    bench.respond("03 02 00 07", unit=2)
    assert bench.client.answers == ["03 02 00 07"]
    counts = bench.counts
    assert (counts.late_responses, counts.responses, counts.foreign_frames, counts.noise) == (1, 1, 0, 0)
    assert bench.told(ForeignFrame) == []


def test_a_late_response_glued_before_another_units_response(bench: Bench) -> None:
    time_out(bench)
    bench.ask(unit=2)
    bench.hear(bench.frame(1, "03 02 AA AA") + bench.frame(2, "03 02 00 07"))
    assert bench.client.answers == ["03 02 00 07"]
    assert bench.counts.late_responses == 1


def test_the_answer_to_another_client_closes_none_of_several_windows(bench: Bench) -> None:
    """In ASCII each window hears every frame of the line."""
    for each in (bench, Bench(timing=ASCII)):
        each.ask(unit=2)
        each.ask()
        each.pass_time(0.5)
        assert each.line.ledger.count_late(each.now) == 2
        each.respond(OTHER)
        each.respond("03 02 80 00")
        assert each.line.ledger.count_late(each.now) == 2
        each.respond()
        assert each.line.ledger.count_late(each.now) == 1


def test_one_late_response_closes_one_of_two_equal_windows(bench: Bench) -> None:
    time_out(bench)
    time_out(bench, unit=2)
    for _ in range(2):
        successor = succeed(bench)
        successor.line.ledger.take_over(bench.line.ledger.handed_on(bench.now, PATIENCE), PATIENCE)
        assert successor.line.ledger.count_late(successor.now) == 4
        successor.respond()
        assert successor.line.ledger.count_late(successor.now) == 3
        successor.hear(successor.frame(1, RESPONSE) + successor.frame(2, RESPONSE) * 2)
        assert successor.line.ledger.count_late(successor.now) == 0


@pytest.mark.parametrize("timing", [Bench().settings.timing, ASCII], ids=["rtu", "ascii"])
def test_a_late_response_alone_is_no_broken_frame_of_the_unit_that_is_asked(timing: object) -> None:
    bench = Bench(timing=timing)
    bench.ask()
    bench.pass_time(0.3)
    bench.ask(unit=2)
    bench.pass_time(0.05)
    bench.respond()
    bench.pass_time(0.4)
    assert [type(event) for event in bench.events] == [RequestTimeout, LateResponse, RequestTimeout]
    counts = bench.counts
    assert (counts.timeout, counts.bad_frame, counts.foreign_frames) == (2, 0, 0)


def test_the_late_response_of_a_write_is_no_other_clients_request(bench: Bench) -> None:
    """The response to 06 reads as a request; it must not make the next answer of its unit ambiguous."""
    time_out(bench, WRITE)
    bench.ask()
    bench.pass_time(0.02)
    bench.respond(WRITE)
    bench.respond()
    assert bench.client.answers == [RESPONSE]
    assert (bench.counts.late_responses, bench.counts.ambiguous) == (1, 0)


def test_two_late_responses_in_one_chunk(bench: Bench) -> None:
    time_out(bench)
    time_out(bench, unit=2)
    bench.hear(bench.frame(1, RESPONSE) + bench.frame(2, RESPONSE))
    assert bench.counts.late_responses == 2
    assert not bench.line.ledger.owed()


def test_only_the_first_of_two_copies_is_late_the_other_is_nobodys(bench: Bench) -> None:
    time_out(bench)
    bench.hear(2 * bench.frame(1, RESPONSE))
    assert bench.counts.late_responses == 1


UNKNOWN, UNKNOWN_RESPONSE = "41 01 02", "41 99"


def test_silence_ends_a_late_response_of_unknown_size(bench: Bench) -> None:
    time_out(bench, UNKNOWN)
    bench.respond(UNKNOWN_RESPONSE)
    assert bench.counts.late_responses == 0
    bench.pass_time(0.02)
    assert bench.counts.late_responses == 1
    assert bench.line.deadline() is None
    bench.ask(UNKNOWN)
    assert bench.written == [bench.frame(1, UNKNOWN)]


def test_a_late_response_that_only_its_request_tells_the_size_of(bench: Bench) -> None:
    returned = "08 00 00 A5 37"
    time_out(bench, returned)
    bench.respond(returned)
    assert bench.counts.late_responses == 1


def test_silence_ends_one_of_unknown_size_that_came_before_its_window(bench: Bench) -> None:
    bench.ask(UNKNOWN)
    bench.pass_time(0.1)
    bench.respond(UNKNOWN_RESPONSE)
    bench.unplug()
    assert bench.counts.late_responses == 0
    bench.pass_time(0.02)
    assert bench.counts.late_responses == 1


@pytest.mark.parametrize("unit", [1, 2])
def test_it_ends_beside_another_transaction_too(bench: Bench, unit: int) -> None:
    time_out(bench, UNKNOWN)
    bench.ask(unit=unit)
    bench.ask("04 00 10 00 01", unit=unit)
    bench.respond(UNKNOWN_RESPONSE)
    bench.pass_time(0.02)
    assert bench.counts.late_responses == 1


# --- the port ---


def test_a_lost_port_opens_a_window(bench: Bench) -> None:
    bench.ask()
    bench.unplug()
    bench.plug()
    bench.client.answers.clear()
    bench.pass_time(0.01)
    bench.ask(OTHER)
    assert bench.client.answers == ["83 0B"]
    bench.respond()
    assert bench.counts.late_responses == 1


def test_a_port_lost_after_a_second_sending_leaves_two_answers_owing() -> None:
    bench = Bench(retries=1)
    bench.ask()
    bench.hear("55")
    while len(bench.written) < 2:
        bench.pass_time(0.01)
    bench.unplug()
    bench.plug()
    bench.pass_time(0.01)
    bench.respond()
    bench.ask(OTHER)
    assert bench.client.answers == ["83 0B", "83 0B"]
    bench.respond()
    bench.pass_time(0.01)
    bench.ask(OTHER)
    assert len(bench.written) == 3


def test_a_window_outlives_the_port(bench: Bench) -> None:
    time_out(bench)
    bench.unplug()
    bench.plug()
    bench.pass_time(0.01)
    bench.ask()
    assert bench.client.answers == ["83 0B"]


# --- devices whose address is not certain ---


def test_a_device_asked_at_0_is_not_asked_while_any_unit_may_answer_late(bench: Bench) -> None:
    """Its answer is taken from whatever address it comes."""
    lone = AddressZeroDevice(bench.device(unit=0).settings, bench.line)
    time_out(bench, unit=7)
    lone.submit(bench.client.ask(READ), bench.now)
    assert bench.client.answers == ["83 0B"]


def test_nor_while_a_unit_may_answer_another_function_late(bench: Bench) -> None:
    lone = AddressZeroDevice(bench.device(unit=0).settings, bench.line)
    time_out(bench, "04 00 10 00 01", unit=7)
    lone.submit(bench.client.ask(READ), bench.now)
    assert bench.client.answers == ["83 0B"]


def test_no_unit_is_asked_the_same_while_a_device_asked_at_0_may_answer_late(bench: Bench) -> None:
    bench.devices[0] = AddressZeroDevice(bench.device(unit=0).settings, bench.line)
    time_out(bench, unit=0)
    bench.ask(unit=7)
    assert bench.client.answers == ["83 0B"]
    bench.ask("04 00 10 00 01", unit=7)
    assert bench.written == [bench.frame(7, "04 00 10 00 01")]
    bench.respond("03 02 00 01", unit=9)
    assert bench.counts.late_responses == 1


@pytest.fixture
def silo(bench: Bench) -> MovableDevice:
    profile = Profile("weigher", functions=frozenset({3, 16}), quirks=frozenset({"moves", "changes_baud"}))
    device = MovableDevice(
        bench.device(profile=profile).settings, bench.line, line_name="hall-a", line_source="",
        addresses=UnitAddresses(), is_alone=False, remember=lambda *_: None, emit=bench.events.append,
    )  # fmt: skip
    bench.devices[1] = device
    return device


MOVE_TO_5 = "10 01 00 00 01 02 00 05"


def test_a_late_confirmation_of_a_move_is_believed(bench: Bench, silo: MovableDevice) -> None:
    time_out(bench, MOVE_TO_5)
    bench.respond("10 01 00 00 01", unit=5)
    assert silo.unit == 5
    assert bench.counts.late_responses == 1


def test_of_several_windows_the_longest_one_counts(bench: Bench) -> None:
    bench.device()
    windows = bench.line.ledger
    for ends_at in (5.0, 9.0, 7.0):
        late = Exchange(1, 1, transaction(bench).asked, 0)
        late.ends_at = ends_at
        windows.late.append(late)
    assert windows.forbid_until(transaction(bench), 0.0) == 9.0


def test_while_a_move_may_be_confirmed_late_nobody_is_asked_the_same(bench: Bench, silo: MovableDevice) -> None:
    time_out(bench, MOVE_TO_5)
    bench.ask("10 00 01 00 01 02 00 07", unit=2)
    assert bench.client.answers == ["90 0B"]


def test_a_broadcast_is_answered_by_nobody_so_it_goes_on(bench: Bench, silo: MovableDevice) -> None:
    time_out(bench, MOVE_TO_5)
    bench.broadcast("10 00 01 00 01 02 00 05")
    bench.pass_time(0.01)
    assert bench.written == [bench.frame(0, "10 00 01 00 01 02 00 05")]


def test_a_move_waits_for_the_windows_of_all_units(bench: Bench, silo: MovableDevice) -> None:
    time_out(bench, "10 00 01 00 01 02 00 07", unit=5)
    bench.ask(MOVE_TO_5)
    assert bench.client.answers == ["90 0B"]


def test_a_move_waits_for_all_windows_of_its_unit(bench: Bench, silo: MovableDevice) -> None:
    """The late answer would come from the new address."""
    time_out(bench)
    bench.ask(MOVE_TO_5)
    assert bench.client.answers == ["90 0B"]


def test_a_window_is_for_the_address_that_was_asked(bench: Bench, silo: MovableDevice) -> None:
    """The device is sought at both its addresses; frames from them cannot be taken for each other."""
    time_out(bench, MOVE_TO_5)
    time_out(bench)
    assert silo.unit == 1
    bench.pass_time(WINDOW - 0.1)
    bench.ask()
    bench.pass_time(0.1)
    assert bench.written == [bench.frame(1, READ)]
    bench.respond()
    assert bench.client.answers == [RESPONSE]


# --- answers owed by earlier sendings ---


def test_after_a_repeated_read_the_answer_to_its_first_sending_is_awaited_too() -> None:
    """Noise made it a broken frame, so it was sent again; but the device answers both, the first one late."""
    bench = Bench(retries=1)
    bench.ask()
    bench.hear("55")
    bench.pass_time(REQUEST_TIME + LIMIT + 0.001)
    assert len(bench.written) == 2
    bench.respond()
    assert bench.client.answers == [RESPONSE]
    bench.ask(OTHER)
    assert bench.client.answers == [RESPONSE, "83 0B"]
    bench.respond()
    assert bench.counts.late_responses == 1
    bench.ask(OTHER)
    bench.pass_time(0.01)
    bench.respond("03 02 00 07")
    assert bench.client.answers == [RESPONSE, "83 0B", "03 02 00 07"]


def test_a_broken_response_is_an_answer_so_none_is_owed() -> None:
    for timing in (Bench().settings.timing, ASCII):
        bench = Bench(retries=1, timing=timing)
        bench.ask()
        broken = bytearray.fromhex(bench.frame(1, RESPONSE))
        broken[-3] ^= 1
        bench.hear(broken.hex())
        bench.pass_time(0.01)
        assert len(bench.written) == 2
        bench.respond()
        bench.pass_time(0.01)
        bench.ask(OTHER)
        assert len(bench.written) == 3


def test_a_lone_devices_broken_response_is_known_without_its_address() -> None:
    bench = Bench(retries=1)
    bench.devices[0] = AddressZeroDevice(bench.device(unit=0).settings, bench.line)
    bench.ask(unit=0)
    bench.hear(bench.frame(77, RESPONSE)[:-2] + "00")
    bench.pass_time(0.01)
    bench.respond(unit=77)
    bench.pass_time(0.01)
    bench.ask(OTHER, unit=0)
    assert len(bench.written) == 3


def test_a_repeated_read_that_fails_owes_two_answers() -> None:
    bench = Bench(retries=1)
    bench.ask()
    bench.hear("55")
    bench.pass_time(0.5)
    assert bench.client.answers == ["83 0B"]
    bench.respond()
    bench.ask(OTHER)
    assert bench.client.answers == ["83 0B", "83 0B"]
    bench.respond()
    assert bench.counts.late_responses == 2
    bench.pass_time(0.01)
    bench.ask(OTHER)
    assert bench.written[-1] == bench.frame(1, OTHER)


# --- nothing is left behind ---


def test_windows_end_by_themselves(bench: Bench) -> None:
    for unit in range(1, 20):
        time_out(bench, unit=unit)
    bench.pass_time(1.0)
    bench.asks(unit=30)
    bench.pass_time(1.0)
    bench.respond()
    assert not bench.line.ledger.owed()
    assert is_empty(bench.line)
    assert bench.told(BadFrame) == []


def transaction(bench: Bench, pdu: str = READ):
    return bench.devices[1]._transaction(bench.client.ask(pdu), bench.devices[1]._profile.check(bytes.fromhex(pdu)))


def test_a_line_tells_how_many_late_answers_it_awaits_and_how_many_requests_wait(bench: Bench) -> None:
    time_out(bench)
    time_out(bench, unit=2)
    bench.ask("04 00 10 00 01")
    bench.ask("04 00 20 00 01")
    assert (bench.line.ledger.count_late(bench.now), len(bench.line.queue)) == (2, 1)
    bench.pass_time(10.0)
    assert (bench.line.ledger.count_late(bench.now), len(bench.line.queue)) == (0, 0)


def test_what_no_window_forbids_goes_as_soon_as_a_broadcast_has_had_its_time() -> None:
    bench = Bench(late_window=5.0)
    time_out(bench)
    bench.ask(unit=3)
    bench.broadcast("06 00 01 00 05", client=Asker("10.0.0.7:1"))
    bench.ask(unit=2, client=Asker("10.0.0.8:1"))
    bench.pass_time(0.02)
    bench.respond(unit=3)
    bench.pass_time(0.2)
    assert bench.written[1:] == [bench.frame(0, "06 00 01 00 05"), bench.frame(2, READ)]


# --- what an earlier line on the port has asked ---


def test_a_line_that_follows_awaits_what_the_earlier_one_has_awaited(bench: Bench) -> None:
    time_out(bench, WRITE)
    time_out(bench)
    successor = succeed(bench)
    assert successor.line.ledger.count_late(successor.now) == 2
    successor.ask()
    assert successor.client.answers == ["83 0B"]
    successor.ask(unit=2)
    assert successor.written == [successor.frame(2, READ)]
    successor.pass_time(0.01)
    successor.respond(unit=2)
    successor.respond(WRITE)
    assert successor.line.ledger.count_late(successor.now) == 1
    assert (successor.told(OtherClientHeard), successor.told(LateResponse)) == ([], [])
    successor.pass_time(WINDOW)
    assert successor.line.ledger.handed_on(successor.now, PATIENCE) == []
    successor.ask()
    assert successor.written[-1] == successor.frame(1, READ)


def test_a_line_that_follows_on_one_that_was_asked_at_address_0_trusts_no_unit(bench: Bench) -> None:
    bench.devices[0] = AddressZeroDevice(bench.device(0).settings, bench.line)
    time_out(bench, READ, unit=0)
    successor = succeed(bench)
    successor.ask(unit=5)
    assert successor.client.answers == ["83 0B"]
    successor.respond(unit=9)
    successor.pass_time(0.01)
    successor.ask(unit=5)
    assert successor.written == [successor.frame(5, READ)]


def test_a_line_that_follows_awaits_what_other_clients_are_owed(bench: Bench) -> None:
    bench.hear(bench.frame(1, READ))
    bench.pass_time(PATIENCE - 0.3)
    successor = succeed(bench)
    successor.ask()
    successor.respond()
    successor.pass_time(0.01)
    successor.ask()
    assert successor.client.answers == ["83 0B"]
    assert successor.written == [successor.frame(1, READ)]
    bench.pass_time(0.31)
    assert not any(each.owed for each in bench.line.ledger.handed_on(bench.now, PATIENCE))


@pytest.mark.parametrize(("later", "count"), [(PATIENCE - 1e-6, 1), (PATIENCE, 0)])
def test_another_clients_response_is_overdue_as_long_as_it_may_come(bench: Bench, later: float, count: int) -> None:
    bench.respond(OTHER)
    assert sum(each.owed for each in bench.line.ledger.handed_on(bench.now + later, PATIENCE)) == count
