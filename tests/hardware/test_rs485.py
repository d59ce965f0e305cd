"""RS-485 in a driver; a true one is in tests/qemu/uart.py."""

import errno
import os
import struct

import pytest
from serial.serialposix import (
    SER_RS485_ENABLED,
    SER_RS485_RTS_AFTER_SEND,
    SER_RS485_RTS_ON_SEND,
    SER_RS485_RX_DURING_TX,
    TIOCGRS485,
    TIOCSRS485,
)

from gateway.hardware import rs485
from gateway.hardware.rs485 import restore_rs485, switch_rs485

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
def terminal():
    far_end, near_end = os.openpty()
    yield near_end
    os.close(near_end)
    os.close(far_end)


@pytest.fixture
def driver(monkeypatch):
    def driver(*args, **kwargs):
        driver = Driver(*args, **kwargs)
        monkeypatch.setattr(rs485, "fcntl", driver)
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


def test_a_driver_that_passes_over_it(driver):
    driver(0, is_deaf=True)
    with pytest.raises(OSError, match="ignores"):
        switch_rs485(3, on=True)


def test_a_driver_that_knows_nothing_of_it(terminal):
    assert switch_rs485(terminal, on=False) is None
    with pytest.raises(OSError) as refused:  # noqa: PT011 - the number says it
        switch_rs485(terminal, on=True)
    assert refused.value.errno == errno.ENOTTY
