"""How devices find frames: by silence in RTU, strictly, and by colon and CR LF in ASCII."""

import pytest

from gateway.modbus.frame import Frame
from gateway.simulator.framer import AsciiFramer, RtuFramer
from simulator.playing import ascii_frame, rtu_frame

CHARACTER = 0.001
SILENCE = 0.0035
REQUEST = rtu_frame(17, "03 006B 0003")
FRAME = Frame(17, bytes.fromhex("03 006B 0003"))
TEXT = ascii_frame(17, "03 006B 0003")


def receive(framer, data, start=0.0):
    framer.receive(data, start, CHARACTER, SILENCE)


def test_an_rtu_frame_ends_with_the_silence_behind_it():
    framer = RtuFramer()
    receive(framer, REQUEST, start=1.0)
    assert framer.deadline() == pytest.approx(1.0 + 8 * CHARACTER + SILENCE)
    assert framer.take(framer.deadline() - 1e-6) == []
    assert framer.take(framer.deadline()) == [FRAME]
    assert framer.deadline() is None


def test_a_short_hole_does_not_end_an_rtu_frame():
    framer = RtuFramer()
    receive(framer, REQUEST[:4])
    receive(framer, REQUEST[4:], start=4 * CHARACTER + 0.9 * SILENCE)
    assert framer.take(1.0) == [FRAME]


@pytest.mark.parametrize(
    "received",
    [REQUEST[:-1], b"\0" + REQUEST, REQUEST + REQUEST, REQUEST + bytes(300), b"\x11", rtu_frame(17, "")],
    ids=["cut off", "noise before", "two without a silence", "too long", "one character", "no function"],
)
def test_what_is_no_rtu_frame_is_nothing(received):
    framer = RtuFramer()
    receive(framer, received)
    assert framer.take(1.0) == []


def test_after_noise_and_a_silence_the_next_rtu_frame_is_heard():
    framer = RtuFramer()
    receive(framer, b"\xff\xff")
    assert framer.take(1.0) == []
    receive(framer, REQUEST, start=1.0)
    assert framer.take(2.0) == [FRAME]


def test_a_spoilt_rtu_frame_is_nothing_and_the_next_one_is_heard():
    framer = RtuFramer()
    receive(framer, REQUEST)
    framer.spoil()
    assert framer.take(1.0) == []
    framer.spoil()
    receive(framer, REQUEST, start=1.0)
    assert framer.take(2.0) == [FRAME]


def test_an_ascii_frame_ends_with_its_line_feed():
    framer = AsciiFramer()
    receive(framer, TEXT, start=1.0)
    assert framer.deadline() == pytest.approx(1.0 + len(TEXT) * CHARACTER)
    assert framer.take(framer.deadline() - 1e-6) == []
    assert framer.take(framer.deadline()) == [FRAME]
    assert framer.deadline() is None


def test_two_ascii_frames_in_one_go_end_one_after_the_other():
    framer = AsciiFramer()
    receive(framer, TEXT + TEXT)
    assert framer.take(framer.deadline()) == [FRAME]
    assert framer.deadline() == pytest.approx(2 * len(TEXT) * CHARACTER)
    assert framer.take(1.0) == [FRAME]


@pytest.mark.parametrize(
    ("hole", "frames"), [(0.99, [FRAME]), (1.01, [])], ids=["within a second", "longer than a second"]
)
def test_a_hole_in_an_ascii_frame(hole, frames):
    framer = AsciiFramer()
    receive(framer, TEXT[:5], start=10.0)
    receive(framer, TEXT[5:], start=10.0 + 4 * CHARACTER + hole)
    assert framer.take(20.0) == frames


def test_a_colon_starts_an_ascii_frame_anew():
    framer = AsciiFramer()
    receive(framer, TEXT[:7] + TEXT)
    assert framer.take(1.0) == [FRAME]


def test_a_spoilt_ascii_frame_is_nothing_and_the_next_one_is_heard():
    framer = AsciiFramer()
    receive(framer, TEXT)
    framer.spoil()
    receive(framer, TEXT[:7], start=1.0)
    framer.spoil()
    receive(framer, TEXT[7:], start=1.0 + 7 * CHARACTER)
    assert framer.take(2.0) == []
    receive(framer, TEXT, start=2.0)
    assert framer.take(3.0) == [FRAME]
