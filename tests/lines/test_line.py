"""One line's transactions: what goes out when, which response is accepted, and what a client gets instead of one."""

import pytest

from gateway.events import BadFrame, ForeignFrame, QueueFull, RequestTimeout
from gateway.modbus import ascii as ascii_framing
from gateway.modbus.chartime import CharacterFormat, LineTiming
from kit.asker import Asker
from kit.line_bench import LATENCY, READ, READ_FRAME, RESPONSE, RESPONSE_FRAME, TIMING, Bench, frame

REQUEST_TIME = 8 * TIMING.character
LIMIT = 0.2 + 7 * TIMING.character + LATENCY


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


def test_noise_on_the_idle_line_starts_the_silence_anew(bench: Bench) -> None:
    bench.hear("00")
    bench.ask()
    assert bench.written == []
    bench.pass_time(TIMING.t35 + 1e-6)
    assert bench.written == [READ_FRAME]
    assert bench.line.counts.unasked_bytes == 1


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
    assert bench.line.counts.broken == 1


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
    assert bench.events[0] == ForeignFrame("hall-a", 0x4D, "unit-1", 3, "4D 03 02 DE AD")
    assert bench.line.counts.foreign_frames == 1


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
    assert bench.line.counts.exceptions == 1


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


def test_an_answer_to_a_broadcast_is_dropped(bench: Bench) -> None:
    bench.broadcast("06 00 01 00 05")
    bench.pass_time(0.01)
    bench.hear(frame(1, "06 00 01 00 05"))
    bench.ask()
    bench.pass_time(0.2)
    bench.hear(RESPONSE_FRAME)
    assert bench.client.answers == [None, RESPONSE]


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
    assert bench.events == [QueueFull("hall-a", 1, "unit-1", bench.client.client)]


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
    assert bench.line.counts.foreign_frames == 1


def test_busy_says_whether_something_is_under_way(bench: Bench) -> None:
    assert not bench.line.busy
    bench.ask()
    assert bench.line.busy


def test_the_repr_is_a_status_line(bench: Bench) -> None:
    assert repr(bench.line) == "<Line hall-a idle waiting=0>"
    bench.ask()
    bench.ask()
    assert repr(bench.line) == "<Line hall-a <Transaction unit-1 unit=1 03 00 10 00 01> waiting=1>"
    bench.line.port_down(bench.now)
    assert repr(bench.line) == "<Line hall-a down waiting=0>"
    assert repr(bench.device()) == "<Device unit-1 unit=1 as=1>"


@pytest.mark.parametrize("pdu", ["00", "83 00 00 00 01", READ[:-3]])
def test_a_request_that_its_device_cannot_have_never_reaches_the_line(bench: Bench, pdu: str) -> None:
    bench.ask(pdu)
    assert len(bench.client.answers) == 1
    assert bench.written == []
