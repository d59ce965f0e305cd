import os
import struct
import termios

import pytest

from gateway.hardware import ioctls
from gateway.hardware.ioctls import (
    character_errors,
    divided,
    divided_baud,
    has_redefined_38400,
    input_flags,
    is_sending,
)
from gateway.ports.port import CharacterErrors

SANE = termios.BRKINT | termios.IGNPAR | termios.PARMRK | termios.ICRNL


@pytest.fixture
def terminal():
    far_end, near_end = os.openpty()
    yield near_end
    os.close(near_end)
    os.close(far_end)


@pytest.mark.parametrize("before", [0, SANE, termios.INPCK | SANE])
def test_a_port_with_parity_checks_it_whatever_was_set_before(before):
    flags = input_flags(before, checks_parity=True)
    assert flags & (SANE | termios.INPCK) == before & termios.ICRNL | termios.INPCK | termios.PARMRK


@pytest.mark.parametrize("before", [0, SANE, termios.INPCK | SANE])
def test_a_port_without_parity_takes_characters_as_they_come(before):
    assert input_flags(before, checks_parity=False) == before & termios.ICRNL


@pytest.mark.parametrize(
    ("baud", "actual"),
    [
        (9600, 9600),
        (14400, 14400),
        (1000, 1002),  # 115
        (12345, 12800),  # 9
        (33333, 38400),  # 3
        (76800, 57600),  # 1.5 is rounded up
        (100_000, 115_200),
        (250_000, 115_200),  # no faster than its clock
    ],
)
def test_a_clock_divided_by_a_whole_number(baud, actual):
    """tests/qemu/uart.py sees the kernel's driver do the same."""
    assert divided(115_200, baud) == actual


def test_a_driver_that_does_not_tell_its_clock():
    assert divided(0, 9600) is None


def test_a_pseudo_terminal_is_no_uart(terminal):
    assert divided_baud(terminal, 12345) is None
    assert not has_redefined_38400(terminal)
    assert not is_sending(terminal)


def test_wrong_characters_are_read_from_the_counters_of_the_driver(monkeypatch):
    """The order is that of `struct serial_icounter_struct` in linux/serial.h."""
    changes, (received, sent) = (1, 2, 3, 4), (5, 6)
    framing, overrun, parity, breaks, lost = 7, 8, 9, 10, 11
    counters = struct.pack("=11i36x", *changes, received, sent, framing, overrun, parity, breaks, lost)
    monkeypatch.setattr(ioctls.fcntl, "ioctl", lambda descriptor, request, room: counters[: len(room)])
    assert character_errors(0) == CharacterErrors(received, framing, parity, overrun + lost)


def test_a_pseudo_terminal_counts_no_wrong_characters(terminal):
    assert character_errors(terminal) is None
