"""What a server may need: a silence between requests, a connection that is left, limits of its own, few requests."""

import pytest

from gateway import events
from gateway.lines.breaker import FAILURES
from gateway.modbus import mbap
from kit.asker import Asker
from kit.upstream_bench import READ, RESPONSE, TIMEOUT, WRITE, UpstreamBench

OTHER_READ = "03 00 20 00 01"


def clients(count: int) -> list[Asker]:
    return [Asker(f"10.0.0.{number}:1") for number in range(count)]


# --- gap ---


def test_a_gap_passes_between_a_response_and_the_next_request() -> None:
    bench = UpstreamBench(in_flight=1, gap=0.05)
    bench.ask()
    bench.ask(unit=38)
    bench.pass_time(0.1)
    bench.respond()
    bench.pass_time(0.05 - 1e-6)
    assert len(bench.sent) == 1
    bench.pass_time(2e-6)
    assert [each.unit for each in bench.sent] == [7, 8]


def test_it_passes_before_a_request_that_comes_meanwhile() -> None:
    bench = UpstreamBench(in_flight=1, gap=0.05)
    bench.ask()
    bench.respond()
    bench.pass_time(0.02)
    bench.ask()
    assert len(bench.sent) == 1
    bench.pass_time(0.03 + 1e-6)
    assert len(bench.sent) == 2
    bench.respond()
    bench.pass_time(1)
    bench.ask()
    assert len(bench.sent) == 3


@pytest.mark.parametrize("keys", [{}, {"retries": 1}])
def test_it_passes_after_a_request_without_a_response_too(keys: dict) -> None:
    bench = UpstreamBench(in_flight=1, gap=0.05, **keys)
    bench.ask()
    bench.ask(WRITE, unit=38)
    bench.pass_time(TIMEOUT + 0.05 - 1e-6)
    assert len(bench.sent) == 1
    bench.pass_time(2e-6)
    assert [each.pdu for each in bench.sent] == [READ, READ if keys else WRITE]


@pytest.mark.parametrize("keys", [{"gap": 0.05}, {"transaction_id": "zero"}])
def test_who_never_ceases_to_send_is_not_listened_to_for_ever_before_a_request(keys: dict) -> None:
    bench = UpstreamBench(in_flight=1, **keys)
    looks = 0

    def look() -> None:
        nonlocal looks
        looks += 1
        bench.hear(mbap.encode(9999, 7, bytes.fromhex(RESPONSE)))

    bench.ask()
    bench.ask(unit=38)
    bench.upstream.port_up(bench._send, bench.now, look)
    bench.respond()
    bench.ask(unit=39)
    assert looks < 5


def test_it_passes_after_a_request_that_expects_none() -> None:
    bench = UpstreamBench(in_flight=1, gap=0.05)
    bench.ask("08 00 04 00 00")
    bench.ask()
    assert len(bench.sent) == 1
    bench.pass_time(0.05)
    assert len(bench.sent) == 2


# --- idle ---


def leaves_at(bench: UpstreamBench) -> float | None:
    """When the connection is closed, if nothing comes."""
    deadline = bench.upstream.deadline()
    return deadline if deadline is not None and bench.upstream.may_leave(deadline) else None


def test_a_connection_is_left_after_so_long_without_a_request() -> None:
    bench = UpstreamBench(idle=10.0)
    assert leaves_at(bench) == bench.now + 10
    bench.pass_time(4)
    bench.ask()
    assert leaves_at(bench) is None
    bench.pass_time(0.1)
    bench.respond()
    assert leaves_at(bench) == bench.now + 10
    bench.ask()
    bench.pass_time(TIMEOUT)
    assert leaves_at(bench) == bench.now + 10
    assert not bench.upstream.may_leave(bench.now + 9.9)


def test_it_is_kept_while_requests_wait() -> None:
    bench = UpstreamBench(idle=0.01, in_flight=1, gap=0.05)
    bench.ask()
    bench.ask()
    bench.respond()
    assert leaves_at(bench) is None
    bench.pass_time(0.05)
    assert len(bench.sent) == 2


def test_without_idle_it_is_kept() -> None:
    bench = UpstreamBench()
    assert bench.upstream.deadline() is None
    assert not bench.upstream.may_leave(1e9)


# --- after_connect ---


def test_the_silence_after_connecting_costs_no_waiting_request_its_time() -> None:
    """Neither that for the connection nor that for its turn."""
    for keys in ({}, {"max_wait": 0.2}):
        bench = UpstreamBench(after_connect=3.0, **keys)
        bench.hang_up()
        bench.ask()
        bound = 3.0 + keys.get("max_wait", TIMEOUT)
        bench.pass_time(bound - 0.001)
        assert bench.client.answers == []
        bench.connect()
        bench.respond()
        assert bench.client.answers == [RESPONSE]
        bench.hang_up()
        bench.ask()
        bench.pass_time(bound + 0.001)
        assert bench.client.answers == [RESPONSE, "83 0A"]


def test_it_costs_no_request_that_waited_before_either() -> None:
    bench = UpstreamBench(after_connect=3.0, in_flight=1)
    bench.ask(WRITE)
    bench.ask(unit=38)
    bench.pass_time(TIMEOUT / 2)
    bench.upstream.renew(bench.now)
    bench.hang_up()
    bench.pass_time(3.1)
    bench.connect()
    bench.respond()
    assert bench.client.answers == ["86 0B", RESPONSE]


def test_on_an_open_connection_nobody_waits_longer_for_it() -> None:
    bench = UpstreamBench(after_connect=3.0, in_flight=1, max_wait=0.2)
    bench.hang_up()
    bench.ask()
    bench.connect()
    bench.ask(unit=38)
    bench.pass_time(0.2)
    assert bench.client.answers == ["83 06"]


def test_nor_if_others_have_waited_for_the_connection() -> None:
    """Those wait no longer from then on either: 06 is due to all of them."""
    bench = UpstreamBench(after_connect=3.0, in_flight=1, max_wait=0.2)
    under_way, waiting, newcomer = clients(3)
    bench.hang_up()
    bench.ask(client=under_way)
    bench.ask(unit=38, client=waiting)
    bench.connect()
    bench.ask(unit=39, client=newcomer)
    bench.pass_time(0.2)
    assert [each.answers for each in (under_way, waiting, newcomer)] == [[], ["83 06"], ["83 06"]]


# --- coalesce ---


def test_equal_reads_of_several_clients_that_wait_are_one_request() -> None:
    bench = UpstreamBench(in_flight=1)
    first, *others = clients(5)
    bench.ask(OTHER_READ, client=first)
    for other in others:
        bench.ask(client=other)
    bench.respond()
    assert [each.pdu for each in bench.sent] == [OTHER_READ, READ]
    bench.respond()
    assert [other.answers for other in others] == [[RESPONSE]] * 4
    assert (bench.counts.sent, bench.counts.coalesced, bench.counts.ok) == (2, 3, 5)


def test_coalesce_false_sends_each() -> None:
    bench = UpstreamBench(in_flight=1, coalesce=False)
    for client in clients(3):
        bench.ask(client=client)
    bench.respond()
    bench.respond()
    assert len(bench.sent) == 3


def test_a_shared_read_keeps_the_order_of_each_of_its_clients() -> None:
    """The second one asks nothing else of the unit while the read that it shares is under way."""
    bench = UpstreamBench(in_flight=2)
    one, two, three = clients(3)
    bench.ask(OTHER_READ, client=three)
    bench.ask(OTHER_READ, unit=38, client=three)
    bench.ask(client=one)
    bench.ask(client=two)
    bench.respond(to=0)
    assert [each.pdu for each in bench.sent[2:]] == [READ]
    bench.respond(to=1)
    bench.ask(WRITE, client=two)
    bench.ask(WRITE, client=one)
    assert len(bench.sent) == 3
    bench.respond(to=2)
    assert [each.pdu for each in bench.sent[3:]] == [WRITE, WRITE]
    bench.respond(WRITE, to=3)
    bench.respond(WRITE, to=4)
    assert (one.answers, two.answers) == ([RESPONSE, WRITE], [RESPONSE, WRITE])


def test_a_shared_read_waits_for_what_any_of_its_clients_has_under_way() -> None:
    bench = UpstreamBench(in_flight=3)
    one, two, three = clients(3)
    for unit in (38, 39):
        bench.ask(OTHER_READ, unit=unit, client=three)
    bench.ask(WRITE, client=two)
    bench.ask(client=one)
    bench.ask(client=two)
    bench.respond(OTHER_READ, to=0)
    bench.respond(to=0)
    assert [each.pdu for each in bench.sent] == [OTHER_READ, OTHER_READ, WRITE]
    bench.respond(WRITE, to=2)
    assert bench.sent[-1].pdu == READ
    bench.respond()
    assert (one.answers, two.answers) == ([RESPONSE], [WRITE, RESPONSE])


def test_a_shared_read_that_fails_fails_for_all() -> None:
    bench = UpstreamBench(in_flight=1)
    first, *others = clients(3)
    bench.ask(OTHER_READ, client=first)
    for other in others:
        bench.ask(client=other)
    bench.respond()
    bench.pass_time(TIMEOUT)
    assert [other.answers for other in others] == [["83 0B"]] * 2
    assert bench.counts.timeout == 2


# --- retries and rest ---


@pytest.mark.parametrize("wrong", ["", "04 02 01 10"])
def test_a_read_without_a_valid_response_is_sent_again_at_once_with_another_identifier(wrong: str) -> None:
    bench = UpstreamBench(retries=2, in_flight=1)
    bench.ask()
    bench.ask(unit=38, client=Asker("10.0.0.8:1"))
    for number in (1, 2):
        if wrong:
            bench.respond(wrong)
        bench.pass_time(TIMEOUT)
        assert [each.unit for each in bench.sent] == [7] * (number + 1)
    assert len({each.transaction for each in bench.sent}) == 3
    assert bench.client.answers == []
    bench.respond()
    assert bench.client.answers == [RESPONSE]
    assert (bench.counts.sent, bench.counts.retries, bench.counts.ok, bench.counts.timeout) == (4, 2, 1, 0)
    assert bench.upstream.overdue == 2
    assert bench.told(events.RequestTimeout) == []


def test_each_sending_has_the_full_limit_and_then_it_is_0b() -> None:
    bench = UpstreamBench(retries=1)
    bench.ask()
    bench.pass_time(2 * TIMEOUT - 1e-6)
    assert bench.client.answers == []
    bench.pass_time(2e-6)
    assert bench.client.answers == ["83 0B"]
    assert len(bench.sent) == 2
    assert len(bench.told(events.RequestTimeout)) == 1


def test_a_write_is_never_sent_again() -> None:
    bench = UpstreamBench(retries=3)
    bench.ask(WRITE)
    bench.pass_time(5 * TIMEOUT)
    assert bench.client.answers == ["86 0B"]
    assert len(bench.sent) == 1


def test_what_nobody_waits_for_is_not_sent_again() -> None:
    bench = UpstreamBench(retries=1)
    bench.ask()
    bench.client.gone = True
    bench.pass_time(TIMEOUT)
    assert len(bench.sent) == 1


def test_nothing_is_sent_again_after_the_end_of_the_connection() -> None:
    for end in ("port_down", "finish", "renew"):
        bench = UpstreamBench(retries=1)
        bench.ask()
        getattr(bench.upstream, end)(bench.now)
        bench.pass_time(TIMEOUT)
        assert bench.client.answers == ["83 0B"]
        bench.connect()
        bench.pass_time(TIMEOUT)
        assert len(bench.sent) == 1


@pytest.mark.parametrize("keys", [{"retries": 1}, {"wake": 30.0}])
def test_a_repeat_that_waits_when_the_connection_is_lost_was_sent(keys: dict) -> None:
    bench = UpstreamBench(gap=0.05, in_flight=1, **keys)
    bench.ask()
    bench.ask(unit=38)
    bench.pass_time(TIMEOUT)
    bench.upstream.port_down(bench.now)
    assert bench.client.answers == ["83 0B", "83 0A"]


def test_a_late_response_to_the_first_sending_answers_a_read_that_is_sent_again() -> None:
    for keys in ({}, {"gap": 0.05, "in_flight": 1}):
        bench = UpstreamBench(retries=1, **keys)
        bench.ask()
        bench.pass_time(TIMEOUT + 0.01)
        bench.respond("03 02 00 01", to=0)
        assert bench.client.answers == ["03 02 00 01"]
        assert bench.upstream.overdue == len(bench.sent) - 1
        bench.pass_time(0.1)
        for sent in range(1, len(bench.sent)):
            bench.respond("03 02 00 02", to=sent)
        assert bench.client.answers == ["03 02 00 01"]
        assert len(bench.told(events.LateResponse)) == 1  # that its limit was too short
        assert (bench.upstream.under_way, bench.upstream.overdue, bench.upstream.waiting) == (0, 0, 0)


def test_it_answers_no_other_request() -> None:
    bench = UpstreamBench(retries=1)
    bench.ask()
    bench.pass_time(TIMEOUT)
    bench.respond(to=1)
    bench.ask()
    bench.respond("03 02 DE AD", to=0)
    assert bench.client.answers == [RESPONSE]


def test_a_request_is_one_failure_of_the_unit_however_often_it_is_sent() -> None:
    bench = UpstreamBench(retries=3)
    for number in range(1, FAILURES + 1):
        bench.ask()
        bench.pass_time(4 * TIMEOUT)
        assert bench.device(37).breaker.failures == number
    assert len(bench.sent) == 4 * FAILURES
    assert len(bench.told(events.UnitResting)) == 1
    assert bench.device(37).breaker.rest_left(bench.now) == pytest.approx(36 * TIMEOUT)


@pytest.mark.parametrize(("rest", "seconds"), [(0.0, 0.0), (2.0, 2.0), (None, 9 * TIMEOUT)])
def test_a_rest_is_as_long_as_the_config_says(rest: float | None, seconds: float) -> None:
    bench = UpstreamBench(rest=rest)
    for _ in range(FAILURES):
        bench.ask()
        bench.pass_time(TIMEOUT)
    assert bench.device(37).breaker.rest_left(bench.now) == pytest.approx(seconds)


# --- limits of their own ---


def test_a_request_with_a_shorter_limit_fails_first() -> None:
    bench = UpstreamBench()
    one, two, three = clients(3)
    for client, timeout, unit in ((one, 3.0, 37), (two, 1.0, 38), (three, 2.0, 39)):
        bench.timeout = timeout
        bench.ask(unit=unit, client=client)
    bench.pass_time(1.0)
    assert (one.answers, two.answers, three.answers) == ([], ["83 0B"], [])
    assert len(bench.upstream.awaited(bench.now)) == 2
    bench.pass_time(1.0)
    assert (one.answers, three.answers) == ([], ["83 0B"])
    bench.respond(to=0)
    assert one.answers == [RESPONSE]
    assert bench.upstream.deadline() is None


def test_who_waits_for_a_device_of_high_priority_is_first() -> None:
    bench = UpstreamBench(in_flight=1)
    bench.device(39).is_urgent = True
    for number, client in enumerate(clients(3)):
        bench.ask(unit=37 + number, client=client)
    bench.ask(WRITE, unit=38, client=Asker("10.0.0.8:1"))
    bench.respond()
    assert bench.sent[-1].unit == 9


def test_a_client_with_priority_is_first_and_then_each_of_the_others_is() -> None:
    bench = UpstreamBench(in_flight=1)
    prior = Asker("10.0.0.7:1", host="10.0.0.7")
    prior.caller = prior.caller.with_priority()
    for unit in (37, 38, 39):
        bench.ask(unit=unit, client=Asker(f"10.0.1.{unit}:1", host=f"10.0.1.{unit}"))
    bench.ask(WRITE, unit=41, client=Asker("10.0.0.8:1", host="10.0.0.8"))
    for unit in (42, 43):
        bench.ask(unit=unit, client=prior)
    units = []
    for _ in range(5):
        bench.respond(WRITE if bench.sent[-1].pdu == WRITE else RESPONSE)
        units.append(bench.sent[-1].unit + 30)
    assert units == [42, 41, 38, 39, 43]


# --- a device that sleeps ---


def test_the_first_read_of_a_device_that_may_sleep_is_sent_twice() -> None:
    bench = UpstreamBench(wake=30.0)
    bench.ask()
    bench.pass_time(TIMEOUT)
    assert len({each.transaction for each in bench.sent}) == 2
    bench.respond()
    assert bench.client.answers == [RESPONSE]
    assert (bench.counts.retries, bench.counts.sent, bench.counts.timeout) == (0, 2, 0)
    assert bench.device(37).breaker.failures == 0
    bench.pass_time(29.9)
    bench.ask()
    bench.pass_time(TIMEOUT)
    assert bench.client.answers == [RESPONSE, "83 0B"]
    assert bench.device(37).breaker.failures == 1
    bench.pass_time(30)
    bench.ask()
    bench.pass_time(TIMEOUT)
    assert len(bench.sent) == 5


def test_a_response_to_either_counts() -> None:
    bench = UpstreamBench(wake=30.0)
    bench.ask()
    bench.pass_time(TIMEOUT + 0.01)
    bench.respond("03 02 00 01", to=0)
    assert bench.client.answers == ["03 02 00 01"]
    assert bench.told(events.LateResponse) == []
    bench.ask()
    bench.respond("03 02 00 02", to=1)
    assert bench.client.answers == ["03 02 00 01"]
    bench.respond("03 02 00 03", to=2)
    assert bench.client.answers == ["03 02 00 01", "03 02 00 03"]


def test_a_write_wakes_it_once() -> None:
    bench = UpstreamBench(wake=30.0)
    bench.ask(WRITE)
    bench.pass_time(TIMEOUT)
    assert bench.client.answers == ["86 0B"]
    bench.ask()
    bench.pass_time(TIMEOUT)
    assert bench.client.answers == ["86 0B", "83 0B"]
    assert len(bench.sent) == 2


def test_it_may_be_repeated_besides() -> None:
    bench = UpstreamBench(wake=30.0, retries=1)
    bench.ask()
    bench.pass_time(3 * TIMEOUT)
    assert bench.client.answers == ["83 0B"]
    assert (len(bench.sent), bench.counts.retries) == (3, 1)
    assert bench.device(37).breaker.failures == 1


def test_a_device_that_never_wakes_rests_as_ever() -> None:
    bench = UpstreamBench(wake=0.1)
    for number in range(1, FAILURES + 1):
        bench.ask()
        bench.pass_time(2 * TIMEOUT + 0.2)
        assert len(bench.client.answers) == number
    assert len(bench.told(events.UnitResting)) == 1


# --- what has arrived is read before a request is sent ---


def test_a_server_that_sends_without_end_is_read_once_before_a_request() -> None:
    bench = UpstreamBench(in_flight=1, gap=0.05)
    looks: list[bytes] = []

    def look() -> None:
        looks.append(b"")
        if len(looks) > 100:
            raise RecursionError
        bench.hear(mbap.encode(0x9999, 7, bytes.fromhex(RESPONSE)))

    bench.upstream.port_up(bench._send, bench.now, look)
    bench.ask()
    assert len(looks) == 1
    assert bench.sent == []
    bench.upstream.port_up(bench._send, bench.now)
    bench.pass_time(0.05)
    bench.respond()
    assert bench.client.answers == [RESPONSE]


def test_a_request_is_sent_at_once_though_reading_what_had_arrived_took_time() -> None:
    bench = UpstreamBench()

    def look() -> None:
        bench.now += 1e-5
        bench.hear(mbap.encode(0x9999, 7, bytes.fromhex(RESPONSE)))

    bench.upstream.port_up(bench._send, bench.now, look)
    bench.ask()
    assert len(bench.sent) == 1
