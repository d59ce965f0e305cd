"""Which situation explains the requests that another server has lost: found in records of the trace."""

from random import Random

import pytest

from gateway.diagnosis.evidence import LineEvidence
from gateway.diagnosis.lines import about_line
from gateway.diagnosis.pauses import Asked, Pauses, pauses_of, situations
from gateway.errors import BrokenResponse, ResponseTimeout
from gateway.trace.records import Incident, Sent

READ = bytes.fromhex("03 00 00 00 01")
ANSWER = bytes.fromhex("03 02 00 00")


def asked(sent_at: float, ends_at: float, *, error=None, name="inverter") -> Sent:
    response = None if error else ANSWER
    record = Incident(ends_at, "roof", name, "c", 1, 1, READ, response, sent_at, sent_at, sent_at, 1.0)
    record.error = error
    return record


def one_after_the_other(*pauses: float, needs: float = 0.05, takes: float = 0.01, limit: float = 1.0) -> list[Sent]:
    """Requests with these pauses before them, to a server that loses those that come too soon after a response."""
    now, responded_at, records = 100.0, 0.0, []
    for pause in pauses:
        sent_at = now + pause
        is_lost = sent_at - responded_at < needs
        now = sent_at + (limit if is_lost else takes)
        if not is_lost:
            responded_at = now
        records.append(asked(sent_at, now, error=ResponseTimeout() if is_lost else None))
    return records


def pauses_before(records) -> Pauses:
    return pauses_of([*situations(records)])


def found(pauses: Pauses) -> list[tuple[str, str]]:
    line = LineEvidence("roof", "gateway.toml:4", 0, "", is_serial=False, in_flight=16, pauses=pauses)
    return [(each.what, each.remedy) for each in about_line(line) if each.level == "fix"]


def test_a_server_that_needs_silence_before_a_request():
    pauses = pauses_before(one_after_the_other(*[0.002] * 20))
    assert found(pauses) == [
        (
            "loses requests that come soon after a response: 10 of 10 within 2 ms, 0 of 10 later",
            'gateway.toml:4: gap = "100 ms"',
        )
    ]


@pytest.mark.parametrize(("pauses", "gap"), [((0.002, 0.015, 0.018), 0.02), ((0.002, 0.04, 0.045), 0.05)])
def test_a_shorter_gap_that_was_long_enough_is_proposed(pauses, gap):
    assert pauses_before(one_after_the_other(*pauses * 6, needs=pauses[1])).needed == gap


def test_a_gap_that_is_too_short_is_made_longer():
    pauses = pauses_before(one_after_the_other(*[0.1, 0.1, 0.6] * 6, needs=0.15))
    assert pauses.needs_gap
    assert pauses.needed == 0.2


def test_the_order_of_records_is_that_of_their_ends():
    assert pauses_before(reversed(one_after_the_other(*[0.002] * 20))).needs_gap


@pytest.mark.parametrize(
    "pauses",
    [
        pytest.param([], id="nothing"),
        pytest.param([0.002] * 4, id="too few"),
        pytest.param([1.0] * 20, id="nothing lost"),
    ],
)
def test_too_little_is_no_proof(pauses):
    assert found(pauses_before(one_after_the_other(*pauses))) == []


@pytest.mark.parametrize(("pause", "lost"), [(0.002, 5), (1.0, 5)])
def test_a_server_that_loses_some_of_all_needs_no_gap(pause, lost):
    records, now = [], 100.0
    for number in range(40):
        is_lost = number % lost == 0
        records.append(asked(now + pause, now + pause + 0.01, error=ResponseTimeout() if is_lost else None))
        now += pause + 0.01
    assert found(pauses_before(records)) == []


@pytest.mark.parametrize("share", [0.22, 0.3, 0.5])
@pytest.mark.parametrize("count", [15, 25, 40, 100])
def test_losses_by_chance_are_not_taken_for_hurry(share, count):
    chance = Random(count)
    wrong = 0
    for _ in range(200):
        asked = [Asked(chance.random() < share, chance.uniform(0.0, 0.5), chance.random() < 0.5) for _ in range(count)]
        wrong += len(found(pauses_of(asked)))
    assert wrong <= 6


def test_a_server_that_has_room_for_one_request():
    records = [asked(at, at + 0.01) for at in range(10)]
    records += [asked(at + 0.005, at + 1.0, error=ResponseTimeout()) for at in range(0, 10, 2)]
    assert found(pauses_before(records)) == [
        (
            "loses requests that come while it has another one: 5 of 5, 0 of 10 that came alone",
            "gateway.toml:4: in_flight = 1",
        )
    ]


def test_what_was_damaged_or_not_sent_proves_nothing():
    records = [asked(at, at + 0.01, error=BrokenResponse()) for at in range(10)]
    assert pauses_before(records) == Pauses(needed=0.1)


def test_a_dead_unit_between_others_is_no_hurry():
    records = one_after_the_other(*[1.0] * 10)
    dead = [asked(each.at + 0.001, each.at + 0.9, error=ResponseTimeout(), name="meter") for each in records]
    assert found(pauses_before([*records, *dead])) == []


def after_rests(*rests: float, sleeps_after: float = 5.0, error=ResponseTimeout, name="inverter") -> list[Sent]:
    """Requests with these times since the last one, to a device that loses the first one after it fell asleep."""
    now, records = 100.0, []
    for rest in rests:
        sent_at = now + rest
        is_lost = rest >= sleeps_after
        now = sent_at + (1.0 if is_lost else 0.01)
        records.append(asked(sent_at, now, error=error() if is_lost else None, name=name))
    return records


def test_a_device_that_sleeps():
    assert found(pauses_before(after_rests(*[0.6, 0.6, 8.2] * 4))) == [
        (
            "loses requests to a unit that was not asked for 8 s: 4 of 4, 0 of 7 that came sooner",
            (
                'gateway.toml:4: wake = "8 s", if it sleeps; '
                'after_connect = "500 ms", if it loses what comes soon after connecting'
            ),
        )
    ]


def test_a_server_that_loses_one_of_four_after_as_long_a_rest_has_another_fault():
    records = after_rests(*[8.0, 8.1, 8.2, 0.6] * 4, sleeps_after=8.15)
    records += after_rests(*[20.0] * 12, sleeps_after=99.0, name="meter")
    assert not pauses_before(records).needs_wake


def test_a_network_that_was_down_for_some_polls_is_no_sleep():
    records = after_rests(*[10.0, 9.98, 9.99] * 6, sleeps_after=99.0)
    lost = [asked(each.sent_at + 1000, each.at + 1001, error=ResponseTimeout()) for each in records[:5]]
    assert not pauses_before([*records, *lost]).needs_wake


def test_a_request_that_was_sent_again_needs_no_other_remedy():
    records = after_rests(*[0.6, 0.6, 8.2] * 4)
    for each in records:
        if each.error is not None:
            each.error = None
            assert each.result == "sent_again"
    assert found(pauses_before(records)) == []
