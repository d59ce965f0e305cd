"""What began before it could be the answer is not: early bytes, echoes, and what stands inside of an answer."""

import pytest

from gateway.events import ForeignFrame, LateResponse, OtherClientHeard
from kit.line_bench import ASCII, LIMIT, READ_FRAME, REQUEST_TIME, RESPONSE, RESPONSE_FRAME, TIMING, Bench

WRITE = "06 00 01 00 07"
#: Of a function that nobody knows: only silence ends the answer.
OWN = "41 01"


@pytest.fixture(params=[TIMING, ASCII], ids=["rtu", "ascii"])
def timing(request):
    return request.param


def request_frame(bench: Bench) -> str:
    return bench.written[-1]


def test_an_early_answer_behind_a_copy_of_the_request_is_none(timing) -> None:
    bench = Bench(virtual=False, timing=timing)
    bench.ask()
    bench.hear(request_frame(bench) + bench.frame(1, RESPONSE))
    bench.pass_time(2.0)
    assert bench.client.answers == ["83 0B"]


def test_nor_one_that_comes_before_the_request_has_arrived(timing) -> None:
    bench = Bench(connection=True, timing=timing)
    bench.arrives = False
    bench.ask()
    bench.hear(request_frame(bench) + bench.frame(1, RESPONSE))
    bench.pass_time(2.0)
    assert bench.client.answers == ["83 0B"]


def test_an_echo_that_comes_before_the_request_has_arrived_is_not_ours(timing) -> None:
    bench = Bench(connection=True, echo=True, timing=timing)
    bench.arrives = False
    bench.ask()
    bench.hear(request_frame(bench) + bench.frame(1, RESPONSE))
    bench.pass_time(2.0)
    assert bench.client.answers == ["83 0B"]


@pytest.mark.parametrize("noise", ["", "00"])
def test_a_write_is_not_confirmed_by_its_echo_behind_an_older_one(timing, noise: str) -> None:
    bench = Bench(connection=True, echo=True, timing=timing)
    bench.arrives = False
    bench.ask(WRITE)
    bench.hear(request_frame(bench))
    bench.arrives = True
    bench.pass_time(0.01)
    bench.hear(noise + request_frame(bench))
    bench.pass_time(2.0)
    assert bench.client.answers == ["86 0B"]


def test_an_exception_inside_an_answer_of_unknown_size_is_its_data() -> None:
    bench = Bench()
    bench.ask(OWN)
    exception = bench.frame(1, "C1 04")
    bench.pass_time(0.02)
    answer = f"41 02 {exception} 09 09"
    bench.respond(answer)
    bench.pass_time(2.0)
    assert bench.client.answers == [answer]


def test_an_echo_without_an_answer_is_no_other_clients_request(timing) -> None:
    bench = Bench(echo=True, timing=timing)
    bench.ask()
    bench.pass_time(0.01)
    bench.hear(request_frame(bench))
    bench.pass_time(REQUEST_TIME + LIMIT + 0.1)
    bench.respond()
    bench.pass_time(0.05)
    bench.ask()
    bench.pass_time(0.01)
    bench.hear(request_frame(bench) + bench.frame(1, RESPONSE))
    assert bench.client.answers == ["83 0B", RESPONSE]
    assert len(bench.told(LateResponse)) == 1
    assert not bench.told(ForeignFrame)
    assert not bench.told(OtherClientHeard)


def test_behind_an_echo_and_half_an_answer_a_read_is_repeated_at_once() -> None:
    bench = Bench(echo=True, retries=1)
    bench.ask()
    bench.pass_time(0.01)
    bench.hear(READ_FRAME)
    bench.pass_time(0.01)
    bench.hear(RESPONSE_FRAME[:11])
    bench.pass_time(REQUEST_TIME + LIMIT)
    assert bench.written == [READ_FRAME, READ_FRAME]


def test_behind_an_echo_and_a_lost_port_the_answer_is_late(timing) -> None:
    bench = Bench(echo=True, timing=timing)
    bench.ask()
    bench.pass_time(0.01)
    bench.hear(request_frame(bench))
    bench.unplug()
    bench.pass_time(0.05)
    bench.plug()
    bench.pass_time(0.02)
    bench.respond()
    assert len(bench.told(LateResponse)) == 1


def test_the_late_answer_behind_a_lost_echo_closes_its_window(timing) -> None:
    bench = Bench(echo=True, timing=timing)
    bench.ask()
    bench.pass_time(REQUEST_TIME + LIMIT + 0.1)
    bench.respond()
    bench.pass_time(0.05)
    bench.ask()
    assert len(bench.told(LateResponse)) == 1
    assert len(bench.written) == 2


def test_a_damaged_answer_behind_an_early_copy_may_be_another_clients() -> None:
    """So its own answer is awaited, and nothing is sent before that is over."""
    bench = Bench(virtual=False, retries=1)
    bench.ask()
    bench.hear(READ_FRAME)
    bench.pass_time(REQUEST_TIME + 0.002)
    bench.hear(RESPONSE_FRAME[:-2] + "00")
    bench.pass_time(0.1)
    assert len(bench.written) == 1
