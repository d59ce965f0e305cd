"""The judge of tests/soak/kept.py: it finds nothing in a good record, and each fault in one that was doctored."""

from collections.abc import Callable

import pytest

from soak import kept_judge as judged
from soak.kept_judge import count, judge
from soak.kept_record import Answer, Break, Entry, Record, Told

#: An outage between these times.
AWAY, BACK = 2.0, 5.0
LATENCY = 0.01


def live(at: float, number: int) -> Told:
    return Told(at + LATENCY, "d", False, (Entry(at, {"count": number}),), 1, True, 1, at + 2 * LATENCY, True)


def history(at: float, *entries: tuple[float, int]) -> Told:
    told = tuple(Entry(when, {"count": number}) for when, number in entries)
    return Told(at, "d", True, told, 1, False, 2, at + LATENCY)


def good() -> Record:
    """A device that is read each quarter of a second, an outage, and history in three messages."""
    record = Record({"count": 0.25}, limit=1.0)
    times = [number / 4 for number in range(40)]
    record.answers = [Answer("d", at, {"count": number}) for number, at in enumerate(times)]
    kept = [(at, number) for number, at in enumerate(times) if AWAY <= at < BACK]
    told = [live(at, number) for number, at in enumerate(times) if not AWAY <= at < BACK]
    told += [history(BACK + 0.2 + place / 10, *kept[place * 4 : place * 4 + 4]) for place in range(3)]
    record.sent = sorted(told, key=lambda each: each.at)
    record.heard = [*record.sent]
    record.breaks, record.ends = [Break(AWAY, 0.5), Break(BACK, 0.5)], [AWAY, BACK]
    return record


def kinds(record: Record) -> set[str]:
    return set(count(judge(record)))


def places(record: Record) -> list[int]:
    """Of the messages of history in what was heard."""
    return [place for place, told in enumerate(record.heard) if told.is_history]


def test_a_good_record_has_no_problem():
    assert judge(good()) == []


def test_a_value_may_be_told_again_after_an_unclean_end_with_its_time():
    record = good()
    record.breaks.append(Break(6.0, reach=1.0))
    record.heard.append(record.heard[places(record)[-1]]._replace(at=6.5))
    assert judge(record) == []


def test_the_latest_value_may_be_told_again_by_a_birth():
    record = good()
    record.ends.append(9.8)
    record.heard.append(record.heard[-1]._replace(at=9.9))
    assert judge(record) == []


def test_what_may_be_lost_is_not_missed():
    record = good()
    del record.heard[places(record)[0]]
    assert kinds(record) == {judged.LOST}
    record.may_lose.append((AWAY - 0.1, AWAY + 1.0))
    assert judge(record) == []


def test_a_clock_that_was_set_makes_earlier_times_unsure():
    record = good()
    record.clock = [(0.0, -3600.0), (BACK, 0.0)]
    record.heard = [
        told._replace(
            entries=tuple(entry._replace(at=entry.at - 3600, is_unsure=told.is_history) for entry in told.entries)
        )
        if told.entries[0].at < BACK
        else told
        for told in record.heard
    ]
    assert judge(record) == []
    place = places(record)[0]
    record.heard[place] = doctored(record.heard[place], is_unsure=False)
    assert kinds(record) == {judged.CLOCK}


def doctored(told: Told, **changes: object) -> Told:
    """A message with its first entry changed."""
    first, *rest = told.entries
    return told._replace(entries=(first._replace(**changes), *rest))


def _lose_live(record: Record) -> None:
    del record.heard[3]


def _lose_an_entry(record: Record) -> None:
    place = places(record)[1]
    record.heard[place] = record.heard[place]._replace(entries=record.heard[place].entries[1:])


def _invent(record: Record) -> None:
    record.heard.append(live(9.9, 1000))


def _repeat_history(record: Record) -> None:
    record.heard.append(record.heard[places(record)[2]]._replace(at=8.0))


def _repeat_live_in_history(record: Record) -> None:
    record.heard.append(history(9.9, (9.0, 36)))


def _repeat_with_another_time(record: Record) -> None:
    record.breaks.append(Break(6.0, reach=1.0))
    again = record.heard[places(record)[2]]._replace(at=6.5)
    record.heard.append(doctored(again, at=again.entries[0].at + 0.001))


def _repeat_live(record: Record) -> None:
    record.heard.append(record.heard[-1]._replace(at=9.9))


def _swap_history(record: Record) -> None:
    first, second, _ = places(record)
    record.heard[first], record.heard[second] = record.heard[second], record.heard[first]


def _tell_the_time_of_sending(record: Record) -> None:
    place = places(record)[0]
    record.heard[place] = doctored(record.heard[place], at=record.heard[place].at)


def _tell_an_old_value_live(record: Record) -> None:
    record.sent.append(live(3.0, 12)._replace(at=5.5))


def _go_backwards(record: Record) -> None:
    record.heard.append(live(9.0, 36)._replace(at=9.9))


def _send_fast(record: Record) -> None:
    record.sent += [history(6.0 + place / 20) for place in range(12)]


def _send_two_at_once(record: Record) -> None:
    record.sent = [told._replace(confirmed_at=None) if told.is_history else told for told in record.sent]


def _retain(record: Record) -> None:
    record.sent = [told._replace(is_retained=True) for told in record.sent]


def _send_without_confirmation(record: Record) -> None:
    record.sent = [told._replace(qos=0) if told.is_history else told for told in record.sent]


def _let_live_values_wait(record: Record) -> None:
    record.sent = [
        told._replace(connection=2, at=told.at + 1.4) if not told.is_history and told.at > BACK else told
        for told in record.sent
    ]
    record.sent.append(history(7.0))


@pytest.mark.parametrize(
    ("doctor", "kind"),
    [
        (_lose_live, judged.LOST),
        (_lose_an_entry, judged.LOST),
        (_invent, judged.INVENTED),
        (_repeat_history, judged.DOUBLED),
        (_repeat_live_in_history, judged.DOUBLED),
        (_repeat_with_another_time, judged.UNRECOGNISABLE),
        (_repeat_live, judged.DOUBLED),
        (_swap_history, judged.DISORDER),
        (_tell_the_time_of_sending, judged.WRONG_TIME),
        (_tell_an_old_value_live, judged.OLD),
        (_go_backwards, judged.BACKWARDS),
        (_send_fast, judged.TOO_FAST),
        (_send_two_at_once, judged.NOT_ALONE),
        (_retain, judged.MANNER),
        (_send_without_confirmation, judged.MANNER),
        (_let_live_values_wait, judged.BEFORE_LIVE),
    ],
)
def test_a_fault_is_found(doctor: Callable[[Record], None], kind: str):
    record = good()
    doctor(record)
    assert kind in kinds(record)
