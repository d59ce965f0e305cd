"""Opens, configures and closes a serial device. All of this may block, so all of it runs in a thread."""

import fcntl
import os
import stat
import termios
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Generic, Protocol, TypeVar

from gateway.errors import PortError
from gateway.ports.ioctls import (
    FORMAT_FLAGS,
    actual_baud,
    bytes_to_send,
    divided_baud,
    flags_of,
    has_redefined_38400,
    is_sending,
    is_usb,
    want_low_latency,
)
from gateway.ports.port import SerialSettings
from gateway.ports.reasons import DriverError, why_lost, why_no_such_rate, why_not_opened
from gateway.ports.rs485 import put_back, switch_rs485
from gateway.ports.wire import VIRTUAL_MAJORS
from gateway.timing.characters import CharacterFormat

#: What an adapter and its driver may add to an answer, in seconds; the second where a USB adapter gathers bytes
#: (16 ms in an FTDI chip) and its driver has no low-latency mode.
LATENCY: Final = 0.005
GATHERING_LATENCY: Final = 0.020
#: How far the rate of the hardware may be from the one asked for. Half of what a character of 11 bits can bear.
BAUD_TOLERANCE: Final = 0.025
#: How long a port that is closed may go on sending what was written to it, in seconds: 256 bytes at 1200 baud.
DRAINING_DEADLINE: Final = 2.5

_VIRTUAL_FORMAT: Final = CharacterFormat(8, "N", 1)


class Configured(Protocol):
    """A port that a library has opened, locked and configured: all that a library is needed for."""

    @property
    def checks_parity(self) -> bool:
        """Whether characters have a parity bit, which is checked: what is read is marked (ports/marked.py)."""

    def fileno(self) -> int:
        """Its descriptor."""

    def change_baud(self, baud: int) -> None:
        """Go on at another rate; raises what opening raises."""

    def close(self) -> None:
        """Let go of it."""


C = TypeVar("C", bound=Configured)
#: Opens, locks and configures a port at its settings, in a format that it can do. Raises DriverError or ValueError.
Configure = Callable[[SerialSettings, CharacterFormat], C]


@dataclass(frozen=True, slots=True)
class OpenDevice(Generic[C]):
    """A serial device that is open and configured. `latency` in seconds; `virtual` carries bytes at once.

    `baud` is the rate at which it runs, as far as its driver tells; `rs485` what the driver goes back to at the end.
    What it reads is `marked` where parity is checked.
    """

    port: str
    serial: C
    virtual: bool
    latency: float
    baud: int | None
    rs485: bytes | None
    marked: bool


def open_device(settings: SerialSettings, configure: Configure[C]) -> OpenDevice[C]:
    """Open and configure the port; blocks as long as its driver likes.

    Raises:
        PortError: it cannot be used, and why.
    """
    virtual = _is_virtual(settings)
    with ExitStack() as on_error:
        try:
            serial = configure(settings, _VIRTUAL_FORMAT if virtual else settings.format)
        except (*DriverError, ValueError) as error:
            raise PortError(why_not_opened(settings, error)) from error
        on_error.callback(serial.close)
        try:
            device = _settled(serial, settings, virtual=virtual)
        except DriverError as error:
            raise PortError(why_not_opened(settings, error)) from error
        on_error.pop_all()
    return device


def change_baud(device: OpenDevice[C], baud: int) -> None:
    """Go on at another rate; blocks as long as the driver likes.

    Raises:
        PortError: the port cannot do it, or is gone.
    """
    try:
        device.serial.change_baud(baud)
        _check_baud(device.serial.fileno(), device.port, baud)
    except ValueError as error:
        raise PortError(why_no_such_rate(device.port, baud)) from error
    except DriverError as error:
        raise PortError(why_lost(device.port, error)) from error


def close_device(device: OpenDevice[C], *, lost: bool) -> None:
    """Close the port. What was written to one that is not lost is sent first, within DRAINING_DEADLINE."""
    descriptor = device.serial.fileno()
    with suppress(*DriverError):  # a device that is gone has nothing to send and nothing to give back
        if lost or not _drained(device):
            termios.tcflush(descriptor, termios.TCIOFLUSH)
        if not device.virtual:
            fcntl.ioctl(descriptor, termios.TIOCNXCL)
        if device.rs485 is not None:
            put_back(descriptor, device.rs485)
    device.serial.close()


def _is_virtual(settings: SerialSettings) -> bool:
    try:
        status = Path(settings.port).stat()
    except OSError as error:
        raise PortError(why_not_opened(settings, error)) from error
    if not stat.S_ISCHR(status.st_mode):
        raise PortError(f"{settings.port} is not a serial port")
    return os.major(status.st_rdev) in VIRTUAL_MAJORS


def _settled(serial: C, settings: SerialSettings, *, virtual: bool) -> OpenDevice[C]:
    """See to what no library does: that the driver did as told, RS-485, and the least latency."""
    descriptor = serial.fileno()
    if not virtual:
        _check_format(descriptor, settings)
    has_low_latency = want_low_latency(descriptor)
    latency = settings.latency
    if latency is None:
        latency = LATENCY if has_low_latency or not is_usb(descriptor) else GATHERING_LATENCY
    baud = _check_baud(descriptor, settings.port, settings.baud)
    if not virtual:  # on a pseudo-terminal it would outlive us while a simulator holds the other end
        fcntl.ioctl(descriptor, termios.TIOCEXCL)
    rs485 = _switch_rs485(descriptor, settings)
    return OpenDevice(settings.port, serial, virtual, latency, baud, rs485, serial.checks_parity)


def _switch_rs485(descriptor: int, settings: SerialSettings) -> bytes | None:
    """Who switches the direction of the line; what is to be put back in the end."""
    is_wanted = settings.rs485 == "kernel"
    try:
        return switch_rs485(descriptor, on=is_wanted)
    except OSError as error:
        if not is_wanted:
            return None
        raise PortError(f'{settings.port} has no RS-485 support in its driver; use rs485 = "adapter"') from error


def _check_format(descriptor: int, settings: SerialSettings) -> None:
    """Drivers pass over what they cannot do without a word; only reading back tells."""
    if flags_of(settings.format) != termios.tcgetattr(descriptor)[2] & FORMAT_FLAGS:
        raise PortError(f"{settings.port} cannot do {settings.format}: its driver set another format")


def _check_baud(descriptor: int, port: str, baud: int) -> int | None:
    """The rate at which the port runs, as far as it can be known; near enough to `baud`."""
    if baud == 38400 and has_redefined_38400(descriptor):
        raise PortError(f"{port}: 38400 baud was given another meaning; setserial {port} spd_normal undoes that")
    told = actual_baud(descriptor)
    if told is None:
        return None
    actual = divided_baud(descriptor, told) or told
    if abs(actual - baud) > BAUD_TOLERANCE * baud:
        nearest = divided_baud(descriptor, baud)
        instead = f"its driver set {told} instead" if nearest is None else f"the nearest it can is {nearest}"
        raise PortError(f"{port} cannot do {baud} baud: {instead}")
    return actual


def _drained(device: OpenDevice[C]) -> bool:
    """Wait until all has been sent; False at the deadline. Not tcdrain: nothing ends that.

    Where RS-485 is put back then, which may switch the transmitter off, the last bit must have left the UART too.
    """
    descriptor, deadline = device.serial.fileno(), time.monotonic() + DRAINING_DEADLINE
    while bytes_to_send(descriptor) or (device.rs485 is not None and is_sending(descriptor)):
        if time.monotonic() > deadline:
            return False
        time.sleep(0.005)
    return True
