"""One line's transactions: what goes out when, which response is accepted, and what a client gets instead of one."""

import pytest

from gateway.devices.addresses import UnitAddresses
from gateway.devices.quirks import MovableDevice
from gateway.events import BadFrame, ForeignFrame, QueueFull, RequestTimeout
from gateway.lines.counts import Counts
from gateway.lines.line import RATE_CHANGE_PAUSE
from gateway.modbus import ascii as ascii_framing
from gateway.modbus.rtu import with_crc
from gateway.profiles.profile import Profile
from gateway.timing.characters import CharacterFormat, LineTiming
from kit.asker import Asker
from kit.line_bench import (
    ASCII,
    LATENCY,
    LIMIT,
    READ,
    READ_FRAME,
    REQUEST_TIME,
    RESPONSE,
    RESPONSE_FRAME,
    TIMING,
    Bench,
    frame,
    is_empty,
)

OTHER = "03 00 20 00 01"
WRITE = "06 00 01 00 05"


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_a_request_goes_out_framed_and_its_response_comes_back(bench: Bench) -> None:
    bench.ask()
    assert bench.written == [READ_FRAME]
    bench.hear(RESPONSE_FRAME)
    assert bench.client.answers == [RESPONSE]


def test_one_request_at_a_time_in_the_order_they_came(bench: Bench) -> None:
    bench.ask()
    bench.ask("03 00 20 00 01")
    bench.pass_time(0.1)
    assert len(bench.written) == 1
    bench.hear(RESPONSE_FRAME)
    bench.pass_time(0.1)
    assert bench.written == [READ_FRAME, frame(1, "03 00 20 00 01")]


def test_the_next_request_leaves_after_t35_of_silence_and_not_before(bench: Bench) -> None:
    bench.ask()
    bench.ask()
    bench.pass_time(0.02)
    bench.hear(RESPONSE_FRAME)
    bench.pass_time(TIMING.t35 - 1e-6)
    assert len(bench.written) == 1
    bench.pass_time(2e-6)
    assert len(bench.written) == 2


def test_a_line_is_quiet_when_its_silence_is_over(bench: Bench) -> None:
    bench.ask()
    bench.pass_time(0.01)
    bench.respond()
    until = bench.now + bench.settings.silence_before_request
    assert not bench.line.can_send(until - 1e-6)
    assert bench.line.can_send(until)


def test_noise_on_the_idle_line_starts_the_silence_anew(bench: Bench) -> None:
    bench.hear("00")
    bench.ask()
    assert bench.written == []
    bench.pass_time(TIMING.t35 + 1e-6)
    assert bench.written == [READ_FRAME]
    assert bench.line.unasked_bytes == 1


def test_a_gap_of_0_sends_the_next_request_with_the_response() -> None:
    bench = Bench(gap=0.0)
    bench.ask()
    bench.ask()
    bench.hear(RESPONSE_FRAME)
    assert bench.written == [READ_FRAME, READ_FRAME]


def test_the_next_request_is_on_the_line_before_the_response_is_sent_on() -> None:
    bench = Bench(gap=0.0)
    seen = []
    bench.client.answer = lambda *_: seen.append(len(bench.written))
    bench.ask()
    bench.ask()
    bench.hear(RESPONSE_FRAME)
    assert seen == [2]


def test_a_client_that_asks_again_out_of_its_answer_finds_the_line_in_order() -> None:
    bench = Bench(gap=0.0)
    answer = bench.client.answer

    def ask_again(request: object, pdu: bytes) -> None:
        answer(request, pdu)
        if len(bench.client.answers) < 3:
            bench.ask()

    bench.client.answer = ask_again
    bench.ask()
    for _ in range(3):
        bench.hear(RESPONSE_FRAME)
    assert bench.client.answers == [RESPONSE] * 3
    assert bench.written == [READ_FRAME] * 3


def test_silence_is_answered_0b_when_the_limit_after_the_request_has_passed(bench: Bench) -> None:
    bench.ask()
    bench.pass_time(REQUEST_TIME + LIMIT - 1e-6)
    assert bench.client.answers == []
    bench.pass_time(2e-6)
    assert bench.client.answers == ["83 0B"]
    assert isinstance(bench.events[0], RequestTimeout)
    assert (bench.events[0].limit_ms, bench.events[0].elapsed_ms) == (round(LIMIT * 1000, 1),) * 2
    assert (bench.counts.bad_frame, bench.counts.timeout) == (0, 1)


@pytest.mark.parametrize(
    "heard",
    [
        pytest.param("01 03 02 01 10 B8 19", id="wrong CRC"),
        pytest.param("01 03 02 01", id="cut"),
        pytest.param("55 55 55", id="noise"),
        pytest.param("01 03 02 10" + "AA" * 600, id="babble of 600 bytes"),
    ],
)
def test_rubbish_is_answered_0b_when_the_limit_has_passed(bench: Bench, heard: str) -> None:
    bench.ask()
    bench.hear(heard)
    bench.pass_time(0.3)
    assert bench.client.answers == ["83 0B"]
    assert isinstance(bench.events[0], BadFrame)
    assert (bench.counts.bad_frame, bench.counts.timeout) == (1, 0)
    assert bench.events[0].heard.startswith(heard[:8].strip())


@pytest.mark.parametrize(
    "other",
    [
        pytest.param(frame(0x4D, "03 02 DE AD"), id="another unit"),
        pytest.param(frame(1, "04 02 01 10"), id="another function"),
        pytest.param(frame(1, "03 04 01 10 01 10"), id="another size"),
        pytest.param(frame(1, "84 02"), id="an exception to another function"),
        pytest.param(READ_FRAME, id="the request's own echo"),
    ],
)
def test_a_frame_that_is_not_the_answer_is_dropped_and_the_limit_keeps_running(bench: Bench, other: str) -> None:
    bench.ask()
    bench.hear(other)
    assert bench.client.answers == []
    bench.pass_time(0.06)
    bench.hear(RESPONSE_FRAME)
    assert bench.client.answers == [RESPONSE]


def test_a_foreign_frame_alone_is_told_and_ends_in_0b(bench: Bench) -> None:
    bench.ask()
    bench.hear(frame(0x4D, "03 02 DE AD"))
    bench.pass_time(0.3)
    assert bench.client.answers == ["83 0B"]
    assert bench.events[0] == ForeignFrame("hall-a", 1, "unit-1", 3, "4D 03 02 DE AD")
    assert bench.counts.foreign_frames == 1


@pytest.mark.parametrize(
    ("asked", "wrong"),
    [
        ("05 00 01 FF 00", "05 00 01 00 00"),
        ("06 00 01 00 07", "06 00 01 00 08"),
        ("0F 00 01 00 02 01 03", "0F 00 01 00 03"),
        ("10 00 01 00 01 02 00 07", "10 00 02 00 01"),
        ("16 00 01 00 F2 00 25", "16 00 01 00 F2 00 26"),
    ],
)
def test_a_write_is_not_confirmed_by_other_echoed_fields(bench: Bench, asked: str, wrong: str) -> None:
    bench.ask(asked)
    bench.hear(frame(1, wrong))
    bench.pass_time(0.3)
    assert bench.client.answers == [f"{int(asked[:2], 16) | 0x80:02X} 0B"]


def test_an_exception_from_the_device_is_passed_on_at_once(bench: Bench) -> None:
    bench.ask()
    bench.hear("01 83 06 C1 32")
    assert bench.client.answers == ["83 06"]
    assert (bench.counts.responses, bench.counts.exception) == (1, 1)


@pytest.mark.parametrize("noise", ["00 FF", "01", "01 03", "01 83", READ_FRAME])
def test_noise_glued_before_the_response_does_not_lose_it(bench: Bench, noise: str) -> None:
    bench.ask()
    bench.hear(noise + RESPONSE_FRAME)
    assert bench.client.answers == [RESPONSE]


def test_noise_behind_a_response_does_not_reach_the_next_one(bench: Bench) -> None:
    bench.ask()
    bench.hear(RESPONSE_FRAME + "00 00 00")
    bench.ask("03 00 20 00 01")
    bench.pass_time(0.01)
    bench.hear(frame(1, "03 02 00 07"))
    assert bench.client.answers == [RESPONSE, "03 02 00 07"]


def test_a_second_copy_of_a_response_is_dropped(bench: Bench) -> None:
    bench.ask()
    bench.hear(RESPONSE_FRAME + RESPONSE_FRAME)
    assert bench.client.answers == [RESPONSE]


def test_a_hole_in_a_response_does_not_end_it(bench: Bench) -> None:
    bench.ask()
    bench.hear("01 03 02 01")
    bench.pass_time(0.12)
    bench.hear("10 B8 18")
    assert bench.client.answers == [RESPONSE]


def test_an_unknown_function_passes_and_silence_ends_its_response(bench: Bench) -> None:
    bench.ask("41 01 02")
    assert bench.written == ["01 41 01 02 D1 9D"]
    bench.hear("01 41 99 D0 3A")
    assert bench.client.answers == []
    bench.pass_time(TIMING.t35 + LATENCY + 1e-6)
    assert bench.client.answers == ["41 99"]


def test_a_broadcast_is_not_answered_and_a_turnaround_follows(bench: Bench) -> None:
    bench.broadcast("06 00 01 00 05")
    bench.ask()
    assert bench.client.answers == [None]
    bench.pass_time(REQUEST_TIME + 0.1 - 1e-6)
    assert bench.written == ["00 06 00 01 00 05 19 D8"]
    bench.pass_time(2e-6)
    assert bench.written[1:] == [READ_FRAME]


@pytest.mark.parametrize(
    ("unit", "pdu"), [(0, "06 00 10 00 01"), (1, "08 00 04 00 00")], ids=["broadcast", "unanswered"]
)
def test_a_port_that_is_lost_in_the_write_of_an_unanswered_request_ends_it_once(unit: int, pdu: str) -> None:
    bench = Bench()
    bench.line.port_up(lambda _: bench.unplug(), 0.0, bench.now)
    bench.pass_time(0.1)
    if unit:
        bench.ask(pdu, unit)
    else:
        bench.broadcast(pdu)
    assert bench.client.answers == [None]


def test_an_answer_to_a_broadcast_is_dropped(bench: Bench) -> None:
    bench.broadcast("06 00 01 00 05")
    bench.pass_time(0.01)
    bench.hear(frame(1, "06 00 01 00 05"))
    bench.ask()
    bench.pass_time(0.2)
    bench.hear(RESPONSE_FRAME)
    assert bench.client.answers == [None, RESPONSE]


LISTEN_ONLY = "08 00 04 00 00"


def test_listen_only_is_not_answered_and_a_turnaround_follows(bench: Bench) -> None:
    bench.ask(LISTEN_ONLY)
    bench.ask()
    assert bench.client.answers == [None]
    bench.pass_time(REQUEST_TIME + 0.1 - 1e-6)
    assert bench.written == [frame(1, LISTEN_ONLY)]
    bench.pass_time(2e-6)
    assert bench.written[1:] == [READ_FRAME]
    assert (bench.devices[1].counts[8], bench.events) == (Counts(ok=1, sent=1), [])


def test_a_unit_that_is_made_to_listen_only_does_not_rest_for_it(bench: Bench) -> None:
    for _ in range(10):
        bench.ask(LISTEN_ONLY)
        bench.pass_time(1.0)
    assert bench.client.answers == [None] * 10
    assert not bench.devices[1].is_resting(bench.now)


@pytest.mark.parametrize("said", [LISTEN_ONLY, "88 01"])
def test_a_unit_that_answers_listen_only_all_the_same_answers_no_other_question(bench: Bench, said: str) -> None:
    bench.ask(LISTEN_ONLY)
    bench.ask("08 00 00 12 34")
    assert bench.client.answers == [None, "88 0B"]
    bench.pass_time(0.2)
    bench.respond(said)
    bench.ask("08 00 00 12 34")
    bench.pass_time(0.1)
    bench.respond("08 00 00 12 34")
    assert bench.client.answers == [None, "88 0B", "08 00 00 12 34"]


def test_without_a_port_a_request_is_answered_0a_at_once(bench: Bench) -> None:
    bench.line.port_down(bench.now)
    bench.ask()
    assert bench.client.answers == ["83 0A"]
    assert bench.written == []


def test_a_lost_port_answers_0b_for_what_was_sent_and_0a_for_what_waits(bench: Bench) -> None:
    bench.ask()
    bench.ask("04 00 10 00 01")
    bench.line.port_down(bench.now)
    assert bench.client.answers == ["83 0B", "84 0A"]


def test_a_returned_port_serves_again(bench: Bench) -> None:
    bench.line.port_down(bench.now)
    bench.plug()
    bench.ask()
    bench.pass_time(0.01)
    bench.hear(RESPONSE_FRAME)
    assert bench.client.answers == [RESPONSE]


def test_a_full_queue_answers_06_and_says_so() -> None:
    bench = Bench(queue=2)
    for _ in range(4):
        bench.ask()
    assert bench.client.answers == ["83 06"]
    assert bench.events == [QueueFull("hall-a", 1, "unit-1", bench.client.caller.client)]


def test_who_has_most_waiting_in_a_full_queue_gets_06_for_its_newest_request() -> None:
    bench = Bench(queue=2)
    modest = Asker("10.0.0.7:1", host="10.0.0.7")
    for unit in (1, 2, 3):
        bench.ask(unit=unit)
    bench.ask(unit=4, client=modest)
    assert bench.client.answers == ["83 06"]
    assert bench.events == [QueueFull("hall-a", 3, "unit-3", bench.client.caller.client)]
    assert bench.devices[3].counts[3].queue_full == 1
    bench.respond(unit=1)
    bench.pass_time(0.01)
    bench.respond(unit=2)
    bench.pass_time(0.01)
    bench.respond(unit=4)
    assert modest.answers == [RESPONSE]


def test_a_request_that_waits_too_long_is_answered_06_and_never_sent() -> None:
    bench = Bench(max_wait=0.05)
    bench.ask()
    bench.ask("06 00 01 00 05")
    bench.pass_time(0.05)
    assert bench.client.answers == ["86 06"]
    bench.hear(RESPONSE_FRAME)
    bench.pass_time(1)
    assert bench.written == [READ_FRAME]


def test_requests_on_a_babbling_line_are_answered_06_in_time() -> None:
    bench = Bench(max_wait=0.05)
    bench.hear("55")
    bench.ask()
    for _ in range(60):
        bench.pass_time(0.001)
        bench.hear("55")
    assert bench.client.answers == ["83 06"]
    assert bench.written == []


def test_what_a_departed_client_asked_is_not_sent(bench: Bench) -> None:
    departed = Asker()
    bench.ask()
    bench.ask("06 00 01 00 05", client=departed)
    departed.gone = True
    bench.ask("03 00 20 00 01")
    bench.hear(RESPONSE_FRAME)
    bench.pass_time(0.01)
    assert bench.written == [READ_FRAME, frame(1, "03 00 20 00 01")]


def test_departed_clients_make_room_in_a_full_queue() -> None:
    bench = Bench(queue=1)
    departed = Asker()
    bench.ask()
    bench.ask(client=departed)
    departed.gone = True
    bench.ask("03 00 20 00 01")
    assert bench.client.answers == []


def test_an_ascii_line_needs_no_silence_and_finds_its_response() -> None:
    timing = LineTiming("ascii", 9600, CharacterFormat.parse("7E1"))
    bench = Bench(timing=timing)
    bench.ask(unit=2)
    bench.ask(unit=2)
    assert bytes.fromhex(bench.written[0]) == b":020300100001EA\r\n"
    response = frame(2, "03 02 02 10", ascii_framing.encode)
    bench.hear(response)
    bench.hear(response)
    assert bench.client.answers == ["03 02 02 10"] * 2


def test_a_foreign_ascii_frame_is_dropped_as_it_comes() -> None:
    timing = LineTiming("ascii", 9600, CharacterFormat.parse("7E1"))
    bench = Bench(timing=timing)
    bench.ask(unit=2)
    bench.hear(frame(3, "03 02 02 10", ascii_framing.encode))
    bench.hear(frame(2, "03 02 02 10", ascii_framing.encode))
    assert bench.client.answers == ["03 02 02 10"]
    assert bench.counts.foreign_frames == 1


def test_the_repr_is_a_status_line(bench: Bench) -> None:
    assert repr(bench.line) == "<Line hall-a idle waiting=0>"
    bench.ask()
    bench.ask()
    assert repr(bench.line) == "<Line hall-a awaiting <Transaction unit-1 unit=1 03 00 10 00 01> waiting=1>"
    bench.line.port_down(bench.now)
    assert repr(bench.line) == "<Line hall-a down waiting=0>"
    assert repr(bench.device()) == "<Device unit-1 unit=1 as=1>"


@pytest.mark.parametrize("pdu", ["00", "83 00 00 00 01", READ[:-3]])
def test_a_request_that_its_device_cannot_have_never_reaches_the_line(bench: Bench, pdu: str) -> None:
    bench.ask(pdu)
    assert len(bench.client.answers) == 1
    assert bench.written == []


# --- several frames at once ---


@pytest.mark.parametrize("chunks", [[2 * RESPONSE_FRAME], 2 * [RESPONSE_FRAME]], ids=["together", "apart"])
def test_a_second_response_is_dropped_and_counted_as_one(bench: Bench, chunks: list[str]) -> None:
    bench.ask()
    for chunk in chunks:
        bench.hear(chunk)
    assert bench.client.answers == [RESPONSE]
    assert (bench.counts.responses, bench.counts.foreign_frames) == (1, 0)
    assert bench.line.attribution.overheard.second_responses == {1: 1}
    assert bench.line.unasked_bytes == len(bytes.fromhex(RESPONSE_FRAME))


@pytest.mark.parametrize("timing", [TIMING, ASCII], ids=["rtu", "ascii"])
def test_the_next_client_does_not_get_the_second_copy_of_a_response(timing: LineTiming) -> None:
    """With no gap its request goes out between the two copies; but both came before it."""
    bench = Bench(timing=timing, gap=0.0)
    second = Asker("10.0.0.10:1")
    bench.ask()
    bench.ask(OTHER, client=second)
    bench.hear(2 * bench.frame(1, RESPONSE))
    assert bench.written == [bench.frame(1, READ), bench.frame(1, OTHER)]
    assert (bench.client.answers, second.answers) == ([RESPONSE], [])
    assert bench.line.attribution.overheard.second_responses == {1: 1}
    bench.respond("03 02 00 07")
    assert second.answers == ["03 02 00 07"]


def test_an_exception_behind_the_response_is_not_the_next_requests(bench: Bench) -> None:
    bench.ask()
    bench.hear(RESPONSE_FRAME + "01 83 06 C1 32")
    bench.ask(OTHER)
    bench.pass_time(0.01)
    assert bench.client.answers == [RESPONSE]
    assert bench.counts.exception == 0


def test_an_exception_inside_the_data_of_a_response_is_data() -> None:
    data = "03 06 01 83 02 C0 F1 00"
    for size in (1, 3, 11):
        bench = Bench()
        bench.ask("03 00 10 00 03")
        whole = bytes.fromhex(frame(1, data))
        for at in range(0, len(whole), size):
            bench.hear(whole[at : at + size].hex())
        assert bench.client.answers == [data]


# --- what ends by silence ---


def test_a_response_of_an_unknown_function_may_end_a_little_after_the_limit(bench: Bench) -> None:
    """Its size is not foretold, so its limit has no time for it on the wire."""
    bench.ask("41 01 02")
    whole = frame(1, "41 99 98 97 96 95")
    bench.pass_time(6 * TIMING.character + 0.2 + LATENCY - 0.001)
    bench.hear(whole[:12])
    bench.pass_time(0.002)
    bench.hear(whole[12:])
    bench.pass_time(TIMING.t35 + LATENCY - 1e-6)
    assert bench.client.answers == []
    bench.pass_time(2e-6)
    assert bench.client.answers == ["41 99 98 97 96 95"]
    assert bench.counts.timeout == bench.counts.bad_frame == 0


def test_a_cut_response_of_an_unknown_function_does_not_go_on_behind_a_silence(bench: Bench) -> None:
    bench.ask("41 01 02")
    cut = bytes.fromhex("01 41 0F 9B")
    whole = with_crc(cut + bytes.fromhex(frame(2, RESPONSE)))
    bench.hear(cut.hex())
    bench.pass_time(0.05)
    bench.hear(whole[len(cut) :].hex())
    bench.pass_time(0.5)
    assert bench.client.answers == ["C1 0B"]


def test_babble_does_not_put_off_the_limit_of_an_unknown_function_for_ever(bench: Bench) -> None:
    bench.ask("41 01 02")
    began = bench.now
    while not bench.client.answers and bench.now < began + 5:
        bench.hear("55")
        bench.pass_time(0.001)
    assert bench.client.answers == ["C1 0B"]
    assert bench.now - began < 0.2 + TIMING.longest_frame + 0.02
    assert bench.counts.bad_frame == 1


# --- silences ---


def test_noise_does_not_end_the_turnaround_after_a_broadcast_early(bench: Bench) -> None:
    bench.broadcast(WRITE)
    bench.ask()
    bench.pass_time(0.01)
    bench.hear("55")
    bench.pass_time(REQUEST_TIME + 0.1 - 0.01 - 1e-6)
    assert len(bench.written) == 1
    bench.pass_time(2e-6)
    assert len(bench.written) == 2


def test_a_change_of_rate_does_not_end_the_turnaround_after_a_broadcast_early() -> None:
    bench = Bench(turnaround=0.3)
    bench.broadcast(WRITE)
    bench.ask()
    bench.pass_time(0.05)
    bench.line.change_rate(9600, bench.now)  # as a late answer says
    bench.pass_time(REQUEST_TIME + 0.3 - 0.05 - 1e-6)
    assert len(bench.written) == 1
    bench.pass_time(2e-6)
    assert len(bench.written) == 2


@pytest.mark.parametrize("is_busy", [False, True])
def test_the_pause_of_a_change_of_rate_begins_when_nothing_is_on_the_line(bench: Bench, is_busy: bool) -> None:
    if is_busy:
        bench.ask(unit=2)
    bench.line.change_rate(9600, bench.now)
    if is_busy:
        bench.pass_time(RATE_CHANGE_PAUSE - 0.01)
        bench.respond(unit=2)
    bench.ask()
    bench.pass_time(RATE_CHANGE_PAUSE - 0.001)
    assert READ_FRAME not in bench.written
    bench.pass_time(0.002)
    assert READ_FRAME in bench.written


def test_noise_at_the_end_of_a_turnaround_puts_the_next_request_off(bench: Bench) -> None:
    bench.broadcast(WRITE)
    bench.ask()
    bench.pass_time(REQUEST_TIME + 0.1 - 1e-4)
    bench.hear("55")
    bench.pass_time(TIMING.t35 - 1e-6)
    assert len(bench.written) == 1
    bench.pass_time(2e-6)
    assert len(bench.written) == 2


def test_without_a_turnaround_the_silence_before_a_request_is_kept_behind_a_broadcast() -> None:
    bench = Bench(turnaround=0.0)
    bench.broadcast(WRITE)
    bench.ask()
    bench.pass_time(REQUEST_TIME + TIMING.t35 - 1e-6)
    assert len(bench.written) == 1
    bench.pass_time(2e-6)
    assert len(bench.written) == 2


def test_the_first_request_waits_for_the_silence_after_the_port_has_opened(bench: Bench) -> None:
    bench.unplug()
    bench.plug()
    bench.ask()
    bench.pass_time(TIMING.t35 - 1e-6)
    assert bench.written == []
    bench.pass_time(2e-6)
    assert bench.written == [READ_FRAME]


def test_a_gap_longer_than_the_limit_is_kept_after_a_time_out() -> None:
    bench = Bench(gap=0.5)
    bench.ask()
    bench.ask(unit=2)
    bench.pass_time(REQUEST_TIME + 0.5 - 1e-6)
    assert bench.client.answers == ["83 0B"]
    assert len(bench.written) == 1
    bench.pass_time(2e-6)
    assert len(bench.written) == 2


def test_unasked_frames_are_dropped_and_counted(bench: Bench) -> None:
    bench.hear(RESPONSE_FRAME)
    bench.ask()
    bench.pass_time(0.01)
    assert bench.client.answers == []
    assert bench.line.unasked_bytes == 7


# --- retries ---


def broken_frame(bench: Bench) -> None:
    """Instead of the response, until the limit has run out."""
    bench.hear(bench.frame(1, RESPONSE)[:-2] + "00")
    bench.pass_time(REQUEST_TIME + LIMIT + 1e-3)


def test_a_read_is_sent_again_at_once_after_a_broken_frame() -> None:
    bench = Bench(retries=1)
    bench.ask()
    bench.ask(WRITE, client=Asker("10.0.0.10:1"))
    broken_frame(bench)
    assert bench.written == [READ_FRAME, READ_FRAME]
    bench.respond()
    assert bench.client.answers == [RESPONSE]
    assert (bench.counts.retries, bench.counts.sent, bench.counts.bad_frame, bench.counts.responses) == (1, 2, 0, 1)
    assert bench.events == []


def test_what_a_device_is_may_be_asked_again_too() -> None:
    bench = Bench(retries=1)
    bench.ask("2B 0E 01 00")
    bench.hear(bench.frame(1, "2B 0E 01 81 00 00 00")[:-2] + "00")
    bench.pass_time(0.4)
    assert bench.written == [bench.frame(1, "2B 0E 01 00")] * 2


def test_it_is_sent_again_so_many_times_and_no_more() -> None:
    bench = Bench(retries=2)
    bench.ask()
    for _ in range(3):
        broken_frame(bench)
    assert bench.client.answers == ["83 0B"]
    assert bench.written == [READ_FRAME] * 3
    assert (bench.counts.retries, bench.counts.bad_frame) == (2, 1)


@pytest.mark.parametrize("pdu", [WRITE, "17 00 01 00 01 00 64 00 01 02 00 00", "41 01", "08 00 00 12 34"])
def test_what_may_change_something_is_never_sent_again(pdu: str) -> None:
    bench = Bench(retries=3)
    bench.ask(pdu)
    bench.hear("55")
    bench.pass_time(1.0)
    assert len(bench.client.answers) == 1
    assert bench.written == [frame(1, pdu)]


def test_what_nobody_wants_any_more_is_not_sent_again() -> None:
    bench = Bench(retries=3)
    bench.ask()
    bench.client.gone = True
    broken_frame(bench)
    assert bench.written == [READ_FRAME]


def test_who_leaves_before_the_second_sending_changes_nothing() -> None:
    """It was on the line, so what may still come of it matters."""
    bench = Bench(retries=1, gap=0.5)
    bench.ask()
    bench.hear("55")
    bench.pass_time(0.3)
    bench.client.gone = True
    bench.pass_time(0.5)
    assert bench.written == [READ_FRAME, READ_FRAME]


def test_the_silence_before_a_request_is_kept_before_a_second_sending_too() -> None:
    bench = Bench(retries=1, gap=0.5)
    bench.ask()
    bench.ask(unit=2)
    bench.pass_time(0.1)
    bench.hear("55")
    bench.pass_time(0.5 - 1e-6)
    assert bench.written == [READ_FRAME]
    bench.pass_time(2e-6)
    assert bench.written == [READ_FRAME, READ_FRAME]


def test_the_time_that_a_repeated_read_takes_the_line_counts_once() -> None:
    bench = Bench(retries=1, gap=0.01)
    bench.ask()
    bench.pass_time(REQUEST_TIME + LIMIT - 0.001)
    bench.hear("55")
    bench.pass_time(0.002)
    bench.hear("55")
    assert bench.client.answers == ["83 0B"]
    phases = bench.line.phases(bench.now)
    assert phases.request + phases.wait == pytest.approx(REQUEST_TIME + LIMIT, abs=0.002)
    assert phases.gap <= bench.settings.gap


def test_nor_does_it_count_twice_before_the_second_sending() -> None:
    bench = Bench(retries=1, gap=0.5)
    bench.ask()
    bench.hear("55")
    bench.pass_time(REQUEST_TIME + LIMIT + 0.1)
    phases = bench.line.phases(bench.now)
    assert phases.request + phases.wait == pytest.approx(REQUEST_TIME + LIMIT)


def test_a_line_that_stays_loud_is_given_up_without_a_second_sending() -> None:
    bench = Bench(retries=1, gap=0.5)
    bench.ask()
    bench.hear("55")
    bench.pass_time(0.3)
    bench.hear("55")
    assert bench.client.answers == ["83 0B"]
    bench.respond()
    assert bench.counts.late_responses == 1
    bench.pass_time(5.0)
    assert bench.written == [READ_FRAME]
    assert is_empty(bench.line)


def test_what_comes_behind_a_damaged_response_may_be_another_one() -> None:
    """Before the second sending: so its late window opens."""
    bench = Bench(retries=1, gap=0.5)
    bench.ask()
    bench.pass_time(REQUEST_TIME + 0.01)
    bench.hear(RESPONSE_FRAME[:-2] + "00")
    bench.pass_time(0.1)
    assert bench.line.ledger.count_late(bench.now) == 0
    bench.hear("55")
    assert bench.client.answers == ["83 0B"]
    assert bench.line.ledger.count_late(bench.now) == 1


def test_what_comes_when_the_line_should_be_quiet_is_no_answer_to_what_is_sent_next(bench: Bench) -> None:
    """The driver wakes a little late: the silence is over, and something comes before the second sending."""
    bench = Bench(retries=1, gap=0.05)
    bench.ask()
    bench.ask("04 00 10 00 01")
    bench.pass_time(REQUEST_TIME + LIMIT - 0.02)
    bench.hear("55 55")
    while bench.line._state != "repeating":
        bench.now = bench.line.deadline()
        bench.line.tick(bench.now)
    bench.now = bench.line._quiet_at + 0.001
    bench.respond("04 02 DE AD")
    assert bench.client.answers == ["83 0B"]
    assert bench.written == [READ_FRAME]
    bench.pass_time(0.05 + 1e-6)
    assert bench.written[1:] == [frame(1, "04 00 10 00 01")]


def test_what_comes_before_a_second_sending_does_not_end_the_pause_of_a_change_of_rate() -> None:
    bench = Bench(retries=1, gap=0.01)
    bench.ask()
    bench.ask(unit=2)
    bench.pass_time(REQUEST_TIME + LIMIT - 0.001)
    bench.hear("55")
    bench.pass_time(0.002)
    assert bench.line._state == "repeating"
    bench.line.change_rate(9600, bench.now)
    bench.hear("55")
    bench.pass_time(RATE_CHANGE_PAUSE - 1e-6)
    assert bench.written == [READ_FRAME]
    bench.pass_time(2e-6)
    assert bench.written[1:] == [frame(2, READ)]


def test_a_request_that_comes_before_a_second_sending_does_not_bring_it_on() -> None:
    """The driver wakes a little late: the second sending is a matter of that."""
    bench = Bench(retries=1, gap=0.01)
    bench.ask()
    bench.pass_time(REQUEST_TIME + LIMIT - 0.001)
    bench.hear("55")
    bench.pass_time(0.002)
    assert bench.line._state == "repeating"
    bench.now = bench.line._quiet_at + 0.001
    bench.ask(unit=2)
    assert bench.written == [READ_FRAME]
    bench.hear(RESPONSE_FRAME)
    assert bench.client.answers == ["83 0B"]


def test_a_request_that_waits_behind_a_second_sending_expires_in_time() -> None:
    bench = Bench(retries=1, gap=5.0, max_wait=1.0)
    bench.pass_time(5.0)
    bench.ask()
    second = Asker("10.0.0.10:1")
    bench.ask(unit=2, client=second)
    bench.hear("55")
    bench.pass_time(1.0)
    assert second.answers == ["83 06"]


def test_a_port_lost_before_the_second_sending_is_0b_because_it_was_sent() -> None:
    bench = Bench(retries=1, gap=0.5)
    bench.ask()
    bench.ask(unit=2)
    bench.hear("55")
    bench.pass_time(0.3)
    bench.unplug()
    assert bench.client.answers == ["83 0B", "83 0A"]
    assert is_empty(bench.line)


# --- order, sharing and refusals as the line sees them ---


@pytest.mark.parametrize("is_repeating", [False, True])
def test_a_line_that_finishes_waits_for_its_response_only_while_that_may_come(is_repeating: bool) -> None:
    bench = Bench(retries=1, gap=0.5)
    bench.ask()
    bench.ask(unit=2)
    bench.hear("55")
    bench.pass_time(REQUEST_TIME + LIMIT + 0.1 if is_repeating else 0.1)
    bench.line.finish(bench.now)
    bench.respond()
    assert bench.client.answers == (["83 0B", "83 0A"] if is_repeating else ["83 0A", RESPONSE])


def test_equal_reads_that_wait_share_one_transaction_and_all_are_answered(bench: Bench) -> None:
    clients = [Asker(f"10.0.0.{number}:1") for number in range(5)]
    bench.ask()
    for client in clients:
        bench.ask(client=client)
    bench.respond("03 02 00 01")
    bench.pass_time(0.01)
    assert bench.written == [READ_FRAME, READ_FRAME]
    assert [client.answers for client in clients] == [[]] * 5
    bench.respond("03 02 00 02")
    assert bench.client.answers == ["03 02 00 01"]
    assert [client.answers for client in clients] == [["03 02 00 02"]] * 5


def test_all_who_share_fail_together(bench: Bench) -> None:
    clients = [Asker(f"10.0.0.{number}:1") for number in range(3)]
    bench.ask(unit=2)
    for client in clients:
        bench.ask(client=client)
    bench.respond(unit=2)
    bench.pass_time(1.0)
    assert [client.answers for client in clients] == [["83 0B"]] * 3


def test_a_shared_read_is_sent_as_long_as_one_client_wants_it(bench: Bench) -> None:
    gone, stays = Asker("10.0.0.1:1"), Asker("10.0.0.2:1")
    bench.ask(unit=2)
    bench.ask(client=gone)
    bench.ask(client=stays)
    gone.gone = True
    bench.respond(unit=2)
    bench.pass_time(0.01)
    bench.respond()
    assert stays.answers == [RESPONSE]


def test_a_request_that_its_device_refuses_when_its_turn_comes_is_not_sent(bench: Bench) -> None:
    quirky = Profile("weigher", quirks=frozenset({"moves"}))
    addresses = UnitAddresses()
    addresses.place("another", 5)
    bench.devices[1] = MovableDevice(
        bench.device(profile=quirky).settings, bench.line, line_name="", line_source="", addresses=addresses,
        is_alone=False, remember=lambda *_: None, emit=bench.events.append,
    )  # fmt: skip
    bench.ask("10 01 00 00 01 02 00 05")
    assert bench.client.answers == ["90 03"]
    assert (bench.counts.sent, is_empty(bench.line)) == (0, True)


def test_everything_is_counted(bench: Bench) -> None:
    bench.ask()
    bench.pass_time(0.3)
    bench.respond()
    bench.ask("04 00 10 00 01", unit=2)
    bench.pass_time(0.01)
    bench.respond("84 02", unit=2)
    bench.broadcast(WRITE)
    assert bench.counts == Counts(sent=2, responses=1, exception=1, timeout=1, late_responses=1)
    bench.pass_time(1.0)
    assert bench.counts == Counts(sent=3, responses=1, exception=1, timeout=1, late_responses=1, broadcast=1)


def test_refusals_are_counted() -> None:
    bench = Bench(queue=1, max_wait=0.1)
    for _ in range(3):
        bench.ask()
    bench.pass_time(0.1)
    assert (bench.counts.queue_full, bench.counts.expired) == (1, 1)
    assert bench.client.answers == ["83 06", "83 06"]


def test_noise_beside_a_response_is_counted(bench: Bench) -> None:
    bench.ask()
    bench.hear("55" + RESPONSE_FRAME)
    bench.pass_time(0.01)
    bench.ask()
    bench.hear(RESPONSE_FRAME)
    assert (bench.counts.noise, bench.counts.responses, bench.counts.foreign_frames) == (1, 2, 0)


def test_a_foreign_frame_before_the_response_is_told_and_is_no_noise(bench: Bench) -> None:
    bench.ask()
    bench.hear(frame(9, "03 02 DE AD") + RESPONSE_FRAME)
    assert bench.client.answers == [RESPONSE]
    assert (bench.counts.noise, bench.counts.foreign_frames) == (0, 1)
    assert bench.told(ForeignFrame)[0].frame == "09 03 02 DE AD"


def test_an_observer_sees_each_transaction_with_its_answer_and_when(bench: Bench) -> None:
    seen = []
    bench.line.observer = lambda transaction, answer, now: seen.append((transaction.unit, answer, now))
    bench.ask()
    bench.respond()
    bench.pass_time(0.01)
    bench.ask(unit=2)
    bench.pass_time(1.0)
    assert [(unit, answer and answer.pdu.hex(" ").upper()) for unit, answer, _ in seen] == [(1, RESPONSE), (2, None)]
    assert seen[0][2] == 101.0
