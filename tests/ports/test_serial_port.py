"""What a port with parity reads: the marks are those of Linux's n_tty_receive_parity_error and n_tty_receive_break."""

import pytest

from gateway.ports.serial_port import MarkedInput

CASES = [
    (b"", []),
    (b"answer", [(b"answer", False)]),
    (b"\xff\xff", [(b"\xff", False)]),
    (b"\xff\xff\x00a", [(b"\xff\x00a", False)]),
    (b"\xff\xff\xff\xff\x00", [(b"\xff\xff\x00", False)]),
    (b"\xff\x00a", [(b"a", True)]),
    (b"\xff\x00\x00", [(b"\0", True)]),  # a break
    (b"\xff\x00\xff", [(b"\xff", True)]),
    (b"\xff\x00\n", [(b"\n", True)]),
    (b"1\xff\x00a2", [(b"1", False), (b"a", True), (b"2", False)]),
    (b"1\xff\xff\xff\x00a\xff\xff2", [(b"1\xff", False), (b"a", True), (b"\xff2", False)]),
    (b"1\xff\x00a\xff\x00\xff2", [(b"1", False), (b"a\xff", True), (b"2", False)]),
    (b"1\xff\x00a23\xff\x00b4", [(b"1", False), (b"a", True), (b"23", False), (b"b", True), (b"4", False)]),
    (b"\xffa", [(b"\xffa", False)]),  # no mark
]


class User:
    def __init__(self):
        self.told = []

    def received(self, data, *, damaged=False):
        self.told.append((data, damaged))


@pytest.mark.parametrize(("marked", "told"), CASES[1:])
def test_marks_are_taken_out(marked, told):
    user = User()
    MarkedInput(user.received).received(marked)
    assert user.told == told


@pytest.mark.parametrize(("marked", "told"), CASES)
def test_a_mark_may_be_read_in_pieces(marked, told):
    user = User()
    read = MarkedInput(user.received).received
    for byte in marked:
        read(bytes((byte,)))
    assert [(byte, damaged) for data, damaged in user.told for byte in data] == [
        (byte, damaged) for data, damaged in told for byte in data
    ]


def test_what_follows_a_piece_of_a_mark_is_not_lost():
    user = User()
    read = MarkedInput(user.received).received
    for piece in (b"1\xff", b"\xff2\xff\x00", b"a3"):
        read(piece)
    assert user.told == [(b"1", False), (b"\xff2", False), (b"a", True), (b"3", False)]
