"""How devices find frames: by silence in RTU, strictly, and by colon and CR LF in ASCII."""

import pytest

from gateway.modbus.frame import Frame
from gateway.simulator.ear import AsciiEar, RtuEar
from simulator.playing import ascii_frame, rtu_frame

CHARACTER = 0.001
SILENCE = 0.0035
REQUEST = rtu_frame(17, "03 006B 0003")
FRAME = Frame(17, bytes.fromhex("03 006B 0003"))
TEXT = ascii_frame(17, "03 006B 0003")


def hear(ear, data, start=0.0):
    ear.hear(data, start, CHARACTER, SILENCE)


def test_an_rtu_frame_ends_with_the_silence_behind_it():
    ear = RtuEar()
    hear(ear, REQUEST, start=1.0)
    assert ear.deadline() == pytest.approx(1.0 + 8 * CHARACTER + SILENCE)
    assert ear.take(ear.deadline() - 1e-6) == []
    assert ear.take(ear.deadline()) == [FRAME]
    assert ear.deadline() is None


def test_a_short_hole_does_not_end_an_rtu_frame():
    ear = RtuEar()
    hear(ear, REQUEST[:4])
    hear(ear, REQUEST[4:], start=4 * CHARACTER + 0.9 * SILENCE)
    assert ear.take(1.0) == [FRAME]


@pytest.mark.parametrize(
    "heard",
    [REQUEST[:-1], b"\0" + REQUEST, REQUEST + REQUEST, REQUEST + bytes(300), b"\x11", rtu_frame(17, "")],
    ids=["cut off", "noise before", "two without a silence", "too long", "one character", "no function"],
)
def test_what_is_no_rtu_frame_is_nothing(heard):
    ear = RtuEar()
    hear(ear, heard)
    assert ear.take(1.0) == []


def test_after_noise_and_a_silence_the_next_rtu_frame_is_heard():
    ear = RtuEar()
    hear(ear, b"\xff\xff")
    assert ear.take(1.0) == []
    hear(ear, REQUEST, start=1.0)
    assert ear.take(2.0) == [FRAME]


def test_a_spoilt_rtu_frame_is_nothing_and_the_next_one_is_heard():
    ear = RtuEar()
    hear(ear, REQUEST)
    ear.spoil()
    assert ear.take(1.0) == []
    ear.spoil()
    hear(ear, REQUEST, start=1.0)
    assert ear.take(2.0) == [FRAME]


def test_an_ascii_frame_ends_with_its_line_feed():
    ear = AsciiEar()
    hear(ear, TEXT, start=1.0)
    assert ear.deadline() == pytest.approx(1.0 + len(TEXT) * CHARACTER)
    assert ear.take(ear.deadline() - 1e-6) == []
    assert ear.take(ear.deadline()) == [FRAME]
    assert ear.deadline() is None


def test_two_ascii_frames_in_one_go_end_one_after_the_other():
    ear = AsciiEar()
    hear(ear, TEXT + TEXT)
    assert ear.take(ear.deadline()) == [FRAME]
    assert ear.deadline() == pytest.approx(2 * len(TEXT) * CHARACTER)
    assert ear.take(1.0) == [FRAME]


@pytest.mark.parametrize(
    ("hole", "frames"), [(0.99, [FRAME]), (1.01, [])], ids=["within a second", "longer than a second"]
)
def test_a_hole_in_an_ascii_frame(hole, frames):
    ear = AsciiEar()
    hear(ear, TEXT[:5], start=10.0)
    hear(ear, TEXT[5:], start=10.0 + 4 * CHARACTER + hole)
    assert ear.take(20.0) == frames


def test_a_colon_starts_an_ascii_frame_anew():
    ear = AsciiEar()
    hear(ear, TEXT[:7] + TEXT)
    assert ear.take(1.0) == [FRAME]


def test_a_spoilt_ascii_frame_is_nothing_and_the_next_one_is_heard():
    ear = AsciiEar()
    hear(ear, TEXT)
    ear.spoil()
    hear(ear, TEXT[:7], start=1.0)
    ear.spoil()
    hear(ear, TEXT[7:], start=1.0 + 7 * CHARACTER)
    assert ear.take(2.0) == []
    hear(ear, TEXT, start=2.0)
    assert ear.take(3.0) == [FRAME]
