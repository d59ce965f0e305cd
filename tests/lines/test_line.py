"""What a line tells of itself; what it does stands in tests/stories/lines."""

import pytest

from kit.line_bench import RESPONSE, Bench


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_a_line_is_quiet_when_its_silence_is_over(bench: Bench) -> None:
    bench.ask()
    bench.pass_time(0.01)
    bench.respond()
    until = bench.now + bench.settings.silence_before_request
    assert not bench.line.can_send(until - 1e-6)
    assert bench.line.can_send(until)


def test_the_repr_is_a_status_line(bench: Bench) -> None:
    assert repr(bench.line) == "<Line hall-a idle waiting=0>"
    bench.ask()
    bench.ask()
    assert repr(bench.line) == "<Line hall-a awaiting <Transaction unit-1 unit=1 03 00 10 00 01> waiting=1>"
    bench.line.port_down(bench.now)
    assert repr(bench.line) == "<Line hall-a down waiting=0>"
    assert repr(bench.device()) == "<Device unit-1 unit=1 as=1>"


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
