import pytest

from gateway.profiles.columns import labels_cell, labels_of, numbers_cell, numbers_of


@pytest.mark.parametrize(
    "labels",
    [
        {},
        {0: "off", 1: "running"},
        {-1: "unknown", 65535: "a = b"},
        {0: "off; not ready", 1: 'with "quotes", and commas'},
    ],
)
def test_labels_are_read_as_they_were_written(labels):
    assert {int(number): text for number, text in labels_of(labels_cell(labels))} == labels


def test_a_text_that_looks_like_two_labels_stays_one():
    assert labels_cell({0: "off;1=on"}) == "0=off,1=on"


@pytest.mark.parametrize(
    ("cell", "labels"),
    [
        (" 0 = off ; 0x1F = on;", [("0", "off"), ("0x1F", "on;")]),
        ("0=off;1=on", [("0", "off"), ("1", "on")]),
        ("off", [("off", "")]),
        (" ", []),
    ],
)
def test_labels_of_others_may_have_spaces(cell, labels):
    assert labels_of(cell) == labels


def test_numbers_are_split_as_they_were_joined():
    assert numbers_cell([32767, -1.5]) == "32767;-1.5"
    assert numbers_of("32767; -1.5;") == ["32767", "-1.5"]
    assert numbers_of("") == []
