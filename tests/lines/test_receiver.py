"""What began before it could be the answer is not: early bytes, echoes, and what stands inside of an answer."""

import pytest

from gateway.devices.quirks import AddressZeroDevice
from gateway.events import BadFrame, ForeignFrame, LateResponse, OtherClientHeard
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


# --- what is told of it ---


def exchange(bench: Bench) -> None:
    """So that what follows does not begin at the first byte of the line."""
    bench.ask()
    bench.hear(request_frame(bench))
    bench.respond()
    bench.pass_time(0.05)


def test_a_broken_answer_is_shown_without_the_echo_before_it(timing) -> None:
    bench = Bench(echo=True, timing=timing)
    exchange(bench)
    bench.ask()
    bench.pass_time(0.01)
    bench.hear("AA " + request_frame(bench) + "55 66")
    bench.pass_time(2.0)
    assert [event.heard for event in bench.told(BadFrame)] == ["AA 55 66"]


def test_of_two_copies_the_first_is_the_echo_and_the_second_is_shown() -> None:
    bench = Bench(echo=True)
    exchange(bench)
    bench.ask()
    bench.pass_time(0.01)
    bench.hear(READ_FRAME + "AA" + READ_FRAME)
    bench.pass_time(2.0)
    assert [event.heard for event in bench.told(BadFrame)] == ["AA " + READ_FRAME]


def test_behind_its_echo_a_damaged_answer_is_known_at_once(timing) -> None:
    bench = Bench(echo=True, retries=1, timing=timing)
    exchange(bench)
    bench.ask()
    bench.pass_time(REQUEST_TIME + 0.02)
    bench.hear(request_frame(bench))
    damaged = bytearray.fromhex(bench.frame(1, RESPONSE))
    damaged[-3] ^= 1
    bench.hear(damaged.hex())
    bench.pass_time(0.03)
    assert len(bench.written) == 3


@pytest.mark.parametrize("more", ["before", "behind"])
def test_not_if_there_is_more_beside_its_echo(timing, more: str) -> None:
    bench = Bench(echo=True, retries=1, timing=timing)
    exchange(bench)
    bench.ask()
    bench.pass_time(REQUEST_TIME + 0.02)
    bench.hear("AA" * (more == "before") + request_frame(bench))
    damaged = bytearray.fromhex(bench.frame(1, RESPONSE))
    damaged[-3] ^= 1
    bench.hear("AA" * (more == "behind") + damaged.hex())
    bench.pass_time(0.03)
    assert len(bench.written) == 2


def test_a_damaged_frame_is_not_told_as_another_units(timing) -> None:
    bench = Bench(timing=timing)
    bench.ask()
    bench.line.received(bytes.fromhex(bench.frame(2, RESPONSE)), bench.now, damaged=True)
    bench.respond()
    assert bench.client.answers == [RESPONSE]
    assert not bench.told(ForeignFrame)
    assert bench.counts.noise == 1


@pytest.mark.parametrize(
    ("before", "noise"),
    [
        pytest.param([], 0, id="nothing"),
        pytest.param([(2, RESPONSE), (3, RESPONSE)], 0, id="frames of other units"),
        pytest.param([(2, RESPONSE), None, (3, RESPONSE)], 1, id="a byte between such frames"),
        pytest.param([(2, RESPONSE), None], 1, id="a byte behind them"),
        pytest.param([None, (2, RESPONSE)], 1, id="a byte before them"),
        pytest.param([None, None], 1, id="two bytes"),
    ],
)
def test_noise_is_what_is_no_part_of_a_frame(timing, before, noise: int) -> None:
    bench = Bench(timing=timing)
    bench.ask()
    bench.respond()
    bench.pass_time(0.05)
    bench.ask()
    for each in before:
        bench.hear("AA" if each is None else bench.frame(*each))
    bench.respond()
    assert bench.client.answers == [RESPONSE, RESPONSE]
    assert bench.counts.noise == noise


def test_of_two_other_clients_the_first_is_told(timing) -> None:
    bench = Bench(timing=timing)
    bench.respond("03 00 30 00 01")
    bench.respond("03 00 31 00 01")
    bench.pass_time(0.01)
    bench.ask()
    bench.pass_time(0.05)
    bench.respond()
    assert bench.told(OtherClientHeard) == [OtherClientHeard("hall-a", 1, "unit-1", "01 03 00 30 00 01")]


def test_while_another_client_waits_for_the_unit_at_address_0_nothing_is_repeated_at_once() -> None:
    """Any unit may be the one that has this address."""
    for foreign, sendings in ((False, 2), (True, 1)):
        bench = Bench(retries=1)
        bench.devices[0] = AddressZeroDevice(bench.device(unit=0).settings, bench.line)
        if foreign:
            bench.respond("03 00 30 00 01", unit=9)
            bench.pass_time(0.05)
        bench.ask(unit=0)
        bench.hear("55 AA")
        bench.pass_time(REQUEST_TIME + LIMIT + 0.001)
        assert len(bench.written) == sendings


# --- on the idle line ---


def test_who_responds_is_who_has_sent_the_last_bytes(timing) -> None:
    bench = Bench(timing=timing)
    bench.respond(unit=2)
    assert bench.line._receiver.responding({1, 3}, 0.0) == set()
    bench.respond()
    assert bench.line._receiver.responding({1, 2}, 0.0) == {1}
    bench.hear("55")
    assert bench.line._receiver.responding({1, 2}, 0.0) == set()
