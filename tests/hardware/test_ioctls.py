"""What is asked of a serial driver, and what it says."""

import errno
import os
import struct
import termios

import pytest
from serial.serialposix import (
    SER_RS485_ENABLED,
    SER_RS485_RTS_AFTER_SEND,
    SER_RS485_RTS_ON_SEND,
    SER_RS485_RX_DURING_TX,
    TIOCGRS485,
    TIOCSRS485,
)

from gateway.hardware import ioctls
from gateway.hardware.ioctls import (
    count_errors,
    derive_divided_baud,
    derive_input_flags,
    divide_clock,
    has_redefined_38400,
    is_sending,
    read_rs485_delays,
    restore_rs485,
    switch_rs485,
)

SANE = termios.BRKINT | termios.IGNPAR | termios.PARMRK | termios.ICRNL


@pytest.fixture
def terminal():
    far_end, near_end = os.openpty()
    yield near_end
    os.close(near_end)
    os.close(far_end)


@pytest.mark.parametrize("before", [0, SANE, termios.INPCK | SANE])
def test_a_port_with_parity_checks_it_whatever_was_set_before(before):
    flags = derive_input_flags(before, checks_parity=True)
    assert flags & (SANE | termios.INPCK) == before & termios.ICRNL | termios.INPCK | termios.PARMRK


@pytest.mark.parametrize("before", [0, SANE, termios.INPCK | SANE])
def test_a_port_without_parity_takes_characters_as_they_come(before):
    assert derive_input_flags(before, checks_parity=False) == before & termios.ICRNL


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
    assert divide_clock(115_200, baud) == actual


def test_a_driver_that_does_not_tell_its_clock():
    assert divide_clock(0, 9600) is None


def test_a_pseudo_terminal_is_no_uart(terminal):
    assert derive_divided_baud(terminal, 12345) is None
    assert not has_redefined_38400(terminal)
    assert not is_sending(terminal)


def test_wrong_characters_are_read_from_the_counters_of_the_driver(monkeypatch):
    """The order is that of `struct serial_icounter_struct` in linux/serial.h."""
    changes, (received, sent) = (1, 2, 3, 4), (5, 6)
    framing, overrun, parity, breaks, lost = 7, 8, 9, 10, 11
    counters = struct.pack("=11i36x", *changes, received, sent, framing, overrun, parity, breaks, lost)
    monkeypatch.setattr(ioctls.fcntl, "ioctl", lambda descriptor, request, room: counters[: len(room)])
    assert count_errors(0) == (received, framing, parity, overrun + lost)


def test_a_pseudo_terminal_counts_no_wrong_characters(terminal):
    assert count_errors(terminal) is None


# --- RS-485; a true one is in tests/qemu/uart.py ---

ON = SER_RS485_ENABLED | SER_RS485_RTS_ON_SEND
DELAYS = struct.pack("=7I", 1, 2, 0, 0, 0, 0, 0)


class Driver:
    """Stands for a UART's driver behind fcntl.ioctl."""

    def __init__(self, flags, *, is_deaf=False):
        self.state = struct.pack("=I", flags) + DELAYS
        self.is_deaf = is_deaf

    @property
    def flags(self):
        return struct.unpack_from("=I", self.state)[0]

    def ioctl(self, descriptor, request, state):
        if request == TIOCGRS485:
            return self.state
        assert request == TIOCSRS485
        if not self.is_deaf:
            self.state = bytes(state)
        return self.state


@pytest.fixture
def driver(monkeypatch):
    def driver(*args, **kwargs):
        driver = Driver(*args, **kwargs)
        monkeypatch.setattr(ioctls, "fcntl", driver)
        return driver

    return driver


@pytest.mark.parametrize("found", [0, SER_RS485_RTS_AFTER_SEND | SER_RS485_RX_DURING_TX])
def test_it_is_switched_on_and_put_back(driver, found):
    driver = driver(found)
    before = switch_rs485(3, on=True)
    assert (driver.flags, driver.state[4:]) == (ON, DELAYS)
    restore_rs485(3, before)
    assert (driver.flags, driver.state[4:]) == (found, DELAYS)


def test_it_is_switched_off_and_put_back(driver):
    driver = driver(ON)
    before = switch_rs485(3, on=False)
    assert not driver.flags & SER_RS485_ENABLED
    restore_rs485(3, before)
    assert driver.flags == ON


@pytest.mark.parametrize(("found", "on"), [(ON, True), (0, False)])
def test_what_is_as_it_should_be_is_not_touched(driver, found, on):
    driver = driver(found)
    assert switch_rs485(3, on=on) is None
    assert driver.flags == found


def test_delays_are_set_read_and_put_back(driver):
    driver = driver(ON)
    before = switch_rs485(3, on=True, delays=(3, 0))
    assert (driver.flags, read_rs485_delays(3)) == (ON, (3, 0))
    restore_rs485(3, before)
    assert read_rs485_delays(3) == (1, 2)


def test_a_driver_that_passes_over_it(driver):
    driver(0, is_deaf=True)
    with pytest.raises(OSError, match="ignores"):
        switch_rs485(3, on=True)


def test_a_driver_that_knows_nothing_of_it(terminal):
    assert switch_rs485(terminal, on=False) is None
    with pytest.raises(OSError) as refused:  # noqa: PT011 - the number says it
        switch_rs485(terminal, on=True)
    assert refused.value.errno == errno.ENOTTY
