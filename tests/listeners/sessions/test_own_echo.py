"""The gateway's own responses that the adapter of a server line echoes, without `echo = true`."""

from dataclasses import replace

import pytest

from gateway.events import EchoHeard
from gateway.lines.echo import ECHOES
from kit.server_bench import ASCII, LATENCY, RTU, ServerBench

READ = "03 00 00 00 02"
READ_RESPONSE = "03 04 45 9C 3D 51"
WRITE = "06 00 01 00 05"
BUSY = "86 06"
#: Their responses repeat them.
REPEATABLE = [WRITE, "05 00 01 FF 00", "08 00 00 12 34", "16 00 04 00 F2 00 25"]
#: Responses that no client can send.
PROOFS = [READ_RESPONSE, "0F 00 01 00 02", "10 00 01 00 02", "83 02"]
#: By how many seconds the adapter holds an echo back.
HELD_BACK = [0.0, 0.02, 0.5]


@pytest.fixture(params=[(RTU, False), (RTU, True), (ASCII, False), (ASCII, True)], ids=lambda p: f"{p[0].mode}-{p[1]}")
def bench(request: pytest.FixtureRequest) -> ServerBench:
    timing, virtual = request.param
    return ServerBench(timing, virtual=virtual)


@pytest.fixture(params=[RTU, ASCII], ids=["rtu", "ascii"])
def serial(request: pytest.FixtureRequest) -> ServerBench:
    return ServerBench(request.param, virtual=False)


@pytest.mark.parametrize("held_back", HELD_BACK)
@pytest.mark.parametrize("pdu", REPEATABLE)
def test_no_echo_writes_without_end(bench: ServerBench, pdu: str, held_back: float) -> None:
    """The exception that answers a doubtful request comes back too, and proves that the adapter echoes."""
    ask(bench, pdu, pdu)
    echo_all(bench, held_back)
    carried_out = len(bench.asked)
    assert carried_out <= ECHOES
    (told,) = bench.told(EchoHeard)
    assert (told.line, told.source) == ("panel", "a.toml:7")
    ask(bench, pdu, pdu)
    echo_all(bench, held_back)
    assert len(bench.asked) == carried_out + 1
    assert len(bench.told(EchoHeard)) == 1


@pytest.mark.parametrize("held_back", HELD_BACK)
@pytest.mark.parametrize("proof", PROOFS)
def test_the_echo_of_what_no_client_can_have_sent_proves_all_others(
    bench: ServerBench, proof: str, held_back: float
) -> None:
    ask(bench, READ, proof)
    echo_all(bench, held_back)
    assert (len(bench.asked), bench.counts.echoes) == (1, 1)
    for pdu in REPEATABLE:
        ask(bench, pdu, pdu)
        echo_all(bench, held_back)
    assert len(bench.asked) == 1 + len(REPEATABLE)
    assert len(bench.told(EchoHeard)) == 1


def test_the_proof_holds_until_such_a_response_does_not_come_back(bench: ServerBench) -> None:
    """The adapter was changed, or its echo was damaged."""
    ask(bench, READ, READ_RESPONSE)
    echo_all(bench, 0.02)
    ask(bench, READ, READ_RESPONSE)
    bench.pass_time(0.1)
    for _ in range(ECHOES):
        ask(bench, WRITE, WRITE)
        bench.pass_time(0.1)
    assert len(bench.asked) == 2 + ECHOES


def test_that_the_echo_of_a_write_does_not_come_back_says_nothing_against_the_proof(bench: ServerBench) -> None:
    """It may be damaged."""
    other = "06 00 01 00 06"
    ask(bench, READ, READ_RESPONSE)
    echo_all(bench, 0.02)
    ask(bench, WRITE, WRITE)
    bench.take_written()
    bench.pass_time(1.0)
    bench.take_written()
    ask(bench, other, other)
    echo_all(bench, 0.5)
    assert len(bench.asked) == 3


def test_an_echo_that_comes_before_any_request_can_writes_nothing_again(serial: ServerBench) -> None:
    for _ in range(2):
        ask(serial, WRITE, WRITE)
        serial.pass_time(0.005)
        serial.hear(serial.take_written()[0])
        serial.pass_time(1.0)
    assert (len(serial.asked), serial.counts.echoes, serial.take_written()) == (2, 2, [])
    assert len(serial.told(EchoHeard)) == 1


def test_an_echo_that_the_adapter_holds_back_for_its_latency_writes_nothing_again(serial: ServerBench) -> None:
    """Although by the rate a client could have sent it by then."""
    timing = replace(serial.settings.timing, baud=115200)
    bench = ServerBench(timing, virtual=False)
    assert timing.t35 + timing.frame(5) < LATENCY
    ask(bench, WRITE, WRITE)
    bench.pass_time(timing.frame(5) + LATENCY)
    bench.hear(bench.take_written()[0])
    bench.pass_time(1.0)
    assert (len(bench.asked), bench.counts.echoes, bench.take_written()) == (1, 1, [])


def test_an_echo_that_was_read_late_because_the_gateway_stood_still_writes_nothing_again(serial: ServerBench) -> None:
    """It may be the client's as well: that gets 06. If it was an echo, the echo of 06 proves it."""
    ask(serial, WRITE, WRITE)
    serial.pass_time(0.01)
    (written,) = serial.take_written()
    looked_at = serial.now
    serial.pass_time(0.4)
    serial.session.received(written, serial.now, since=looked_at)
    serial.pass_time(0.01)
    assert (len(serial.asked), serial.take_written()) == (1, [serial.frame(41, BUSY)])


# --- a client that repeats itself ---


def test_the_same_write_again_is_no_echo_when_a_client_can_have_sent_it(serial: ServerBench) -> None:
    timing = serial.settings.timing
    ask(serial, WRITE, WRITE)
    serial.pass_time(0.002 + LATENCY + 2 * timing.frame(5) + timing.t35)
    ask(serial, WRITE, WRITE)
    assert (len(serial.asked), serial.counts.echoes) == (2, 0)


@pytest.mark.parametrize("stood_still", [0.0, 0.002])
def test_on_a_direct_port_it_may_be_sent_at_once(stood_still: float) -> None:
    direct = ServerBench(virtual=True)
    ask(direct, WRITE, WRITE)
    direct.pass_time(direct.settings.timing.t35)
    assert len(direct.take_written()) == 1
    direct.now += stood_still
    direct.session.received(direct.frame(41, WRITE), direct.now, since=direct.now - stood_still)
    assert (len(direct.asked), direct.counts.echoes) == (2, 0)


@pytest.mark.parametrize("every", [0.03, 0.2, 1.0])
def test_a_client_that_does_nothing_else_is_asked_to_repeat_ever_more_rarely(bench: ServerBench, every: float) -> None:
    busy = [place for place in range(80) if is_busy(bench, every)]
    assert busy == [5, 16, 37, 78]
    assert (len(bench.asked), bench.counts.echoes, bench.told(EchoHeard)) == (80 - len(busy), 0, [])


def test_one_that_also_reads_is_never_asked_to(bench: ServerBench) -> None:
    for pdu in (*[WRITE] * ECHOES, READ) * 3:
        ask(bench, pdu, READ_RESPONSE if pdu == READ else pdu)
        bench.pass_time(0.03)
    assert len(bench.asked) == 3 * (ECHOES + 1)


def test_with_on_failure_silent_it_gets_no_response_instead(bench: ServerBench) -> None:
    silent = ServerBench(bench.settings.timing, virtual=bench.virtual, on_failure="silent")
    for _ in range(ECHOES + 1):
        ask(silent, WRITE, WRITE)
        silent.pass_time(0.03)
    assert (len(silent.asked), len(silent.take_written()), silent.session.is_idle) == (ECHOES, ECHOES, True)
    ask(silent, WRITE, WRITE)
    assert len(silent.asked) == ECHOES + 1


def test_a_port_that_was_opened_again_may_have_another_adapter(bench: ServerBench) -> None:
    for _ in range(2):
        assert [place for place in range(ECHOES + 1) if is_busy(bench, 0.03)] == [ECHOES]
        assert not is_busy(bench, 0.03)
        bench.session.port_down()
        bench.plug()


def test_what_came_back_before_a_port_was_opened_again_does_not_count(bench: ServerBench) -> None:
    for _ in range(2):
        assert not any(is_busy(bench, 0.03) for _ in range(ECHOES))
        bench.session.port_down()
        bench.plug()


def ask(bench: ServerBench, pdu: str, response: str) -> None:
    bench.at_once = bytes.fromhex(response)
    bench.ask(pdu)


def is_busy(bench: ServerBench, after: float) -> bool:
    """Whether a write is answered with 06. Returns so many seconds after the write."""
    ask(bench, WRITE, WRITE)
    bench.pass_time(after)
    (written,) = bench.take_written()
    return written == bench.frame(41, BUSY)


def echo_all(bench: ServerBench, held_back: float) -> None:
    """The adapter returns all that the gateway says, so many seconds after it has left. Nobody else speaks."""
    for _ in range(20):
        bench.pass_time(0.01)
        for written in bench.take_written():
            bench.pass_time(held_back)
            bench.hear(written)
    bench.pass_time(1.0)
