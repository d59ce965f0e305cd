"""In which order handshakes are gone on with, and how much of the time they take."""

import pytest

from gateway.listeners.handshake_turns import SAVED, SHARE, Turns


def test_addresses_take_turns_however_much_one_has_to_do():
    turns: Turns[str] = Turns()
    for number in range(8):
        turns.add(f"flood {number}", "10.0.0.66")
    turns.add("honest", "10.0.0.7")
    assert [turns.next() for _ in range(4)] == ["flood 0", "honest", "flood 1", "flood 2"]


def test_who_has_gone_has_no_turn():
    turns: Turns[str] = Turns()
    for name in ("first", "second"):
        turns.add(name, "10.0.0.7")
        turns.drop(name, "10.0.0.7")
    turns.drop("never there", "10.0.0.8")
    assert turns.next() is None
    turns.add("third", "10.0.0.7")
    turns.clear()
    assert turns.next() is None


def test_a_flood_gets_its_share_of_the_time_and_no_more():
    turns: Turns[str] = Turns()
    now = worked = 100.0
    worked = 0.0
    while now < 110.0:
        now += turns.pause(now)
        now += 0.0024
        worked += 0.0024
        turns.took(0.0024, now)
    assert worked == pytest.approx(10 * SHARE + SAVED, rel=0.01)


def test_a_few_handshakes_after_silence_need_not_wait():
    turns: Turns[str] = Turns()
    now = 0.0
    for _ in range(10):
        assert turns.pause(now) == 0.0
        now += 0.0024
        turns.took(0.0024, now)
    turns.took(1.0, now)
    assert turns.pause(now) > 4.5
    assert turns.pause(now + 3600) == 0.0
    turns.took(SAVED + 0.001, now + 3600)
    assert turns.pause(now + 3600) == pytest.approx(0.001 / SHARE)
