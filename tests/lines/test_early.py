"""Answers that come before their requests can have left: stale ones now and then, or a device that has no wire."""

import pytest

from gateway.events import AnswerTooEarly, BadFrame, EchoHeard, RequestTimeout
from gateway.lines.echo import EARLY_ANSWERS, ECHOES
from gateway.timing.characters import LineTiming
from kit.line_bench import ASCII, READ, RESPONSE, TIMING, Bench

WRITE = "06 00 01 00 05"
#: A rest and late windows are over after so many seconds.
LATER = 100.0


@pytest.fixture(params=[TIMING, ASCII], ids=["rtu", "ascii"])
def real(request: pytest.FixtureRequest) -> Bench:
    """A real serial port."""
    return Bench(virtual=False, timing=request.param, source="a.toml:3")


def hear_early(bench: Bench, pdu: str = READ, response: str = RESPONSE) -> None:
    """The device answers a millisecond after it was asked: no wire carries a request so soon."""
    bench.ask(pdu)
    bench.pass_time(0.001)
    bench.respond(response)
    bench.pass_time(LATER)


def test_an_answer_that_comes_too_early_is_none(real: Bench) -> None:
    hear_early(real)
    assert real.client.answers == ["83 0B"]
    assert (real.counts.early_responses, real.counts.timeout, real.counts.bad_frame) == (1, 1, 0)


def test_one_that_came_too_early_is_no_broken_frame(real: Bench) -> None:
    hear_early(real)
    assert real.told(BadFrame) == []
    assert len(real.told(RequestTimeout)) == 1


def test_several_in_a_row_are_told_once_with_what_to_do(real: Bench) -> None:
    for _ in range(EARLY_ANSWERS - 1):
        hear_early(real)
    assert real.told(AnswerTooEarly) == []
    for _ in range(3):
        hear_early(real)
    (told,) = real.told(AnswerTooEarly)
    assert (told.line, told.unit, told.device, told.function, told.source) == ("hall-a", 1, "unit-1", 3, "a.toml:3")
    assert 'wire = "direct"' in told.advice
    assert (real.told(BadFrame), real.told(EchoHeard)) == ([], [])


def test_those_of_different_units_are_counted_together(real: Bench) -> None:
    for unit in range(1, EARLY_ANSWERS + 1):
        real.ask(unit=unit)
        real.respond(unit=unit)
        real.pass_time(LATER)
    assert len(real.told(AnswerTooEarly)) == 1


def test_silence_between_them_proves_nothing(real: Bench) -> None:
    for _ in range(EARLY_ANSWERS):
        hear_early(real)
        real.asks(unit=2)
        real.pass_time(LATER)
    assert len(real.told(AnswerTooEarly)) == 1


def test_one_that_comes_in_time_proves_the_wire(real: Bench) -> None:
    """The early ones were stale, or another client's."""
    for _ in range(2 * EARLY_ANSWERS):
        hear_early(real)
        hear_early(real)
        real.ask()
        real.pass_time(0.05)
        real.respond()
        real.pass_time(1.0)
    assert real.told(AnswerTooEarly) == []


def test_one_that_begins_early_and_ends_in_time_is_early_too(real: Bench) -> None:
    real.ask()
    answer = bytes.fromhex(real.frame(1, RESPONSE))
    real.hear(answer[:4].hex())
    real.pass_time(0.05)
    real.hear(answer[4:].hex())
    real.pass_time(1.0)
    assert real.counts.early_responses == 1


def test_noise_beside_it_does_not_hide_it(real: Bench) -> None:
    real.ask()
    real.hear("00" + real.frame(1, RESPONSE))
    real.pass_time(1.0)
    assert real.counts.early_responses == 1


@pytest.mark.parametrize(
    ("unit", "pdu"), [(2, RESPONSE), (1, "04 02 01 10"), (1, "03 04 01 10 01 10")], ids=["unit", "function", "size"]
)
def test_what_would_be_no_answer_in_time_is_none_too_early(real: Bench, unit: int, pdu: str) -> None:
    real.ask()
    real.respond(pdu, unit)
    real.pass_time(1.0)
    assert real.counts.early_responses == 0
    assert len(real.told(BadFrame)) == 1


def test_nor_does_noise_make_one_of_a_damaged_response_in_time(real: Bench) -> None:
    real.ask()
    real.hear("55")
    real.pass_time(0.1)
    real.line.received(bytes.fromhex(real.frame(1, RESPONSE)), real.now, damaged=True)
    real.pass_time(1.0)
    assert real.counts.early_responses == 0
    assert len(real.told(BadFrame)) == 1


def test_an_answer_before_its_announced_echo_is_a_matter_of_the_echo() -> None:
    announced = Bench(virtual=False, echo=True)
    hear_early(announced)
    assert announced.counts.early_responses == 0
    assert len(announced.told(BadFrame)) == 1


def test_one_whose_echo_is_lost_is_none() -> None:
    announced = Bench(connection=True, echo=True)
    announced.ask()
    announced.arrives = False
    announced.respond()
    announced.arrives = True
    announced.pass_time(1.0)
    assert announced.counts.early_responses == 0
    assert len(announced.told(BadFrame)) == 1


# --- writes, whose answer is a copy of them: early, it may as well be an echo ---


def test_the_copy_of_a_write_may_be_either_and_both_are_named(real: Bench) -> None:
    hear_early(real, WRITE, WRITE)
    (broken,), (echo,) = real.told(BadFrame), real.told(EchoHeard)
    for advice in (broken.reason, echo.advice):
        assert "echo = true" in advice
        assert 'wire = "direct"' in advice


def test_the_copy_of_a_read_is_an_echo(real: Bench) -> None:
    hear_early(real, READ, READ)
    (broken,), (echo,) = real.told(BadFrame), real.told(EchoHeard)
    for advice in (broken.reason, echo.advice):
        assert "echo = true" in advice
        assert "wire" not in advice


def test_where_answers_come_too_early_a_copy_is_one_too(real: Bench) -> None:
    for _ in range(EARLY_ANSWERS):
        hear_early(real)
    for _ in range(ECHOES + 1):
        hear_early(real, WRITE, WRITE)
    assert (real.told(EchoHeard), real.told(BadFrame)) == ([], [])
    assert real.client.answers[-1] == "86 0B"
    assert real.counts.early_responses == EARLY_ANSWERS + ECHOES + 1


def test_where_answers_come_too_early_the_copy_of_a_read_is_none(real: Bench) -> None:
    for _ in range(EARLY_ANSWERS):
        hear_early(real)
    hear_early(real, READ, READ)
    assert real.counts.early_responses == EARLY_ANSWERS


def test_an_echo_is_still_told_when_answers_come_in_time_again(real: Bench) -> None:
    for _ in range(EARLY_ANSWERS):
        hear_early(real)
    real.ask()
    real.pass_time(0.05)
    real.respond()
    real.pass_time(1.0)
    hear_early(real, WRITE, WRITE)
    assert len(real.told(EchoHeard)) == 1


# --- a line without a wire ---


@pytest.mark.parametrize("timing", [TIMING, ASCII], ids=["rtu", "ascii"])
@pytest.mark.parametrize(("pdu", "response"), [(READ, RESPONSE), (WRITE, WRITE)])
def test_on_a_direct_port_an_answer_comes_when_it_likes(timing: LineTiming, pdu: str, response: str) -> None:
    bench = Bench(timing=timing)
    for _ in range(ECHOES + 1):
        hear_early(bench, pdu, response)
    assert bench.client.answers == [response] * (ECHOES + 1)
    assert bench.events == []
