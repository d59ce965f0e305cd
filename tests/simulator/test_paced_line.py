"""A line at its real pace: when frames end for devices, when each character arrives, who is received."""

import pytest

from gateway.simulator.faults import Faults
from gateway.simulator.generic import Generic
from gateway.simulator.mint import Mint
from gateway.simulator.paced_line import BACKLOG, PacedLine
from gateway.simulator.v80 import V80
from gateway.simulator.weigher import Weigher
from simulator.playing import (
    CHARACTER,
    FORMAT_7E1,
    FORMAT_8E1,
    arrivals,
    ascii_frame,
    ascii_line,
    ask,
    rtu_frame,
    rtu_line,
    write,
)

READ = "03 0000 0001"
RESPONSE = "03 02 0000"


@pytest.mark.parametrize(
    ("device", "idle_chars"), [(Generic(1), 3.5), (Weigher(1), 3.5), (V80(1), 4.5)], ids=["generic", "weigher", "v80"]
)
@pytest.mark.parametrize("baud", [9600, 19200])
def test_every_character_of_an_rtu_answer_comes_when_it_should(device, idle_chars, baud):
    """Request, idle time, answer time, and then one character after the other."""
    line, character = rtu_line(device), 11 / baud
    write(line, rtu_frame(1, READ), at=2.0, baud=baud)
    came, count = arrivals(line), 0
    begin = 2.0 + (8 + idle_chars) * character + device.answer_time
    for at, data in came:
        count += len(data)
        assert at == pytest.approx(begin + count * character)
    assert count == 7
    assert max(len(data) for _, data in came) == (1 if baud == 9600 else 2)


@pytest.mark.parametrize(("device", "idle"), [(Generic(1), 0.00175), (V80(1), 0.00225)], ids=["3.5", "4.5"])
def test_above_19200_baud_the_idle_time_is_fixed(device, idle):
    line, character = rtu_line(device), 11 / 115200
    write(line, rtu_frame(1, "03 0000 000C"), baud=115200)
    came = arrivals(line)
    begin = 8 * character + idle + device.answer_time
    assert [len(data) for _, data in came] == [11, 11, 7]
    assert came[0].at == pytest.approx(begin + 11 * character)
    assert came[-1].at == pytest.approx(begin + 29 * character)


@pytest.mark.parametrize("format_", [FORMAT_7E1, FORMAT_8E1], ids=str)
def test_an_ascii_answer_follows_the_line_feed_after_the_devices_time(format_):
    line, character = PacedLine("ascii", format_, [Mint(2)]), format_.bits / 9600
    write(line, ascii_frame(2, "03 0001 0001"))
    came = arrivals(line)
    assert [data for _, data in came] == [bytes((byte,)) for byte in ascii_frame(2, RESPONSE)]
    assert came[0].at == pytest.approx((17 + 1) * character + 0.010)
    assert came[-1].at == pytest.approx((17 + 15) * character + 0.010)


def test_what_is_written_while_the_port_still_sends_follows_behind_it():
    line = rtu_line(Generic(1))
    request = rtu_frame(1, READ)
    write(line, request[:5])
    write(line, request[5:], at=CHARACTER)
    came = arrivals(line)
    assert b"".join(data for _, data in came) == rtu_frame(1, RESPONSE)
    assert came[0].at == pytest.approx((8 + 3.5 + 1) * CHARACTER + 0.005)


@pytest.mark.parametrize(
    ("device", "gap", "heard"),
    [(Generic(2), 3.4, False), (Generic(2), 3.6, True), (V80(2), 3.6, False), (V80(2), 4.6, True)],
    ids=["3.5 and less", "3.5 and more", "4.5 and less", "4.5 and more"],
)
def test_a_request_is_heard_only_after_enough_silence(device, gap, heard):
    line = rtu_line(device)
    write(line, rtu_frame(1, READ))
    answer = ask(line, rtu_frame(2, READ), at=(8 + gap) * CHARACTER)
    assert bool(answer) is heard


def test_the_rate_is_that_of_each_frame():
    line = rtu_line(Generic(1))
    for at, baud in ((0.0, 9600), (1.0, 19200), (2.0, 1200)):
        write(line, rtu_frame(1, READ), at=at, baud=baud)
        end = arrivals(line)[-1].at
        assert end - at == pytest.approx((8 + 3.5 + 7) * 11 / baud + 0.005)


def test_a_device_set_to_another_rate_hears_nothing_it_understands():
    line = rtu_line(Weigher(1, baud=19200))
    assert ask(line, rtu_frame(1, READ), baud=9600) == b""
    assert ask(line, rtu_frame(1, READ), at=1.0, baud=19200) != b""


def test_other_devices_do_not_answer():
    assert ask(rtu_line(Generic(1), Generic(2)), rtu_frame(2, READ)) == rtu_frame(2, RESPONSE)
    assert ask(rtu_line(Generic(1), Generic(2)), rtu_frame(3, READ)) == b""


def test_a_broadcast_reaches_all_and_none_answers():
    devices = Generic(1), Generic(2)
    line = rtu_line(*devices)
    assert ask(line, rtu_frame(0, "06 0003 0007")) == b""
    assert [ask(line, rtu_frame(unit, "03 0003 0001"), at=float(unit)) for unit in (1, 2)] == [
        rtu_frame(unit, "03 02 0007") for unit in (1, 2)
    ]


def test_two_that_answer_at_once_make_rubbish():
    line = rtu_line(Weigher(1), Weigher(2))
    heard = ask(line, rtu_frame(0, "03 0010 0001"))
    assert len(heard) == 14
    assert rtu_frame(1, "03 02 0001") not in heard
    assert rtu_frame(2, "03 02 0002") not in heard
    assert ask(line, rtu_frame(2, "03 0010 0001"), at=1.0) == rtu_frame(2, "03 02 0002")


def test_an_answer_that_begins_while_the_port_sends_spoils_both():
    """A device that takes longer than the gateway waits: the next request falls into its answer."""
    line = rtu_line(Generic(1, faults=Faults(slow=0.1)), Generic(2))
    write(line, rtu_frame(1, READ))
    begins = (8 + 3.5) * CHARACTER + 0.105
    heard = ask(line, rtu_frame(2, READ), at=begins - 2 * CHARACTER)
    assert len(heard) == 7
    assert heard != rtu_frame(1, RESPONSE)


def test_a_request_written_into_an_answer_spoils_what_is_left_of_it():
    line = rtu_line(Generic(1), Generic(2))
    write(line, rtu_frame(1, READ))
    third_character = (8 + 3.5 + 3) * CHARACTER + 0.005
    heard = ask(line, rtu_frame(2, READ), at=third_character)
    assert len(heard) == 7
    assert heard[:3] == rtu_frame(1, RESPONSE)[:3]
    assert heard != rtu_frame(1, RESPONSE)


def test_a_device_does_one_thing_at_a_time():
    line = rtu_line(Generic(1, faults=Faults(slow=1.0)))
    write(line, rtu_frame(1, READ))
    assert ask(line, rtu_frame(1, "06 0000 0001"), at=0.5) == rtu_frame(1, RESPONSE)
    assert ask(line, rtu_frame(1, READ), at=9.0) == rtu_frame(1, RESPONSE)


def test_what_waits_for_the_line_is_bounded():
    line = rtu_line(Generic(1))
    for _ in range(3):
        write(line, bytes(BACKLOG))
    assert line.deadline() == pytest.approx((BACKLOG + 3.5) * CHARACTER)


def test_in_ascii_a_broken_frame_is_met_with_silence():
    line = ascii_line(Mint(2))
    assert ask(line, b":02030001000100\r\n") == b""
    assert ask(line, ascii_frame(2, "03 0001 0001"), at=1.0) == ascii_frame(2, RESPONSE)


def test_both_directions_are_told_whole():
    told = []
    line = rtu_line(Generic(1), tell=lambda sender, data: told.append((sender, data)))
    ask(line, rtu_frame(1, READ))
    assert told == [("port", rtu_frame(1, READ)), ("device", rtu_frame(1, RESPONSE))]


def test_an_idle_line_wants_nothing():
    line = rtu_line(Generic(1))
    assert line.deadline() is None
    assert line.tick(100.0) == b""
