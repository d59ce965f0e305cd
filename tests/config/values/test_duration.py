"""Durations: text with a unit."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.config.problem import WrongValue
from gateway.config.values.duration import (
    parse_duration,
    parse_duration_or_auto,
    parse_duration_or_off_or_auto,
    parse_duration_or_zero,
    parse_duration_or_zero_or_auto,
    parse_rs485_delay,
    show_duration,
)


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("250 ms", 0.25),
        ("5 s", 5.0),
        ("10 min", 600.0),
        ("1 h", 3600.0),
        ("1.5 s", 1.5),
        ("250ms", 0.25),
        (" 1 s ", 1.0),
    ],
)
def test_a_number_and_a_unit(text, seconds):
    assert parse_duration(text) == pytest.approx(seconds)


@pytest.mark.parametrize(("text", "seconds"), [("auto", None), ("off", 0.0), ("90 s", 90.0)])
def test_a_duration_may_be_off(text, seconds):
    assert parse_duration_or_off_or_auto(text) == seconds


@pytest.mark.parametrize("text", ["0", "0 s", 0, "never", "none", "Off", False])
def test_off_is_said_in_one_way(text):
    with pytest.raises(WrongValue) as caught:
        parse_duration_or_off_or_auto(text)
    assert caught.value.remedy == 'did you mean "off"?'


@pytest.mark.parametrize(
    ("parse", "words"),
    [
        (parse_duration_or_auto, '"auto"'),
        (parse_duration_or_zero_or_auto, '"auto"'),
        (parse_duration_or_off_or_auto, '"auto", "off"'),
    ],
)
def test_words_that_are_allowed_are_named(parse, words):
    with pytest.raises(WrongValue) as caught:
        parse("forever")
    assert caught.value.remedy == f'write {words}, or a number and a unit, such as "250 ms"'
    with pytest.raises(WrongValue, match="needs a unit"):
        parse("5")


@pytest.mark.parametrize(
    ("value", "what", "remedy"),
    [
        (5, "a duration needs a unit", 'put it in quotes with a unit: "5 ms" or "5 s"'),
        (0.5, "a duration needs a unit", 'put it in quotes with a unit: "0.5 ms" or "0.5 s"'),
        ("5", "a duration needs a unit", 'write "5 ms" or "5 s"'),
        ("5 sec", '"sec" is not a valid unit of time', "the units are ms, s, min, h and days"),
        ("soon", '"soon" is not a valid duration', 'a duration is a number and a unit, such as "250 ms"'),
        ("-1 s", '"-1 s" is not a valid duration', 'a duration is a number and a unit, such as "250 ms"'),
        (True, "must be a duration", 'a duration is text with a unit, such as "250 ms"'),
        (["1 s"], "must be a duration", 'a duration is text with a unit, such as "250 ms"'),
        ("2 weeks", '"weeks" is not a valid unit of time', "the units are ms, s, min, h and days"),
        ("169 h", "must be at most 7 days", ""),
        ("0", "must be longer than 0", ""),
        ("0 s", "must be longer than 0", ""),
    ],
)
def test_anything_else_is_refused_in_plain_words(value, what, remedy):
    with pytest.raises(WrongValue) as caught:
        parse_duration(value)
    assert (str(caught.value), caught.value.remedy) == (what, remedy)


def test_what_is_shorter_than_a_use_makes_sense_of_is_refused():
    for text, least in (("0.001 ms", {}), ("9 ms", {"least": 0.01})):
        with pytest.raises(WrongValue, match=f"must be at least {'10' if least else '1'} ms"):
            parse_duration(text, **least)
    with pytest.raises(WrongValue, match="must be at least 1 s"):
        parse_duration_or_zero("999 ms", 1.0)
    assert parse_duration_or_zero("0", 1.0) == 0
    assert parse_duration("1 ms") == pytest.approx(0.001)


def test_zero_needs_no_unit_where_it_is_allowed():
    assert parse_duration_or_zero("0") == 0
    assert parse_duration_or_zero("0 ms") == 0
    assert parse_duration_or_zero("1 ms") == pytest.approx(0.001)


def test_auto_is_none_where_it_is_allowed():
    assert parse_duration_or_auto("auto") is None
    assert parse_duration_or_auto("1 s") == 1
    assert parse_duration_or_zero_or_auto("auto") is None
    assert parse_duration_or_zero_or_auto("0") == 0
    with pytest.raises(WrongValue, match="longer than 0"):
        parse_duration_or_auto("0")


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (None, "auto"),
        (0.0, "0"),
        (0.00257, "2.57 ms"),
        (0.0234, "23.4 ms"),
        (0.751, "751 ms"),
        (1.0, "1 s"),
        (3.155, "3.15 s"),
        (75.0, "75 s"),
        (600.0, "10 min"),
        (7200.0, "120 min"),
        (100.4, "100 s"),
    ],
)
def test_a_duration_is_shown_with_three_figures(seconds, text):
    assert show_duration(seconds) == text


@given(st.integers(1, 999), st.sampled_from(["ms", "s"]))
def test_what_is_shown_can_be_written(number, unit):
    seconds = parse_duration(f"{number} {unit}")
    assert parse_duration(show_duration(seconds)) == pytest.approx(seconds)


def test_the_delays_of_a_driver_that_switches_the_transmitter():
    assert parse_rs485_delay(["2 ms", "0"]) == (2, 0)
    assert parse_rs485_delay(["0.1 s", "29 ms"]) == (100, 29)


@pytest.mark.parametrize("value", ["2 ms", ["2 ms"], ["2 ms", "0", "0"], ["101 ms", "0"], ["0", "0.5 ms"], [2, 0]])
def test_no_delays_of_a_driver(value):
    with pytest.raises(WrongValue):
        parse_rs485_delay(value)
