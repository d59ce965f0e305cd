"""The question of a scan waits for a line's idle time, and nobody waits for more than one of them."""

import pytest

from gateway.devices.device import ScannedUnit
from gateway.events import BadFrame, LateResponse, RequestTimeout, UnitResting
from gateway.lines.idle import OTHERS
from gateway.lines.transaction import ScanTransaction
from gateway.modbus.pdu import parse_request
from gateway.timing.budget import AnswerTime
from gateway.timing.table import TimingTable
from kit.asker import Asker
from kit.line_bench import LIMIT, READ, REQUEST_TIME, Bench, frame, is_empty

QUESTION = "03 00 00 00 01"
ANSWER = "03 02 00 07"


ANSWER_TIME = AnswerTime(TimingTable(), margin=1.0, timeout=0.2)


class Scanning(Bench):
    """A line, and somebody who scans it."""

    def scan(self, unit: int = 9, *, awaits_second: bool = True) -> tuple[ScanTransaction, Asker]:
        asker = Asker("control")
        request = asker.ask(QUESTION, unit=unit, now=self.now)
        asked = ScannedUnit(unit, ANSWER_TIME, lambda: self.now)
        question = ScanTransaction(
            request, parse_request(request.pdu), asked, awaits_second=awaits_second, patience=0.0
        )
        self.line.submit(question, self.now)
        return question, asker


def test_on_an_idle_line_it_goes_at_once_and_is_answered() -> None:
    bench = Scanning()
    _, asker = bench.scan()
    assert bench.written == [frame(9, QUESTION)]
    bench.pass_time(0.01)
    bench.respond(ANSWER, unit=9)
    assert asker.answers == ["03 02 00 07"]


def test_who_waits_goes_first_and_it_goes_when_nobody_does() -> None:
    bench = Scanning()
    bench.ask(unit=1)
    bench.ask(unit=2)
    bench.scan()
    for unit in (1, 2):
        bench.pass_time(0.01)
        bench.respond(unit=unit)
    bench.pass_time(0.01)
    assert bench.written == [frame(1, READ), frame(2, READ), frame(9, QUESTION)]


def test_it_takes_no_place_in_the_queue() -> None:
    bench = Scanning(queue=1)
    bench.ask(unit=1)
    bench.scan()
    bench.ask(unit=2)
    assert (len(bench.line.queue), bench.client.answers) == (1, [])


def test_silence_is_neither_told_nor_counted_and_no_unit_rests() -> None:
    bench = Scanning()
    for _ in range(4):
        question, asker = bench.scan(unit=9)
        bench.pass_time(2.0)
        assert asker.answers == ["83 0B"]
        assert question.device.breaker.failures == 0
    assert bench.told(RequestTimeout) == bench.told(UnitResting) == []
    assert is_empty(bench.line)


def test_rubbish_is_a_broken_response_and_the_frame_of_another_unit_is_none() -> None:
    bench = Scanning()
    question, _ = bench.scan(unit=9)
    bench.hear("09 03 FF 12")
    bench.pass_time(1.0)
    assert question.requests[0].error.result == "bad_frame"
    question, _ = bench.scan(unit=10)
    bench.respond(ANSWER, unit=4)
    bench.pass_time(1.0)
    assert question.requests[0].error.result == "timeout"
    assert bench.told(BadFrame) == []


def test_other_units_are_asked_while_its_late_window_is_open_and_the_same_function_too() -> None:
    bench = Scanning()
    bench.scan(unit=9)
    bench.pass_time(REQUEST_TIME + LIMIT + 0.003)
    bench.ask(unit=1)
    assert bench.written == [frame(9, QUESTION), frame(1, READ)]
    bench.pass_time(0.01)
    bench.respond(unit=1)
    assert bench.client.answers == ["03 02 01 10"]


def test_its_late_answer_is_heard_and_nobody_elses() -> None:
    bench = Scanning()
    question, _ = bench.scan(unit=9)
    heard = question.device.heard
    bench.pass_time(REQUEST_TIME + LIMIT + 0.003)
    assert heard == []
    bench.ask(unit=1)
    bench.pass_time(0.01)
    bench.respond(ANSWER, unit=9)
    bench.pass_time(0.01)
    bench.respond(unit=1)
    assert [(response.unit, seconds) for response, seconds in heard] == [(9, pytest.approx(LIMIT + 0.013))]
    assert bench.told(LateResponse) == []
    assert bench.client.answers == ["03 02 01 10"]


@pytest.mark.parametrize("awaits_second", [True, False])
def test_a_second_answer_is_heard_behind_the_first(awaits_second: bool) -> None:
    bench = Scanning()
    question, _ = bench.scan(unit=9, awaits_second=awaits_second)
    heard = question.device.heard
    for _ in range(2):
        bench.pass_time(0.01)
        bench.respond(ANSWER, unit=9)
    assert len(heard) == 1 + awaits_second


def test_a_second_answer_may_come_together_with_the_first() -> None:
    bench = Scanning()
    question, asker = bench.scan(unit=9)
    bench.hear(frame(9, ANSWER) + frame(9, "83 02"))
    assert [response.pdu.hex(" ") for response, _ in question.device.heard] == ["03 02 00 07", "83 02"]
    assert asker.answers == [ANSWER]


def test_a_unit_in_its_late_window_is_not_asked_again_before_that_ends() -> None:
    bench = Scanning()
    question, _ = bench.scan(unit=9)
    bench.pass_time(REQUEST_TIME + LIMIT + 0.003)
    bench.scan(unit=9)
    end = bench.line.ledger.end_of(question, question.fails_at)
    bench.pass_time(end - bench.now - 0.001)
    assert len(bench.written) == 1
    bench.pass_time(0.002)
    assert len(bench.written) == 2


@pytest.mark.parametrize("count", [3, 40])
def test_on_a_line_that_is_never_free_it_has_its_turn_and_nobody_waits_for_two(count: int) -> None:
    """Clients ask again as soon as they have a response; a scan does the same."""
    bench = Scanning()
    clients = {unit: Asker(f"10.0.0.{unit}:1") for unit in range(1, count + 1)}
    for unit, client in clients.items():
        bench.ask(unit=unit, client=client)
    scanned, sent, worst = 100, 0, 0
    waited = dict.fromkeys(clients, 0)
    bench.scan(unit=scanned)
    while scanned < 110:
        bench.pass_time(0.01)
        assert sent < len(bench.written)
        unit, sent = int(bench.written[sent][:2], 16), sent + 1
        if unit in clients:
            worst = max(worst, waited[unit])
            waited[unit] = 0
            bench.respond(unit=unit)
            bench.ask(unit=unit, client=clients[unit])
        else:
            waited = {each: scans + 1 for each, scans in waited.items()}
            scanned += 1
            bench.pass_time(REQUEST_TIME + LIMIT - 0.01)
            bench.scan(unit=scanned)
    assert worst == 1
    assert min(len(client.answers) for client in clients.values()) >= 9 * OTHERS // count - 3


def test_on_a_line_that_is_never_free_it_goes_behind_so_many_others() -> None:
    bench = Scanning()
    for number in range(OTHERS + 5):
        bench.ask(unit=1, client=Asker(f"10.0.0.{number}:1"), pdu=f"03 00 10 00 {number + 1:02X}")
    bench.scan()
    for number in range(OTHERS + 2):
        bench.pass_time(0.01)
        bench.respond(f"03 {2 * number + 2:02X}" + (2 * number + 2) * " 00")
    assert bench.written.index(frame(9, QUESTION)) == 1 + OTHERS


def test_looking_often_is_no_turn_of_others() -> None:
    """While what waits must not be sent yet."""
    bench = Scanning()
    bench.ask(unit=1)
    bench.pass_time(REQUEST_TIME + 2 * LIMIT + 0.05)
    bench.ask(unit=1, client=Asker("10.0.0.7:1"))
    bench.scan(unit=9)
    for _ in range(2 * OTHERS):
        bench.line.tick(bench.now)
    assert bench.written == [frame(1, READ)]
    bench.pass_time(LIMIT)
    assert bench.written == [frame(1, READ), frame(1, READ)]


def test_a_read_that_is_to_be_repeated_goes_before_it() -> None:
    bench = Scanning(retries=1)
    bench.scan(unit=8)
    bench.pass_time(2.0)
    bench.ask(unit=1)
    bench.scan(unit=9)
    bench.pass_time(REQUEST_TIME + LIMIT + 0.003)
    other = Asker("10.0.0.7:1")
    for _ in range(2 * OTHERS):
        bench.ask(unit=2, client=other)
        bench.pass_time(0.001)
        bench.respond(unit=2)
        bench.ask(unit=2, client=other)
        bench.pass_time(0.004)
        bench.respond(unit=2)
    assert frame(9, QUESTION) not in bench.written
    bench.pass_time(2.0)
    mine = [adu for adu in bench.written if adu != frame(2, READ)]
    assert mine == [frame(8, QUESTION), frame(1, READ), frame(1, READ), frame(9, QUESTION)]


def test_a_late_answer_ends_what_it_waits_for() -> None:
    bench = Scanning()
    bench.scan(unit=9, awaits_second=False)
    bench.pass_time(REQUEST_TIME + LIMIT + 0.003)
    bench.scan(unit=9)
    bench.pass_time(0.01)
    bench.respond(ANSWER, unit=9)
    bench.pass_time(0.01)
    assert len(bench.written) == 2


def test_it_is_never_repeated() -> None:
    bench = Scanning(retries=3)
    bench.scan(unit=9)
    bench.pass_time(5.0)
    assert len(bench.written) == 1


def test_it_fails_with_its_line() -> None:
    bench = Scanning()
    bench.ask(unit=1)
    _, waiting = bench.scan()
    bench.unplug()
    assert waiting.answers == ["83 0A"]
    _, refused = bench.scan()
    assert refused.answers == ["83 0A"]


def test_a_second_question_takes_the_place_of_one_that_waits() -> None:
    bench = Scanning()
    bench.ask(unit=1)
    first, _ = bench.scan(unit=9)
    bench.scan(unit=10)
    assert first.requests[0].error.result == "unwanted"


def test_a_lone_device_is_asked_at_address_0_and_answers_from_its_own() -> None:
    bench = Scanning()
    question, asker = bench.scan(unit=0)
    bench.pass_time(0.01)
    bench.respond(ANSWER, unit=5)
    assert asker.answers == ["03 02 00 07"]
    assert question.answers_from is None


@pytest.mark.parametrize(("unit", "pdu"), [(0, ANSWER), (248, ANSWER), (5, "04 02 00 07")])
def test_it_may_answer_from_any_address_but_only_what_was_asked(unit: int, pdu: str) -> None:
    bench = Scanning()
    _, asker = bench.scan(unit=0)
    bench.pass_time(0.01)
    bench.respond(pdu, unit=unit)
    assert asker.answers == ([pdu] if pdu == ANSWER else [])


def test_on_a_line_whose_server_has_closed_the_connection_it_has_it_opened() -> None:
    opened = []
    bench = Scanning(connection=True)
    bench.line.port_ended(lambda: opened.append(bench.now), bench.now)
    bench.scan()
    assert opened == [bench.now]
    bench.pass_time(5.0)
    bench.plug()
    bench.pass_time(0.01)
    assert bench.written == [frame(9, QUESTION)]


def test_one_that_waits_when_the_connection_ends_has_it_opened_at_once() -> None:
    opened = []
    bench = Scanning(connection=True)
    bench.hear("55")
    bench.scan()
    bench.line.port_ended(lambda: opened.append(bench.now), bench.now)
    assert opened == [bench.now]
