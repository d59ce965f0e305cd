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
from gateway.hardware.device_files import VIRTUAL_MAJORS
from gateway.hardware.ioctls import (
    FORMAT_FLAGS,
    actual_baud,
    bytes_to_send,
    divided_baud,
    flags_of,
    has_redefined_38400,
    is_sending,
    is_usb,
    restore_rs485,
    set_low_latency,
    switch_rs485,
)
from gateway.ports.port import SerialSettings
from gateway.ports.reasons import DriverError, why_lost, why_no_such_rate, why_not_opened
from gateway.timing.characters import CharacterFormat

#: What an adapter and its driver may add to a response, in seconds; the second if a USB adapter gathers bytes (16 ms in
#: an FTDI chip) and its driver has no low-latency mode.
LATENCY: Final = 0.005
GATHERING_LATENCY: Final = 0.020
#: How far the actual rate may be from the configured one: half of what a character of 11 bits tolerates.
BAUD_TOLERANCE: Final = 0.025
#: How long a closed port may go on sending what was written to it, in seconds: 256 bytes at 1200 baud.
DRAINING_DEADLINE: Final = 2.5

_VIRTUAL_FORMAT: Final = CharacterFormat(8, "N", 1)


class Configured(Protocol):
    """A port that a library has opened, locked and configured. Nothing else is needed from a library."""

    @property
    def checks_parity(self) -> bool:
        """Whether parity is checked, so that damaged characters are marked (ports/marked.py)."""

    def fileno(self) -> int:
        """Its descriptor."""

    def change_baud(self, baud: int) -> None:
        """Change the rate; raises what opening raises."""

    def close(self) -> None:
        """Close it."""


C = TypeVar("C", bound=Configured)
#: Opens, locks and configures a port with its settings, in this format. Raises DriverError or ValueError.
Configure = Callable[[SerialSettings, CharacterFormat], C]


@dataclass(frozen=True, slots=True)
class OpenDevice(Generic[C]):
    """A serial device that is open and configured. `latency` in seconds; `virtual` carries bytes at once.

    `baud` is its actual rate, if its driver reports it; `rs485` the driver's setting to restore when it is closed. With
    parity, damaged characters are `marked`.
    """

    port: str
    serial: C
    virtual: bool
    latency: float
    baud: int | None
    rs485: bytes | None
    marked: bool


def open_device(settings: SerialSettings, configure: Configure[C]) -> OpenDevice[C]:
    """Open and configure the port; may block as long as its driver takes.

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
    """Change the rate; may block as long as the driver takes.

    Raises:
        PortError: the port does not support it, or was lost.
    """
    try:
        device.serial.change_baud(baud)
        _check_baud(device.serial.fileno(), device.port, baud)
    except ValueError as error:
        raise PortError(why_no_such_rate(device.port, baud)) from error
    except DriverError as error:
        raise PortError(why_lost(device.port, error)) from error


def close_device(device: OpenDevice[C], *, lost: bool) -> None:
    """Close the port. Unless it was `lost`, what was written is sent first, within DRAINING_DEADLINE."""
    descriptor = device.serial.fileno()
    with suppress(*DriverError):  # the device is gone
        if lost or not _drained(device):
            termios.tcflush(descriptor, termios.TCIOFLUSH)
        if not device.virtual:
            fcntl.ioctl(descriptor, termios.TIOCNXCL)
        if device.rs485 is not None:
            restore_rs485(descriptor, device.rs485)
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
    """Do what no library does: check the settings in the driver, set RS-485 and low latency."""
    descriptor = serial.fileno()
    if not virtual:
        _check_format(descriptor, settings)
    has_low_latency = set_low_latency(descriptor)
    latency = settings.latency
    if latency is None:
        latency = LATENCY if has_low_latency or not is_usb(descriptor) else GATHERING_LATENCY
    baud = _check_baud(descriptor, settings.port, settings.baud)
    if not virtual:  # a pseudo-terminal would keep it while a simulator has the other end open
        fcntl.ioctl(descriptor, termios.TIOCEXCL)
    rs485 = _switch_rs485(descriptor, settings)
    return OpenDevice(settings.port, serial, virtual, latency, baud, rs485, serial.checks_parity)


def _switch_rs485(descriptor: int, settings: SerialSettings) -> bytes | None:
    """Set who switches the direction of the line; returns the setting to restore."""
    is_wanted = settings.rs485 == "kernel"
    try:
        return switch_rs485(descriptor, on=is_wanted)
    except OSError as error:
        if not is_wanted:
            return None
        raise PortError(f'{settings.port} has no RS-485 support in its driver; use rs485 = "adapter"') from error


def _check_format(descriptor: int, settings: SerialSettings) -> None:
    """Drivers ignore what they do not support; only reading back shows that."""
    if flags_of(settings.format) != termios.tcgetattr(descriptor)[2] & FORMAT_FLAGS:
        raise PortError(f"{settings.port} cannot do {settings.format}: its driver set another format")


def _check_baud(descriptor: int, port: str, baud: int) -> int | None:
    """The actual rate of the port, if known; it must be near enough to `baud`."""
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
    """Wait until all has been sent; False at the deadline. Not with tcdrain, which has none.

    If RS-485 is restored then, which may switch the transmitter off, the UART must have sent the last bit too.
    """
    descriptor, deadline = device.serial.fileno(), time.monotonic() + DRAINING_DEADLINE
    while bytes_to_send(descriptor) or (device.rs485 is not None and is_sending(descriptor)):
        if time.monotonic() > deadline:
            return False
        time.sleep(0.005)
    return True
