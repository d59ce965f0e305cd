"""What can be wrong with a device shows on the line, in the share that was asked for, the same for the same seed."""

from random import Random

import pytest

from gateway.modbus.rtu import crc_fits
from gateway.simulator.faults import NO_FAULTS, Faults, flip_bit
from gateway.simulator.generic import Generic
from simulator.playing import CHARACTER, arrivals, ask, rtu_frame, rtu_line, write

REQUEST = rtu_frame(1, "03 0000 0001")
RESPONSE = rtu_frame(1, "03 02 0000")


def test_without_faults_all_arrives_as_it_was_sent():
    assert all(NO_FAULTS.on_the_line(RESPONSE, Random(seed)) == RESPONSE for seed in range(100))


def test_the_share_of_noisy_answers_is_the_one_asked_for():
    dice, faults = Random(0), Faults(noise=0.05)
    spoilt = sum(faults.on_the_line(RESPONSE, dice) != RESPONSE for _ in range(10_000))
    assert 400 < spoilt < 600


def test_noise_comes_before_an_answer_or_flips_a_bit_of_it():
    dice, faults = Random(0), Faults(noise=1.0)
    heard = [faults.on_the_line(RESPONSE, dice) for _ in range(100)]
    before = [data for data in heard if data.endswith(RESPONSE)]
    flipped = [data for data in heard if len(data) == len(RESPONSE)]
    assert len(before) + len(flipped) == 100
    assert all(len(RESPONSE) < len(data) <= len(RESPONSE) + 4 for data in before)
    assert min(len(before), len(flipped)) > 30
    assert not any(map(crc_fits, flipped))


@pytest.mark.parametrize(("bit", "expected"), [(0, "0100"), (7, "8000"), (8, "0001"), (15, "0080")])
def test_a_flipped_bit(bit, expected):
    assert flip_bit(bytes(2), bit).hex() == expected


def test_a_silent_device_neither_answers_nor_acts():
    device = Generic(1, faults=Faults(silent=True))
    assert ask(rtu_line(device), rtu_frame(1, "06 0000 0001")) == b""
    device.faults = NO_FAULTS
    assert ask(rtu_line(device), REQUEST) == RESPONSE


def test_a_slow_device_answers_later_by_so_much():
    times = []
    for faults in (NO_FAULTS, Faults(slow=0.2)):
        line = rtu_line(Generic(1, faults=faults))
        write(line, REQUEST)
        times.append(arrivals(line)[0].at)
    assert times[1] - times[0] == pytest.approx(0.2)


def test_the_same_seed_makes_the_same_noise():
    def heard(seed):
        line = rtu_line(Generic(1, faults=Faults(noise=0.3)), seed=seed)
        return [ask(line, REQUEST, at=float(turn)) for turn in range(50)]

    assert heard(1) == heard(1) != heard(2)


def test_noise_takes_its_time_on_the_line():
    line = rtu_line(Generic(1, faults=Faults(noise=1.0)), seed=3)
    write(line, REQUEST)
    came = arrivals(line)
    assert len(came) > 1
    assert came[-1].at - came[0].at == pytest.approx((len(came) - 1) * CHARACTER)
