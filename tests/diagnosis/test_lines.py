"""Broken lines and units, as far as they can be told from counts: each is named, with what mends it."""

from dataclasses import replace

import pytest

from gateway.diagnosis.evidence import LineEvidence, Search, UnitEvidence
from gateway.diagnosis.last import Last
from gateway.diagnosis.lines import about_line
from gateway.diagnosis.pauses import Losses, Pauses
from gateway.modbus.explain import OTHER_IDENTIFIER, OTHER_UNIT
from gateway.ports.port import CharacterErrors

LATE = {"latest": 0.52, "latest_limit": 0.4}
SILO = UnitEvidence(41, 1, "silo-1", "gateway.toml:7", "weigher", answered=100, limit=0.4, limit_share=0.2)
PRESS = UnitEvidence(46, 6, "press", "gateway.toml:8", "v80", answered=50, limit=0.4, limit_share=0.2)
LINE = LineEvidence("hall", "gateway.toml:3", 19200, "8E1", sent=150, units=(SILO, PRESS))
SILENT = replace(SILO, answered=0, timeouts=4)
GARBLED = (b"\x01\x03\x04\x12", b"\x01\x03\x55", b"\x01\x44\x04\x12\x99", b"\x01\x03\xff")


def fixes(line):
    return [(each.about, each.what, each.remedy) for each in about_line(line) if each.level == "fix"]


def levels(line):
    return [each.level for each in about_line(line)]


def test_a_healthy_line_has_one_row():
    (row,) = about_line(LINE)
    assert (row.level, row.about, row.what) == ("ok", "hall", "2 units answer: 100 % of 150 requests")


def test_units_that_nobody_has_asked_are_a_note():
    unasked = replace(PRESS, answered=0)
    assert [(each.level, each.what) for each in about_line(replace(LINE, units=(SILO, unasked)))] == [
        ("ok", "1 unit answers: 100 % of 100 requests"),
        ("note", "not asked yet: 1 of 2 units"),
    ]


def test_wrong_rate_and_wrong_parity_are_named_with_those_that_are_right():
    both = (SILENT, replace(PRESS, answered=0, timeouts=2))
    wrong_rate = replace(LINE, units=both, search=Search((2, 3), (), 4, speed=(9600, "8E1")))
    assert fixes(wrong_rate) == [
        ("hall", "nobody answers at 19200 8E1, but at 9600 8E1", "gateway.toml:3: baud = 9600")
    ]
    wrong_parity = replace(wrong_rate, search=Search((2, 3), (), 1, speed=(19200, "8N1")))
    assert fixes(wrong_parity)[0][2] == 'gateway.toml:3: format = "8N1"'
    both_wrong = replace(wrong_rate, search=Search((2, 3), (), 1, speed=(9600, "8N1")))
    assert fixes(both_wrong)[0][2] == 'gateway.toml:3: baud = 9600 and format = "8N1"'


def test_a_line_without_any_answer_has_one_row_and_not_one_for_each_unit():
    dead = replace(LINE, units=(SILENT,), search=Search((2, 3), (), 26))
    ((about, what, remedy),) = fixes(dead)
    assert (about, what) == ("hall", "nobody answers at 19200 8E1, nor at 26 other rates and formats")
    assert "parity (8E1)" in remedy
    assert "this port has no parity" in fixes(replace(dead, search=Search((2,), (), 9, has_parity=False)))[0][1]


def test_units_that_are_all_silent_have_one_row_also_if_nothing_was_tried():
    both = (SILENT, replace(PRESS, answered=0, timeouts=2))
    ((about, what, remedy),) = fixes(replace(LINE, units=both))
    assert (about, what) == ("hall", "none of its 2 units answers at 19200 8E1")
    assert "parity (8E1)" in remedy
    assert "without --passive, doctor hall tries other rates" in remedy
    assert len(fixes(replace(LINE, units=(SILENT, PRESS)))) == 1
    assert "none of" not in fixes(replace(LINE, units=(SILENT, replace(PRESS, answered=0))))[0][1]


@pytest.mark.parametrize(
    ("errors", "words"),
    [
        (CharacterErrors(1000, 0, 700, 0), "700 of 1000 characters had a wrong parity bit"),
        (CharacterErrors(1000, 300, 0, 0), "300 of 1000 characters came without a stop bit"),
    ],
)
def test_what_the_driver_counts_names_parity_and_rate(errors, words):
    ((about, what, _),) = fixes(replace(LINE, errors=errors))
    assert about == "hall"
    assert what.startswith(words)


def test_a_few_wrong_characters_in_many_are_noise():
    assert levels(replace(LINE, errors=CharacterErrors(100_000, 5, 7, 0))) == ["ok"]
    assert levels(replace(LINE, errors=CharacterErrors(1000, 0, 0, 3))) == ["note", "ok"]


def test_swapped_addresses_are_named_when_another_one_answers():
    line = replace(LINE, units=(SILENT, PRESS), search=Search((2, 3), (3,)))
    assert fixes(line) == [
        (
            "unit 41, silo-1",
            "does not answer at address 1, but a device that is not configured answers at 3: are addresses swapped?",
            "gateway.toml:7: unit = 3, or set the address at the device",
        )
    ]


def test_two_units_of_different_kinds_that_only_refuse_have_swapped_addresses():
    refusing = tuple(replace(unit, exceptions=unit.answered) for unit in (SILO, PRESS))
    assert [what for _, what, _ in fixes(replace(LINE, units=refusing))] == [
        "answers with exceptions only, and so does unit 46, press: are their addresses swapped?",
        "answers with exceptions only, and so does unit 41, silo-1: are their addresses swapped?",
    ]
    assert levels(replace(LINE, units=(refusing[0], PRESS))) == ["note", "ok"]


def test_a_silent_unit_among_others_is_named():
    assert fixes(replace(LINE, units=(SILENT, PRESS), search=Search((2, 3)))) == [
        ("unit 41, silo-1", "does not answer at address 1", "check power, wiring and address of the device")
    ]


def test_of_a_silent_unit_that_has_moved_it_says_how_to_ask_it_where_the_config_says():
    remedy = "check power, wiring and address of the device; if it is at 7 again: modbus-gateway forget silo-1"
    moved, stopped = replace(SILENT, moved_from=7), replace(SILO, moved_from=7, in_a_row=5)
    assert fixes(replace(LINE, units=(moved, PRESS), search=Search((2, 3))))[0][2] == remedy
    assert fixes(replace(LINE, units=(moved, PRESS), search=Search((2, 7), (7,))))[0][2] == remedy
    assert fixes(replace(LINE, units=(stopped, PRESS)))[0][2] == remedy


def test_where_the_config_has_a_device_that_has_moved_is_no_address_for_another_silent_one():
    moved, silent = replace(SILENT, on_the_wire=5, moved_from=1), replace(PRESS, answered=0, timeouts=4)
    answering = replace(SILO, unit=47, on_the_wire=7, name="scale")
    line = replace(LINE, units=(moved, silent, answering), search=Search((1, 2), (1,)))
    assert [(what, remedy) for _, what, remedy in fixes(line)] == [
        (
            "does not answer at address 5, but a device answers at 1, where the config has it",
            "check power, wiring and address of the device; if it is at 1 again: modbus-gateway forget silo-1",
        ),
        ("does not answer at address 6", "check power, wiring and address of the device"),
    ]


def test_a_unit_that_has_stopped_answering_is_named_whatever_its_share_was():
    line = replace(LINE, units=(replace(SILO, answered=500, timeouts=5, in_a_row=5), PRESS))
    assert fixes(line) == [
        (
            "unit 41, silo-1",
            "does not answer at the moment: its last 5 requests failed, of 505 in all",
            "check power, wiring and address of the device",
        )
    ]
    once = replace(SILO, answered=500, timeouts=5, in_a_row=1)
    assert rows_about_silo(once) == [("note", "its last request was not answered")]
    assert rows_about_silo(replace(once, in_a_row=0)) == []


def test_the_units_that_answer_beside_one_that_does_not_are_named():
    third = replace(PRESS, unit=47, name="mill")
    assert [row.what for row in about_line(replace(LINE, units=(SILENT, PRESS, third))) if row.level == "ok"] == [
        "units 46, 47 answer"
    ]
    assert "ok" not in levels(replace(LINE, units=(SILENT, PRESS), others=12))
    assert "ok" not in levels(replace(LINE, units=(SILENT, replace(PRESS, in_a_row=1))))


@pytest.mark.parametrize(
    ("unit", "others", "words"),
    [
        (
            replace(SILO, answered=20, bad_frames=30, instead=GARBLED),
            (PRESS,),
            "those of other units are not: two devices",
        ),
        (replace(SILO, answered=20, bad_frames=30, instead=GARBLED), (), "each in another way: two devices"),
        (replace(SILO, twice=3), (PRESS,), "3 responses came twice: two devices"),
    ],
)
def test_two_devices_with_one_address_are_named(unit, others, words):
    ((about, what, _),) = fixes(replace(LINE, units=(unit, *others)))
    assert about == "unit 41, silo-1"
    assert words in what
    assert "may have the address 1" in what


@pytest.mark.parametrize(("damaged", "level"), [(1, None), (3, "note"), (30, "fix")])
def test_how_many_damaged_responses_are_worth_a_row(damaged, level):
    unit = replace(SILO, bad_frames=damaged, instead=GARBLED[:1])
    about = [each.level for each in about_line(replace(LINE, units=(unit,))) if each.about == "unit 41, silo-1"]
    assert about == [level] * (level is not None)


def test_answers_that_are_always_damaged_in_the_same_way_are_no_second_device():
    unit = replace(SILO, answered=20, bad_frames=30, instead=GARBLED[:1] * 8)
    ((_, what, _),) = fixes(replace(LINE, units=(unit,)))
    assert what == "30 of 50 responses were damaged"


def test_an_echo_is_named_unless_it_is_configured():
    line = replace(LINE, copies=148)
    assert fixes(line) == [
        ("hall", "the adapter returns what is sent: 148 of 150 requests came back", "gateway.toml:3: echo = true")
    ]
    assert levels(replace(line, echo=True)) == ["ok"]


def test_another_client_is_named_also_if_it_asks_what_we_ask():
    ((about, what, _),) = fixes(replace(LINE, others=12))
    assert (about, what) == ("hall", "another client sends requests on this line: 12 were heard")
    assert "15 were heard" in fixes(replace(LINE, copies=12, others=3))[0][1]
    assert levels(replace(LINE, others=1)) == ["ok"]


def test_copies_that_may_be_an_echo_are_named_as_such_first():
    ((_, what, remedy),) = fixes(replace(LINE, copies=14))
    assert what == "14 of 150 requests came back: the adapter echoes, or another client asks the same"
    assert remedy == "gateway.toml:3: echo = true; if the adapter does not echo, disconnect the other client"
    ((_, what, remedy),) = fixes(replace(LINE, copies=14, copies_in_a_row=5))
    assert what == "the adapter returns what is sent: 14 of 150 requests came back"


@pytest.mark.parametrize(
    ("ago", "sent_since", "level", "told"),
    [
        (30.0, 400, "fix", ""),
        (90.0, 20, "fix", ", the last one 90 s ago"),
        (90.0, 400, "note", ", the last one 90 s ago"),
        (720.0, 0, "note", ", the last one 12 min ago"),
    ],
)
def test_what_was_repaired_is_a_note(ago, sent_since, level, told):
    last = Last(ago, sent_since)
    client = replace(LINE, others=7, last_other=last)
    echo = replace(LINE, copies=140, last_copy=last)
    few = replace(LINE, copies=14, last_copy=last)
    parity = replace(LINE, errors=CharacterErrors(1000, 0, 700, 0), last_parity=last)
    framing = replace(LINE, errors=CharacterErrors(1000, 300, 0, 0), last_framing=last)
    late = replace(SILO, late=9, latest=0.7, last_late=last)
    twice = replace(SILO, twice=3, last_twice=last)
    damaged = replace(SILO, bad_frames=20, last_bad=last)
    garbled = replace(SILO, answered=20, bad_frames=30, instead=GARBLED, last_bad=last)
    failing = replace(SILO, timeouts=30, last_failed=last)
    units = [replace(LINE, units=(unit, PRESS)) for unit in (late, twice, damaged, garbled, failing)]
    alone = replace(LINE, units=(garbled,))
    for line in (client, echo, few, parity, framing, *units, alone):
        row = next(about_line(line))
        assert row.level == level
        assert told in row.what
        assert (", the last one" in row.what) is bool(told)
        assert row.remedy
        assert ("ok" in levels(line)) is (level == "note" or bool(row.unit and line is not alone))


STOPPED = (replace(SILO, timeouts=2, in_a_row=2), replace(PRESS, timeouts=1, in_a_row=1))


def test_a_line_on_which_all_units_have_stopped_answering_has_one_row():
    ((about, what, remedy),) = fixes(replace(LINE, units=STOPPED))
    assert (about, what) == ("hall", "none of its 2 units answers any more, though some have answered")
    assert remedy == "check the power of the line, the adapter and the wires"
    assert fixes(replace(LINE, units=(SILENT, STOPPED[1])))[0][0] == "hall"
    assert levels(replace(LINE, units=(SILO, STOPPED[1]))) == ["note", "ok"]


def test_units_that_do_not_answer_at_the_moment_are_not_among_those_that_answer():
    rows = list(about_line(replace(LINE, units=(SILO, STOPPED[1]))))
    assert rows[-1].what == "1 unit answers: 100 % of 100 requests"
    assert levels(replace(LINE, units=(STOPPED[1],))) == ["note"]


def test_that_units_have_answered_long_ago_is_a_note():
    long_ago = replace(LINE, units=(replace(SILO, ago=720.0), replace(PRESS, ago=9000.0)))
    (row,) = about_line(long_ago)
    assert (row.level, row.what) == ("note", "2 units have answered: 100 % of 150 requests, the last one 12 min ago")
    assert row.remedy == "without --passive, doctor hall asks again"
    assert levels(replace(long_ago, units=(replace(SILO, ago=50.0), PRESS))) == ["ok"]


def test_a_unit_that_only_a_client_names_is_a_note_beside_one_that_answers():
    mistyped = replace(SILENT, unit=18, name="hall/18", is_configured=False)
    row = next(about_line(replace(LINE, units=(mistyped, PRESS))))
    assert (row.level, row.about) == ("note", "unit 18, hall/18")
    assert row.what == "a client asks for it and gets no answer; on this line 46 can answer"
    assert row.remedy == "check the unit identifier in the client, then the address of the device"
    assert levels(replace(LINE, units=(mistyped,))) == ["fix"]


def test_a_limit_that_is_too_short_is_named_with_a_longer_one():
    ((about, what, remedy),) = fixes(replace(LINE, units=(replace(SILO, timeouts=9, late=9, **LATE), PRESS)))
    assert (about, what) == (
        "unit 41, silo-1",
        "9 responses came after the limit, the slowest after 520 ms (limit 400 ms)",
    )
    assert remedy == 'gateway.toml:7: timeout = "800 ms"'


def test_the_times_of_a_table_are_measured_and_not_replaced_by_one_timeout():
    late = replace(SILO, timeouts=9, late=9, **LATE, has_table=True)
    ((_, _, remedy),) = fixes(replace(LINE, units=(late, PRESS)))
    assert remedy == ("modbus-gateway calibrate silo-1 --active --write-profile FILE makes a profile with longer times")


def test_a_late_answer_now_and_then_is_a_note():
    line = replace(LINE, units=(replace(SILO, answered=100_000, timeouts=1, late=1, **LATE),))
    assert levels(line) == ["note", "ok"]


def test_the_limit_that_is_named_is_that_of_the_slow_answer_and_not_that_of_another_function():
    late = replace(SILO, timeouts=9, late=9, latest=0.0544, latest_limit=0.0411, limit=0.103)
    ((_, what, _),) = fixes(replace(LINE, units=(late, PRESS)))
    assert what == "9 responses came after the limit, the slowest after 54.4 ms (limit 41.1 ms)"


def test_answers_close_to_their_limit_are_a_note():
    (row, _) = about_line(replace(LINE, units=(replace(SILO, limit_share=0.9),)))
    assert (row.level, row.remedy) == ("note", 'gateway.toml:7: timeout = "600 ms"')


def test_no_line_is_fine_whose_unit_has_never_answered():
    for failed in (replace(SILO, answered=0, bad_frames=1), replace(SILO, answered=0, timeouts=1, bad_frames=1)):
        assert "fix" in levels(replace(LINE, units=(failed,)))


def test_a_unit_with_an_address_twice_is_not_said_to_be_without_power_as_well():
    rows = fixes(replace(LINE, units=(replace(SILO, twice=3, in_a_row=5), PRESS)))
    assert [remedy for _, _, remedy in rows] == ["disconnect one of them and give it another address"]


def test_a_line_that_is_down_has_one_row_that_names_the_cause():
    ((about, what, remedy),) = fixes(replace(LINE, reason="/dev/ttyS0 has no RS-485 support in its driver"))
    assert (about, what) == ("hall", "is down: /dev/ttyS0 has no RS-485 support in its driver")
    assert remedy.startswith("correct what is named here")


def test_a_full_line_is_a_note():
    assert levels(replace(LINE, busy_share=0.95)) == ["note", "ok"]


def rows_about_silo(unit, **about_line_too):
    found = about_line(replace(LINE, units=(unit, PRESS), **about_line_too))
    return [(each.level, each.what) for each in found if each.about == "unit 41, silo-1"]


def test_a_late_response_does_not_hide_that_responses_are_damaged():
    unit = replace(SILO, answered=2000, bad_frames=96, timeouts=40, late=1, **LATE, instead=GARBLED[:1])
    assert [what for _, what in rows_about_silo(unit)] == [
        "96 of 2136 responses were damaged",
        "one response came after the limit, the slowest after 520 ms (limit 400 ms)",
    ]


def test_what_is_to_be_mended_comes_first_and_then_what_concerns_most_requests():
    unit = replace(SILO, answered=100, bad_frames=10, timeouts=60, late=20, **LATE, instead=GARBLED[:1])
    assert rows_about_silo(unit) == [
        ("fix", "40 of 170 requests were not answered"),
        ("fix", "20 responses came after the limit, the slowest after 520 ms (limit 400 ms)"),
        ("fix", "10 of 170 responses were damaged"),
    ]


def test_a_unit_whose_answers_come_behind_ambiguous_ones_needs_no_longer_limit_and_has_answered():
    unit = replace(SILO, answered=0, ambiguous=6, behind=6)
    told = fixes(replace(LINE, units=(unit,), others=1476))
    assert "never answered" not in str(told)
    assert "after the limit" not in str(told)


def test_a_unit_that_has_never_answered_where_others_are_heard_is_silent_and_not_disturbed():
    unit = replace(SILO, answered=0, timeouts=6, bad_frames=14, instead=GARBLED)
    line = replace(LINE, units=(unit,), others=1476)
    assert fixes(line)[1:] == [
        (
            "unit 41, silo-1",
            "has never answered: what came after 14 of 20 requests was probably other traffic",
            "check power, wiring and address of the device",
        )
    ]
    assert "damaged" in fixes(replace(line, others=0))[0][1]


def test_units_of_one_row_of_the_config_get_one_time_out_which_suits_all():
    units = tuple(replace(SILO, unit=at, name=f"meter-{at}", late=9, latest=0.1 * at) for at in (3, 5, 4))
    other = replace(PRESS, late=9, latest=0.9)
    remedies = {remedy for _, _, remedy in fixes(replace(LINE, units=(*units, other)))}
    assert remedies == {
        'gateway.toml:7: timeout = "750 ms", for meter-3, meter-5, meter-4',
        'gateway.toml:8: timeout = "1.5 s"',
    }


ROOF = LineEvidence("roof", "gateway.toml:4", 0, "", is_serial=False, in_flight=16, units=(SILO, PRESS))
CLOSED = "tcp://10.1.0.5:502 takes the connection and closes it at once: is somebody else connected?"
ONE_CLIENT = "it may serve one client only: let the other one ask this gateway instead, or disconnect it"


def with_identifier(identifier, count=2):
    units = [replace(each, bad_frames=count, explained=count, why=identifier) for each in (SILO, PRESS)]
    return replace(ROOF, units=tuple(replace(each, answered=0) for each in units))


def test_a_server_that_answers_with_identifier_0():
    line = with_identifier(OTHER_IDENTIFIER.format(0))
    what = "answers with transaction identifier 0 in place of that of the request: 4 responses did"
    assert fixes(line) == [("roof", what, 'gateway.toml:4: transaction_id = "zero"')]


def test_time_outs_of_a_server_that_answers_with_identifier_0_have_no_rows_of_their_own():
    line = with_identifier(OTHER_IDENTIFIER.format(0), 9)
    timed_out = tuple(replace(each, answered=0, timeouts=20) for each in line.units)
    assert [about for about, *_ in fixes(replace(line, units=timed_out))] == ["roof"]


def test_a_server_whose_late_responses_are_not_seen_may_be_slow():
    losing = replace(SILO, answered=50, timeouts=10)
    [(_, _, remedy)] = fixes(replace(ROOF, in_flight=1, takes_zero=True, units=(losing,)))
    assert remedy == (
        'gateway.toml:4: a longer timeout, if it is slow (with transaction_id = "zero" late responses are not seen); '
        "else check the device"
    )


@pytest.mark.parametrize(("unit", "keys"), [(SILO, "unit = 9 and as = {}"), (replace(SILO, unit=None), "unit = 9")])
def test_a_server_that_answers_under_another_unit_identifier(unit, keys):
    other = replace(unit, answered=0, bad_frames=6, explained=6, why=OTHER_UNIT.format(9))
    what = "6 of 6 responses did not fit their requests: intact, but from unit 9"
    remedy = f"if the values in the trace are those of this unit, {unit.source}: {keys.format(unit.unit)}"
    assert [each[1:] for each in fixes(replace(ROOF, units=(other,)))] == [(what, remedy)]


@pytest.mark.parametrize(
    "line",
    [
        pytest.param(with_identifier(OTHER_IDENTIFIER.format(7)), id="any other identifier"),
        pytest.param(with_identifier(OTHER_IDENTIFIER.format(0), 1), id="too few"),
        pytest.param(replace(with_identifier(OTHER_IDENTIFIER.format(0)), takes_zero=True), id="it is taken already"),
    ],
)
def test_other_responses_that_do_not_fit_do_not_make_it_one(line):
    assert "roof" not in [about for about, *_ in fixes(line)]


def test_a_connection_that_is_lost_again_and_again():
    lost = replace(ROOF, losses=3, loss="connection reset by peer")
    what = "was lost 3 times in the last minute: connection reset by peer"
    assert fixes(lost) == [("roof", what, "check the server, and the network to it")]
    answering = tuple(replace(each, ago=5.0) for each in (SILO, PRESS))
    assert fixes(replace(ROOF, losses=2, loss="reset", units=answering)) == []


def test_a_server_that_closes_each_connection_at_once_may_serve_one_client_only():
    refused = replace(ROOF, losses=1, loss=CLOSED)
    what = f"was lost once in the last minute: {CLOSED}"
    assert fixes(refused) == [("roof", what, ONE_CLIENT)]
    device_server = replace(LINE, is_serial=False, reason=CLOSED)
    assert fixes(device_server) == [("hall", f"is down: {CLOSED}", ONE_CLIENT)]


def test_units_of_a_server_that_loses_requests_for_a_known_reason_have_no_rows_of_their_own():
    pauses = Pauses(soon=Losses(6, 6), later=Losses(0, 6), silence=0.002, needed=0.1)
    failing = (replace(SILENT, timeouts=3), replace(PRESS, answered=50, timeouts=50, in_a_row=3))
    assert [about for about, *_ in fixes(replace(ROOF, units=failing, pauses=pauses))] == ["roof"]
