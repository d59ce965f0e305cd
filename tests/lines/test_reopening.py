"""A connection that its server has closed: what is a loss, what waits for the next one, and for how long."""

import pytest

from kit.asker import Asker
from kit.line_bench import LIMIT, READ, READ_FRAME, RESPONSE, Bench, frame

#: Longer than nothing, shorter than a limit.
MOMENT = 0.05


class Closing(Bench):
    """`closed` is whether the line takes the end of its connection for no loss, `opened` how often it wants another."""

    def __init__(self, **settings: object) -> None:
        super().__init__(connection=True, **settings)
        self.opened = 0

    def hang_up(self, *, at_once: bool = False) -> bool:
        self.line.port_ended(self._open, self.now, at_once=at_once)
        return self.line.is_closed

    def _open(self) -> None:
        self.opened += 1


@pytest.fixture
def bench() -> Closing:
    return Closing()


def test_nobody_asks_so_nothing_is_opened(bench: Closing) -> None:
    assert bench.hang_up()
    bench.pass_time(3600.0)
    assert bench.opened == 0
    assert bench.line.deadline() is None


def test_the_first_request_has_it_opened_once_and_is_sent_when_it_is(bench: Closing) -> None:
    bench.hang_up()
    bench.ask()
    bench.ask("04 00 10 00 01")
    bench.pass_time(MOMENT)
    assert (bench.opened, bench.written, bench.client.answers) == (1, [], [])
    bench.plug()
    bench.pass_time(MOMENT)
    assert bench.written == [READ_FRAME]
    bench.respond()
    assert bench.client.answers == [RESPONSE]
    assert not bench.line.is_closed


def test_a_request_on_the_line_makes_it_a_loss(bench: Closing) -> None:
    bench.ask()
    assert not bench.hang_up()
    bench.unplug()
    assert bench.client.answers == ["83 0B"]
    assert not bench.hang_up()


def test_what_waits_for_silence_has_it_opened_at_once(bench: Closing) -> None:
    bench.pass_time(1.0)
    bench.hear("55")
    bench.ask()
    assert bench.written == []
    assert bench.hang_up()
    assert bench.opened == 1


def test_what_waits_for_a_server_that_closes_at_once_does_not_wait_in_vain(bench: Closing) -> None:
    bench.hear("55")
    bench.ask()
    assert not bench.hang_up(at_once=True)
    bench.unplug()
    assert bench.client.answers == ["83 0A"]
    assert bench.opened == 0


def test_a_server_that_closes_at_once_while_nobody_asks_is_no_loss(bench: Closing) -> None:
    bench.hear(frame(2, READ))  # another client
    assert bench.hang_up(at_once=True)
    assert bench.opened == 0


def test_each_request_waits_for_its_own_limit(bench: Closing) -> None:
    bench.hang_up()
    other = Asker("10.0.0.8:1")
    bench.ask()
    bench.pass_time(MOMENT)
    bench.ask(unit=2, client=other)
    bench.pass_time(LIMIT - MOMENT - 1e-6)
    assert bench.client.answers == []
    bench.pass_time(2e-6)
    assert (bench.client.answers, other.answers) == (["83 0A"], [])
    bench.pass_time(MOMENT - 2e-6)
    assert other.answers == []
    bench.pass_time(2e-6)
    assert other.answers == ["83 0A"]
    assert bench.line.is_closed
    assert bench.line.deadline() is None
    bench.ask()
    assert bench.opened == 1  # it is being opened


def test_no_longer_than_max_wait() -> None:
    bench = Closing(max_wait=MOMENT)
    bench.hang_up()
    bench.ask()
    bench.pass_time(MOMENT - 1e-6)
    assert bench.client.answers == []
    bench.pass_time(2e-6)
    assert bench.client.answers == ["83 0A"]


def test_one_that_cannot_be_opened_is_down(bench: Closing) -> None:
    bench.hang_up()
    bench.ask()
    bench.unplug()
    assert bench.client.answers == ["83 0A"]
    bench.ask()
    assert bench.client.answers == ["83 0A"] * 2
    assert not bench.line.is_closed


def test_one_that_was_closed_for_another_is_opened_at_once(bench: Closing) -> None:
    bench.line.renew(bench.now)
    assert bench.hang_up()
    assert bench.opened == 1


def test_while_another_client_may_be_there_the_line_goes_on_listening(bench: Closing) -> None:
    bench.hear(frame(2, READ))
    bench.pass_time(299.0)
    assert bench.hang_up()
    assert bench.opened == 1
    bench.plug()
    bench.pass_time(2.0)
    assert bench.hang_up()
    assert bench.opened == 1
