"""Broken set-ups by their words: what a gateway gets to hear on such a line."""

import pytest

from gateway.simulator.broken import FAULTS, line_faults, with_faults
from gateway.simulator.generic import Generic
from gateway.simulator.weigher import Weigher
from simulator.playing import arrivals, ask, rtu_frame, rtu_line, write

READ = rtu_frame(1, "03 0000 0001")


def line(*words, baud=9600, devices=None):
    broken = with_faults(devices or [Generic(1), Generic(2)], frozenset(words), baud)
    return rtu_line(*broken, faults=line_faults(frozenset(words)))


def test_without_a_word_nothing_is_wrong():
    assert ask(line(), READ) == rtu_frame(1, "03 02 0000")


def test_an_echo_comes_before_the_answer_at_the_pace_of_the_request():
    echoing = line("echo")
    write(echoing, READ)
    found = arrivals(echoing)
    assert b"".join(each.data for each in found) == READ + rtu_frame(1, "03 02 0000")
    assert found[0].at == pytest.approx(11 / 9600)


def test_a_device_with_a_swapped_address_answers_at_one_that_is_free():
    swapped = line("swapped-address")
    assert ask(swapped, READ) == b""
    assert ask(swapped, rtu_frame(3, "03 0000 0001"), at=1.0) == rtu_frame(3, "03 02 0000")


def test_two_devices_with_one_address_damage_each_others_answers_each_time_in_another_way():
    double = line("duplicate-address")
    heard = {ask(double, READ, at=float(at)) for at in range(5)}
    assert len(heard) == 5
    assert rtu_frame(1, "03 02 0000") not in heard
    assert ask(double, rtu_frame(2, "03 0000 0001"), at=9.0) == rtu_frame(2, "03 02 0000")


@pytest.mark.parametrize("word", ["silent", "wrong-parity"])
def test_devices_that_hear_nothing_valid_say_nothing(word):
    assert ask(line(word), READ) == b""


def test_a_wrong_rate_is_another_one_than_clients_use():
    wrong = line("wrong-rate")
    assert ask(wrong, READ) == b""
    assert ask(wrong, READ, at=1.0, baud=19200) == rtu_frame(1, "03 02 0000")


def test_slow_devices_take_longer_than_their_profile_allows():
    slow = line("slow", devices=[Weigher(1)])
    profile = Weigher(1).profile
    time = profile.timing.time(3, 1)
    allowed = profile.timeout if time is None else profile.margin * time
    write(slow, READ)
    assert arrivals(slow)[0].at > allowed + 0.1


def test_another_client_begins_when_it_has_heard_the_rate_and_leaves_others_the_line():
    shared = line("second-client")
    assert shared.deadline() is None
    write(shared, READ)
    shared.tick(0.3)
    heard = b"".join(shared.tick(at / 1000) for at in range(300, 1600))
    theirs = rtu_frame(1, "03 0002 0001") + rtu_frame(1, "03 02 0000")
    assert heard == theirs * 3


def test_another_client_waits_for_the_end_of_a_request_and_its_response():
    shared = line("second-client")
    write(shared, READ)
    shared.tick(0.399)
    write(shared, rtu_frame(2, "03 0000 0001"), at=0.399)
    heard = b"".join(shared.tick(at / 1000) for at in range(400, 600))
    assert heard == rtu_frame(2, "03 02 0000") + rtu_frame(1, "03 0002 0001") + rtu_frame(1, "03 02 0000")


def test_every_word_breaks_something():
    healthy = ask(line(), READ)
    for word in FAULTS:
        broken = line(word)
        write(broken, READ)
        heard = b"".join(broken.tick(at / 1000) for at in range(1, 1000))
        assert heard != healthy, word
