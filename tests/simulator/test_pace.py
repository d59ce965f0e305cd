"""Characters arrive one character time apart, or a millisecond's worth of them at once."""

from random import Random

import pytest

from gateway.simulator.pace import Transmission
from gateway.timing.characters import CharacterFormat, LineTiming
from simulator.playing import FORMAT_7E1, FORMAT_8E1


def transmission(size: int, baud: int, format_: CharacterFormat = FORMAT_8E1, start: float = 0.0) -> Transmission:
    return Transmission(bytes(range(size)), start, LineTiming("rtu", baud, format_))


def schedule(sent: Transmission) -> list[tuple[float, int]]:
    """When how many characters arrive, in bits since the start."""
    found = []
    while not sent.is_over:
        at = sent.next_arrival()
        found.append((round((at - sent.start) * sent.timing.baud, 6), len(sent.take(at))))
    return found


@pytest.mark.parametrize(
    ("baud", "format_", "expected"),
    [
        (9600, FORMAT_8E1, [(11, 1), (22, 1), (33, 1), (44, 1), (55, 1)]),
        (9600, FORMAT_7E1, [(10, 1), (20, 1), (30, 1), (40, 1), (50, 1)]),
        (19200, FORMAT_8E1, [(22, 2), (44, 2), (55, 1)]),
        (38400, FORMAT_8E1, [(44, 4), (55, 1)]),
        (1200, FORMAT_8E1, [(11, 1), (22, 1), (33, 1), (44, 1), (55, 1)]),
    ],
    ids=str,
)
def test_five_characters(baud, format_, expected):
    assert schedule(transmission(5, baud, format_)) == expected


def test_at_115200_baud_eleven_characters_come_at_once():
    assert schedule(transmission(25, 115200)) == [(11 * 11, 11), (22 * 11, 11), (25 * 11, 3)]


def test_nothing_is_there_before_its_last_bit():
    sent = transmission(2, 9600)
    assert sent.take(10.9 / 9600) == b""
    assert sent.take(11 / 9600) == b"\0"
    assert sent.take(21.9 / 9600) == b""


def test_who_looks_late_finds_all_that_came_meanwhile():
    sent = transmission(100, 9600, start=5.0)
    assert len(sent.take(5.0 + 50.5 * 11 / 9600)) == 50
    assert len(sent.take(60.0)) == 50
    assert sent.is_over


def test_what_has_arrived_stays_when_the_rest_is_garbled():
    sent = transmission(20, 9600)
    before = sent.take(10.5 * 11 / 9600)
    sent.garble(Random(0))
    assert before + sent.data[10:] == sent.data
    assert len(sent.data) == 20
    assert sent.data[10:] != bytes(range(10, 20))
