"""What nobody has sent, and has a check sum that fits."""

import pytest

from gateway.modbus import ascii as ascii_framing
from gateway.modbus import rtu
from kit.chance import Chance

FRAME = bytes.fromhex("03 02 38 60")
ENCODE = {"rtu": rtu.encode, "ascii": ascii_framing.encode}


@pytest.mark.parametrize("mode", ["rtu", "ascii"])
def test_pieces_of_two_messages_are_no_frame(mode: str) -> None:
    frame = ENCODE[mode](5, FRAME)
    for at in range(1, len(frame)):
        chance = Chance(mode)
        chance.asked = frame[:2]
        for piece in (frame[:at], frame[at:]):
            chance.sent(piece)
        assert chance.spoil(frame[:at]) == frame[:at]
        assert chance.spoil(frame[at:]) != frame[at:]


@pytest.mark.parametrize("mode", ["rtu", "ascii"])
def test_pieces_of_one_message_are(mode: str) -> None:
    frame = ENCODE[mode](5, FRAME)
    for at in range(1, len(frame)):
        chance = Chance(mode)
        chance.asked = frame[:2]
        chance.sent(b"\x55" + frame + b"\x55")
        chance.spoil(b"\x55")
        assert chance.spoil(frame[:at]) + chance.spoil(frame[at:]) == frame
