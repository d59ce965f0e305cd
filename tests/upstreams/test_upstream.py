"""Units behind another server: pipelined, each answer to its own request, in order for each client, bounded."""

import random

import pytest

from gateway import events
from gateway.errors import NotModbus
from gateway.lines.breaker import FAILURES
from gateway.modbus.mbap import encode
from gateway.upstreams import upstream as upstream_module
from gateway.upstreams.upstream import MAX_OUTSTANDING
from kit.asker import Asker
from kit.upstream_bench import READ, RESPONSE, TIMEOUT, WRITE, UpstreamBench


def clients(count: int) -> list[Asker]:
    return [Asker(f"10.0.0.{number}:1") for number in range(count)]


# --- one request ---


def test_a_request_goes_out_at_once_with_the_unit_behind_the_server() -> None:
    bench = UpstreamBench()
    bench.ask(unit=37)
    assert [(sent.unit, sent.pdu) for sent in bench.sent] == [(7, READ)]
    bench.respond()
    assert bench.client.answers == [RESPONSE]
    assert (bench.counts.sent, bench.counts.responses, bench.counts.ok) == (1, 1, 1)


def test_an_exception_is_passed_on() -> None:
    bench = UpstreamBench()
    bench.ask()
    bench.respond("83 06")
    assert bench.client.answers == ["83 06"]
    assert bench.counts.exception == 1


def test_an_unknown_function_is_passed_on_with_whatever_is_answered() -> None:
    bench = UpstreamBench()
    bench.ask("64 01 02")
    bench.respond("64 09 08 07")
    assert bench.client.answers == ["64 09 08 07"]


def test_a_malformed_request_is_not_sent() -> None:
    bench = UpstreamBench()
    bench.ask("03 00 10 00 00")
    bench.ask("80")
    assert bench.client.answers == ["83 03", "80 01"]
    assert bench.sent == []


@pytest.mark.parametrize("size", [1, 3, 7, 10_000])
def test_answers_may_come_in_pieces_and_several_at_once(size: int) -> None:
    bench = UpstreamBench(in_flight=200)
    askers = clients(200)
    for number, asker in enumerate(askers):
        bench.ask(f"03 00 {number:02X} 00 01", client=asker)
    stream = b"".join(
        encode(sent.transaction, 7, b"\x03\x02\x00" + bytes.fromhex(sent.pdu)[2:3]) for sent in bench.sent
    )
    for at in range(0, len(stream), size):
        bench.hear(stream[at : at + size])
    assert [asker.answers for asker in askers] == [[f"03 02 00 {number:02X}"] for number in range(200)]


# --- pipelining, order and bounds ---


def test_requests_do_not_wait_for_each_other_and_answers_may_overtake() -> None:
    bench = UpstreamBench()
    bench.ask("03 00 01 00 01", 37)
    bench.ask("03 00 02 00 01", 38)
    bench.respond("03 02 00 22", to=1)
    bench.respond("03 02 00 11", to=0)
    assert bench.client.answers == ["03 02 00 22", "03 02 00 11"]


def test_several_clients_ask_one_unit_at_the_same_time() -> None:
    bench = UpstreamBench()
    one, other = clients(2)
    bench.ask(client=one)
    bench.ask(client=other)
    assert len(bench.sent) == 2
    bench.respond("03 02 00 22", to=1)
    assert (one.answers, other.answers) == ([], ["03 02 00 22"])


def test_one_clients_requests_to_one_unit_keep_their_order() -> None:
    bench = UpstreamBench()
    for pdu in (WRITE, READ, "06 00 02 00 05"):
        bench.ask(pdu)
    bench.ask(unit=38)
    assert [(sent.unit, sent.pdu) for sent in bench.sent] == [(7, WRITE), (8, READ)]
    bench.respond(WRITE, to=0)
    assert [sent.pdu for sent in bench.sent[2:]] == [READ]
    bench.respond(to=2)
    assert bench.sent[3].pdu == "06 00 02 00 05"


def test_the_next_request_of_a_client_goes_when_the_one_before_has_failed() -> None:
    bench = UpstreamBench()
    bench.ask(WRITE)
    bench.ask(READ)
    bench.pass_time(TIMEOUT)
    assert bench.client.answers == ["86 0B"]
    assert [sent.pdu for sent in bench.sent] == [WRITE, READ]


def test_as_many_are_under_way_as_there_are_places_and_others_wait_their_turn() -> None:
    bench = UpstreamBench(in_flight=2, queue=2)
    askers = clients(5)
    for asker in askers:
        bench.ask(client=asker)
    assert len(bench.sent) == 2
    assert askers[4].answers == ["83 06"]
    assert bench.counts.queue_full == len(bench.told(events.QueueFull)) == 1
    bench.respond(to=1)
    assert len(bench.sent) == 3
    assert (askers[0].answers, askers[1].answers) == ([], [RESPONSE])


def test_who_waited_too_long_is_answered_06_and_never_sent() -> None:
    bench = UpstreamBench(in_flight=1, max_wait=0.2)
    one, other = clients(2)
    bench.ask(client=one)
    bench.ask(WRITE, client=other)
    bench.pass_time(0.2)
    assert (one.answers, other.answers) == ([], ["86 06"])
    bench.pass_time(5)
    assert len(bench.sent) == 1
    assert bench.counts.expired == 1


def test_what_a_departed_client_left_waiting_is_not_sent() -> None:
    bench = UpstreamBench(in_flight=1)
    one, other = clients(2)
    bench.ask(client=one)
    bench.ask(WRITE, client=other)
    other.gone = True
    bench.respond()
    assert len(bench.sent) == 1
    assert other.answers == ["86 06"]
    assert bench.counts.unwanted == 1


def test_an_answer_for_a_departed_client_is_still_its_answer() -> None:
    bench = UpstreamBench()
    bench.ask()
    bench.client.gone = True
    bench.respond()
    assert bench.told(events.ForeignFrame) == []


# --- no answer, late answers, wrong answers ---


def test_no_answer_is_0b_at_the_limit() -> None:
    bench = UpstreamBench()
    bench.ask()
    bench.pass_time(TIMEOUT - 1e-6)
    assert bench.client.answers == []
    bench.pass_time(1e-6)
    assert bench.client.answers == ["83 0B"]
    (told,) = bench.told(events.RequestTimeout)
    assert (told.line, told.unit, told.device, told.elapsed_ms, told.limit_ms) == ("plant-1", 7, "plant-1/37", 500, 500)


def test_each_request_has_a_limit_of_its_own() -> None:
    bench = UpstreamBench()
    bench.ask(unit=37)
    bench.pass_time(0.3)
    bench.ask(unit=38)
    bench.pass_time(0.2)
    assert bench.client.answers == ["83 0B"]
    bench.respond()
    assert bench.client.answers == ["83 0B", RESPONSE]


def test_a_late_answer_is_dropped_counted_and_told_and_never_given_to_the_next_request() -> None:
    bench = UpstreamBench()
    bench.ask()
    bench.pass_time(TIMEOUT)
    bench.ask()
    bench.pass_time(0.1)
    bench.respond("03 02 DE AD", to=0)
    assert bench.client.answers == ["83 0B"]
    (told,) = bench.told(events.LateResponse)
    assert told.elapsed_ms == 600
    assert bench.counts.late_responses == 1
    assert bench.upstream.overdue == 0
    bench.respond("03 02 00 01", to=1)
    assert bench.client.answers == ["83 0B", "03 02 00 01"]


@pytest.mark.search
def test_no_identifier_is_used_again_while_its_answer_may_come() -> None:
    bench = UpstreamBench()
    bench.ask(unit=38)
    bench.pass_time(TIMEOUT)
    slow = clients(2)[1]
    bench.ask(unit=39, client=slow)
    taken = {sent.transaction for sent in bench.sent}
    bench.now += 0.1
    used = set()
    for _ in range(0x10000):
        bench.ask()
        used.add(bench.sent[-1].transaction)
        bench.respond()
    assert len(used) == 0x10000 - 2
    assert not used & taken


@pytest.mark.parametrize(
    ("pdu", "unit"),
    [
        ("04 02 01 10", None),  # another function
        ("03 04 01 10 01 10", None),  # another size
        ("03 02 01 10", 8),  # another unit
        ("84 02", None),  # the exception of another function
        ("03", None),
    ],
)
def test_an_answer_that_does_not_fit_is_dropped_and_the_limit_keeps_running(pdu: str, unit: int | None) -> None:
    bench = UpstreamBench()
    bench.ask()
    bench.respond(pdu, unit=unit)
    assert bench.client.answers == []
    assert bench.counts.foreign_frames == len(bench.told(events.ForeignFrame)) == 1
    bench.pass_time(TIMEOUT)
    assert bench.client.answers == ["83 0B"]
    (told,) = bench.told(events.BadFrame)
    assert told.heard.endswith(pdu)
    assert bench.counts.bad_frame == 1
    assert bench.device(37).counts.last_error == "bad_frame"


@pytest.mark.parametrize("unit", [0x00, 0xFF])
def test_a_server_that_names_no_unit_is_believed_because_its_identifier_is_unique(unit: int) -> None:
    bench = UpstreamBench()
    bench.ask()
    bench.respond("04 02 01 10", unit=unit)
    assert bench.client.answers == []
    bench.respond(unit=unit)
    assert bench.client.answers == [RESPONSE]
    bench.ask()
    bench.pass_time(TIMEOUT)
    bench.respond(unit=unit)
    assert (bench.upstream.overdue, bench.counts.late_responses) == (0, 1)


def test_nobody_waits_for_an_answer_to_listen_only_and_one_that_comes_is_dropped() -> None:
    bench = UpstreamBench(in_flight=1)
    bench.ask("08 00 04 00 00")
    bench.ask()
    assert [sent.pdu for sent in bench.sent] == ["08 00 04 00 00", READ]
    bench.respond("88 01", to=0)
    bench.respond(to=1)
    assert bench.client.answers == [None, RESPONSE]
    assert (bench.counts.ok, bench.counts.sent, bench.upstream.overdue) == (2, 2, 0)


def test_the_right_answer_behind_a_wrong_one_counts() -> None:
    bench = UpstreamBench()
    bench.ask()
    bench.respond("03 04 01 10 01 10")
    bench.respond()
    assert bench.client.answers == [RESPONSE]
    bench.ask()
    bench.pass_time(TIMEOUT)
    assert len(bench.told(events.RequestTimeout)) == 1
    assert bench.told(events.BadFrame) == []


def test_a_write_is_only_confirmed_by_its_own_echo() -> None:
    bench = UpstreamBench()
    bench.ask(WRITE)
    bench.respond("06 00 01 00 06")
    assert bench.client.answers == []
    bench.respond(WRITE)
    assert bench.client.answers == [WRITE]


def test_an_answer_that_nobody_asked_for_is_dropped() -> None:
    bench = UpstreamBench()
    bench.hear(encode(4711, 7, bytes.fromhex(RESPONSE)))
    assert bench.upstream.unasked_frames == 1
    bench.ask()
    bench.respond()
    bench.respond()
    assert bench.client.answers == [RESPONSE]
    assert bench.upstream.unasked_frames == 2


def test_a_late_answer_that_does_not_fit_leaves_its_identifier_taken() -> None:
    bench = UpstreamBench()
    bench.ask()
    bench.pass_time(TIMEOUT)
    bench.respond("04 02 01 10", to=0)
    assert bench.counts.foreign_frames == 1
    bench.respond(to=0)
    assert bench.counts.late_responses == 1


@pytest.mark.parametrize("data", ["0001 0001 0004 07 03 00 00", "0001 0000 0001 07", "485454502F312E3120343030"])
def test_what_is_no_modbus_tcp_is_refused_after_what_was_answered_before(data: str) -> None:
    bench = UpstreamBench()
    one, other = clients(2)
    bench.ask(client=one)
    bench.ask(client=other)
    answer = encode(bench.sent[0].transaction, 7, bytes.fromhex(RESPONSE))
    with pytest.raises(NotModbus):
        bench.hear(answer + bytes.fromhex(data))
    assert one.answers == [RESPONSE]
    bench.upstream.port_down(bench.now)
    assert other.answers == ["83 0B"]


# --- the connection ---


def test_without_a_connection_requests_fail_at_once() -> None:
    bench = UpstreamBench()
    bench.upstream.port_down(bench.now)
    bench.ask()
    assert bench.client.answers == ["83 0A"]
    bench.connect()
    bench.ask()
    bench.respond()
    assert bench.client.answers == ["83 0A", RESPONSE]


def test_a_lost_connection_is_0b_for_what_was_under_way_and_0a_for_what_waited() -> None:
    bench = UpstreamBench(in_flight=1)
    one, other = clients(2)
    bench.ask(client=one)
    bench.ask(client=other)
    bench.upstream.port_down(bench.now)
    assert (one.answers, other.answers) == (["83 0B"], ["83 0A"])
    assert (bench.counts.line_lost, bench.counts.line_down) == (1, 1)
    assert bench.device(37).counts.last_error == "line_lost"
    assert bench.upstream.deadline() is None


def test_nothing_is_sent_again_on_the_next_connection() -> None:
    bench = UpstreamBench()
    bench.ask(WRITE)
    bench.upstream.port_down(bench.now)
    bench.connect()
    bench.pass_time(10)
    assert len(bench.sent) == 1
    assert bench.client.answers == ["86 0B"]


def test_half_an_answer_of_the_old_connection_does_not_spoil_the_new_one() -> None:
    bench = UpstreamBench()
    bench.ask()
    bench.hear(b"\x00\x01\x00")
    bench.upstream.port_down(bench.now)
    bench.connect()
    bench.ask()
    bench.respond()
    assert bench.client.answers == ["83 0B", RESPONSE]


def test_a_connection_that_ends_while_nothing_is_under_way_is_opened_for_the_next_request() -> None:
    bench = UpstreamBench()
    assert bench.hang_up()
    assert (bench.orders, bench.upstream.deadline()) == (0, None)
    bench.ask()
    bench.ask(unit=38)
    assert (bench.orders, bench.sent, bench.client.answers) == (1, [], [])
    bench.pass_time(TIMEOUT / 2)
    bench.connect()
    assert [each.unit for each in bench.sent] == [7, 8]
    bench.respond(to=0)
    assert bench.client.answers == [RESPONSE]
    assert not bench.upstream.is_closed


def test_a_request_waits_for_the_connection_as_long_as_for_a_response() -> None:
    bench = UpstreamBench()
    bench.hang_up()
    bench.ask()
    bench.pass_time(TIMEOUT / 2)
    bench.ask(unit=38)
    bench.pass_time(TIMEOUT / 2 - 1e-6)
    assert bench.client.answers == []
    bench.pass_time(2e-6)
    assert bench.client.answers == ["83 0A"]
    bench.pass_time(TIMEOUT / 2)
    assert bench.client.answers == ["83 0A"] * 2
    assert bench.upstream.is_closed


def test_a_connection_that_cannot_be_opened_again_is_down() -> None:
    bench = UpstreamBench()
    bench.hang_up()
    bench.ask()
    bench.upstream.port_down(bench.now)
    bench.ask()
    assert bench.client.answers == ["83 0A"] * 2


def test_a_connection_that_ends_with_a_request_under_way_is_lost() -> None:
    bench = UpstreamBench()
    bench.ask()
    assert not bench.hang_up()
    bench.ask(unit=38)
    assert bench.client.answers == ["83 0B", "83 0A"]


@pytest.mark.interpreted
def test_what_waits_when_a_connection_ends_has_it_opened_unless_it_would_wait_in_vain(monkeypatch) -> None:
    """Nothing more can be sent on it: too many answers are overdue."""
    for at_once in (False, True):
        monkeypatch.setattr(upstream_module, "MAX_OUTSTANDING", 1)
        bench = UpstreamBench()
        bench.ask()
        bench.pass_time(TIMEOUT)
        bench.ask(unit=38)
        assert bench.hang_up(at_once=at_once) == (not at_once)
        assert bench.orders == (not at_once)
        assert bench.client.answers == ["83 0B", *(["83 0A"] if at_once else [])]


def test_a_rest_and_no_late_answer_outlast_it() -> None:
    bench = UpstreamBench()
    for _ in range(FAILURES):
        bench.ask()
        bench.pass_time(TIMEOUT)
    bench.hang_up()
    assert bench.upstream.overdue == 0
    bench.ask()
    assert bench.client.answers == ["83 0B"] * (FAILURES + 1)
    bench.ask(unit=38)
    bench.connect()
    bench.ask()
    assert bench.client.answers == ["83 0B"] * (FAILURES + 2)


def test_a_connection_that_is_renewed_loses_what_is_under_way_and_keeps_what_waits() -> None:
    bench = UpstreamBench(in_flight=2)
    other = Asker("10.0.0.8:1")
    for unit, client in ((37, bench.client), (38, other), (39, other)):
        bench.ask(unit=unit, client=client)
        bench.pass_time(TIMEOUT / 4)
    bench.now += TIMEOUT / 4
    bench.upstream.renew(bench.now)
    assert (bench.client.answers, other.answers) == (["83 0B"], ["83 0B"])
    assert bench.counts.timeout == 1
    assert bench.counts.line_lost == 1
    assert bench.hang_up()
    assert bench.orders == 1
    bench.connect()
    bench.respond()
    assert other.answers == ["83 0B", RESPONSE]


def test_a_client_that_asks_again_from_within_its_answer_is_served() -> None:
    bench = UpstreamBench(in_flight=1)

    class Eager(Asker):
        def answer(self, request, pdu):
            super().answer(request, pdu)
            if len(self.answers) < 4:
                bench.ask(client=self)

    eager = Eager()
    bench.ask(client=eager)
    bench.respond()
    bench.pass_time(TIMEOUT)
    bench.upstream.port_down(bench.now)
    assert eager.answers == [RESPONSE, "83 0B", "83 0B", "83 0A"]


@pytest.mark.interpreted
def test_too_many_overdue_answers_ask_for_a_new_connection_once_nothing_is_under_way(monkeypatch) -> None:
    monkeypatch.setattr(upstream_module, "MAX_OUTSTANDING", 3)
    bench = UpstreamBench()
    for unit in (37, 38, 39):
        bench.ask(unit=unit)
    bench.pass_time(TIMEOUT - 0.1)
    bench.ask(unit=40)
    bench.pass_time(0.1)
    assert not bench.upstream.must_renew
    bench.ask(unit=41)
    assert len(bench.sent) == 4
    bench.respond()
    assert bench.upstream.must_renew
    bench.upstream.port_down(bench.now)
    assert not bench.upstream.must_renew
    assert bench.client.answers == ["83 0B"] * 3 + [RESPONSE, "83 0A"]
    assert MAX_OUTSTANDING < 0x8000


# --- resting units ---


def fail(bench: UpstreamBench, times: int, unit: int = 37) -> None:
    for _ in range(times):
        bench.ask(unit=unit)
        bench.pass_time(TIMEOUT)


def test_a_silent_unit_rests_and_others_go_on() -> None:
    bench = UpstreamBench()
    fail(bench, FAILURES)
    sent = len(bench.sent)
    bench.ask()
    assert bench.client.answers[-1] == "83 0B"
    assert len(bench.sent) == sent
    assert bench.counts.resting == len(bench.told(events.UnitResting)) == 1
    bench.ask(unit=38)
    bench.respond()
    assert bench.client.answers[-1] == RESPONSE


def test_a_unit_rests_from_its_turn_too() -> None:
    bench = UpstreamBench()
    fail(bench, FAILURES - 1)
    bench.ask()
    bench.ask()
    bench.pass_time(TIMEOUT)
    assert bench.client.answers == ["83 0B"] * 4
    assert len(bench.sent) == FAILURES


def test_failures_of_requests_that_were_under_way_together_count_once() -> None:
    bench = UpstreamBench()
    for asker in clients(10):
        bench.ask(client=asker)
    bench.pass_time(TIMEOUT)
    assert bench.told(events.UnitResting) == []
    assert bench.device(37).breaker.failures == 1


def test_a_unit_that_has_failed_is_asked_one_at_a_time_until_it_answers() -> None:
    bench = UpstreamBench()
    fail(bench, 1)
    for number, asker in enumerate(clients(4)):
        bench.ask(f"03 00 {number:02X} 00 01", client=asker)
    bench.ask(unit=38)
    assert [sent.unit for sent in bench.sent] == [7, 7, 8]
    bench.respond(to=1)
    assert [sent.unit for sent in bench.sent] == [7, 7, 8, 7, 7, 7]


def test_what_waits_for_a_unit_that_begins_to_rest_is_0b_at_once() -> None:
    bench = UpstreamBench()
    fail(bench, FAILURES - 1)
    askers = clients(4)
    for asker in askers:
        bench.ask(client=asker)
    bench.pass_time(TIMEOUT)
    assert [asker.answers for asker in askers] == [["83 0B"]] * 4
    assert len(bench.sent) == FAILURES


def test_a_late_answer_ends_the_rest() -> None:
    bench = UpstreamBench()
    fail(bench, FAILURES)
    bench.respond()
    assert len(bench.told(events.UnitRecovered)) == 1
    bench.ask()
    bench.respond()
    assert bench.client.answers[-1] == RESPONSE


def test_a_new_connection_ends_the_rest() -> None:
    bench = UpstreamBench()
    fail(bench, FAILURES)
    bench.upstream.port_down(bench.now)
    bench.connect()
    bench.ask()
    bench.respond()
    assert bench.client.answers[-1] == RESPONSE


def test_its_repr_is_a_line_of_status() -> None:
    bench = UpstreamBench()
    bench.ask()
    assert repr(bench.upstream) == "<Upstream plant-1 under way=1 waiting=0>"
    bench.upstream.port_down(bench.now)
    assert repr(bench.upstream) == "<Upstream plant-1 down waiting=0>"


# --- any traffic ---


class Witness(Asker):
    """Remembers which request was answered with what, and how many requests the server had got when it was made."""

    def __init__(self, client: str, bench: UpstreamBench) -> None:
        super().__init__(client)
        self.outcomes: list[tuple[int, str, str, int]] = []
        self._bench = bench
        self._sent_before: dict[int, int] = {}

    def ask(self, pdu: str, unit: int = 7, now: float = 0.0):
        request = super().ask(pdu, unit=unit, now=now)
        self._sent_before[id(request)] = len(self._bench.sent)
        return request

    def answer(self, request, pdu):
        super().answer(request, pdu)
        self.outcomes.append((request.unit, request.pdu.hex(" "), pdu.hex(), self._sent_before.pop(id(request))))


KEYS = [
    {"in_flight": 4},
    {"in_flight": 4, "retries": 2, "rest": 0.0},
    {"in_flight": 3, "retries": 1, "wake": 0.5, "coalesce": False},
    {"in_flight": 1, "gap": 0.02, "retries": 1, "wake": 1.0},
    {"in_flight": 2, "after_connect": 0.1, "rest": 0.0},
]


@pytest.mark.parametrize("keys", KEYS, ids=str)
@pytest.mark.parametrize("seed", range(8))
def test_whatever_the_server_does_each_request_gets_one_answer_and_only_its_own(seed: int, keys: dict) -> None:
    """Answers late, twice, never, out of order, with wrong units and shapes; values say which sending is answered.

    It asks for the same, from the same unit, and was sent after the client has asked.
    """
    chance = random.Random(seed)
    bench = UpstreamBench(queue=8, max_wait=0.4, **keys)
    askers = [Witness(f"10.0.0.{number}:1", bench) for number in range(6)]
    on_the_way: list[int] = []
    for _ in range(600):
        before = len(bench.sent)
        bench.ask(f"03 00 {chance.randrange(4):02X} 00 01", chance.choice([37, 38]), chance.choice(askers))
        for _ in range(chance.randrange(3)):
            on_the_way += range(before, before := len(bench.sent))
            if on_the_way:
                play(bench, chance, on_the_way)
        bench.pass_time(chance.choice([0, 0.01, 0.1, 0.3]))
        on_the_way += range(before, len(bench.sent))
        end_connection(bench, chance, on_the_way)
    bench.pass_time(10)
    assert (bench.upstream.under_way, bench.upstream.waiting) == (0, 0)
    assert not bench.upstream._sent._instead
    assert not bench.upstream._sent._asking
    outcomes = [outcome for asker in askers for outcome in asker.outcomes]
    assert len(outcomes) == 600
    good = [outcome for outcome in outcomes if not outcome[2].startswith("83")]
    assert len(good) > 50
    for unit, pdu, answer, sent_before in good:
        number = int(answer[4:], 16)
        assert number >= sent_before
        assert (bench.sent[number].unit, bench.sent[number].pdu) == (unit - 30, pdu.upper())


def end_connection(bench: UpstreamBench, chance: random.Random, on_the_way: list[int]) -> None:
    if chance.random() < 0.02:
        bench.upstream.port_down(bench.now)
    elif chance.random() < 0.02:
        bench.hang_up()
        bench.pass_time(chance.choice([0, 0.1, 1.0]))
    else:
        return
    on_the_way.clear()
    before = len(bench.sent)
    bench.connect()
    on_the_way += range(before, len(bench.sent))


def play(bench: UpstreamBench, chance: random.Random, on_the_way: list[int]) -> None:
    number = on_the_way.pop(chance.randrange(len(on_the_way)))
    request = bench.sent[number]
    pdu = b"\x03\x02" + number.to_bytes(2, "big")
    match chance.randrange(8):
        case 0:
            return
        case 1:
            on_the_way.append(number)
        case 2:
            bench.hear(encode(request.transaction, request.unit ^ 1, pdu))
        case 3:
            bench.hear(encode(request.transaction, request.unit, b"\x03\x04dead"))
    bench.hear(encode(request.transaction, request.unit, pdu))


@pytest.mark.parametrize("unit", [7, 9], ids=["late", "of another unit"])
def test_a_gap_passes_after_a_response_that_nobody_waits_for_too(unit: int) -> None:
    bench = UpstreamBench(gap=0.05, in_flight=1)
    bench.ask()
    bench.pass_time(TIMEOUT + 1.0)
    bench.respond(unit=unit)
    bench.ask("03 00 11 00 01")
    bench.pass_time(0.049)
    assert len(bench.sent) == 1
    bench.pass_time(0.002)
    assert len(bench.sent) == 2
