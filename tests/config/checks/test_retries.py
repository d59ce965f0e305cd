"""`retry_within`: when it means nothing, and when it leaves no time for a repeat."""

import pytest

from gateway.config.load import parse
from gateway.config.problem import dotted

LINE = '[[line]]\nname = "a"\nport = "/dev/a"\nlatency = "5 ms"\n'
TOO_SHORT = "is too short for one repeat after silence (needs {})"


def said(keys):
    found = parse(LINE + keys, "gateway.toml", port_trouble=lambda _: None, real_path=str).problems
    return [f"{one.severity}: {dotted(one.path)}: {one.what}" for one in found]


@pytest.mark.parametrize("keys", ["", "retries = 1\n", 'retries = 1\nretry_within = "auto"\n'])
def test_without_a_time_of_its_own_there_is_always_enough(keys):
    assert said(keys) == []


def test_it_means_nothing_where_nothing_is_repeated():
    assert said('retry_within = "9 s"\n') == ["warning: line[0].retry_within: has no effect without retries"]


@pytest.mark.parametrize(
    ("keys", "needed"),
    [
        ("", "4.05 s"),
        ('timeout = "500 ms"\n', "2.05 s"),
        ('late_window = "100 ms"\n', "2.13 s"),
        ('timeout = "5.1 s"\n', "21 s"),
        ('devices = [{ unit = 1 }, { unit = 2, timeout = "500 ms" }]\n', "2.05 s"),
    ],
)
def test_it_must_be_long_enough_for_one_repeat_of_one_device(keys, needed):
    short = f"warning: line[0].retry_within: {TOO_SHORT.format(needed)}"
    assert said(f'retries = 1\nretry_within = "{float(needed[:-2]) * 0.97:.2f} s"\n{keys}') == [short]
    assert said(f'retries = 1\nretry_within = "{needed}"\n{keys}') == []


def test_where_nothing_is_read_nothing_is_said():
    text = 'retries = 1\nretry_within = "10 ms"\nprofile = "w"\n[profile.w]\nfunctions = [6]\n'
    assert said(text) == []


def test_it_is_not_looked_at_in_a_file_with_errors():
    (problem,) = said('retries = 1\nretry_within = "10 ms"\nprofile = "nowhere"\n')
    assert problem.startswith("error: line[0].profile")
