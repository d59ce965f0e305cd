"""Opens, configures and closes a serial device. All of this may block, so all of it runs in a thread."""

import fcntl
import os
import stat
import termios
import time
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from serial import Serial

from gateway.errors import PortError
from gateway.modbus.chartime import CharacterFormat
from gateway.ports.ioctls import (
    FORMAT_FLAGS,
    actual_baud,
    bytes_to_send,
    flags_of,
    is_usb,
    switch_rs485_on,
    take_breaks_as_noise,
    want_low_latency,
)
from gateway.ports.port import SerialSettings
from gateway.ports.reasons import DriverError, why_lost, why_not_opened
from gateway.ports.wire import VIRTUAL_MAJORS

#: What an adapter and its driver may add to an answer, in seconds; the second where a USB adapter gathers bytes
#: (16 ms in an FTDI chip) and its driver has no low-latency mode.
LATENCY: Final = 0.005
GATHERING_LATENCY: Final = 0.020
#: How far the rate of the hardware may be from the one asked for. Half of what a character of 11 bits can bear.
BAUD_TOLERANCE: Final = 0.025
#: How long a port that is closed may go on sending what was written to it, in seconds: 256 bytes at 1200 baud.
DRAINING_DEADLINE: Final = 2.5

_VIRTUAL_FORMAT: Final = CharacterFormat(8, "N", 1)


@dataclass(frozen=True, slots=True)
class OpenDevice:
    """A serial device that is open and configured. `latency` in seconds; `virtual` carries bytes at once."""

    port: str
    serial: Serial
    virtual: bool
    latency: float


class ConfiguredOnce(Serial):
    """pyserial's port, configured when it is opened and never again.

    pyserial configures anew with every setting that is assigned, and pyserial-asyncio assigns two when it takes a port
    over: in the event loop, where a USB adapter that hangs would stop everything for seconds.
    """

    def _reconfigure_port(self, force_update: bool = False) -> None:  # noqa: FBT001, FBT002 - pyserial's signature
        if force_update:
            super()._reconfigure_port(force_update=True)  # type: ignore[misc]  # private, so not in the stubs


def open_device(settings: SerialSettings) -> OpenDevice:
    """Open and configure the port; blocks as long as its driver likes.

    Raises:
        PortError: it cannot be used, and why.
    """
    virtual = _is_virtual(settings)
    with ExitStack() as on_error:
        serial = _configured(settings, _VIRTUAL_FORMAT if virtual else settings.format)
        on_error.callback(serial.close)
        try:
            latency = _settled(serial.fileno(), settings, virtual=virtual)
        except DriverError as error:
            raise PortError(why_not_opened(settings, error)) from error
        on_error.pop_all()
    return OpenDevice(settings.port, serial, virtual, latency if settings.latency is None else settings.latency)


def change_baud(device: OpenDevice, baud: int) -> None:
    """Go on at another rate; blocks as long as the driver likes.

    Raises:
        PortError: the port cannot do it, or is gone.
    """
    serial = device.serial
    try:
        serial.baudrate = baud
        serial._reconfigure_port(force_update=True)  # type: ignore[attr-defined]  # noqa: SLF001 - see ConfiguredOnce
        _check_baud(serial.fileno(), device.port, baud)
    except DriverError as error:
        raise PortError(why_lost(device.port, error)) from error


def close_device(device: OpenDevice, *, lost: bool) -> None:
    """Close the port. What was written to one that is not lost is sent first, within DRAINING_DEADLINE."""
    descriptor = device.serial.fileno()
    with suppress(*DriverError):  # a device that is gone has nothing to send and nothing to give back
        if lost or not _drained(descriptor):
            termios.tcflush(descriptor, termios.TCIOFLUSH)
        if not device.virtual:
            fcntl.ioctl(descriptor, termios.TIOCNXCL)
    device.serial.close()


def _is_virtual(settings: SerialSettings) -> bool:
    try:
        status = Path(settings.port).stat()
    except OSError as error:
        raise PortError(why_not_opened(settings, error)) from error
    if not stat.S_ISCHR(status.st_mode):
        raise PortError(f"{settings.port} is not a serial port")
    return os.major(status.st_rdev) in VIRTUAL_MAJORS


def _configured(settings: SerialSettings, format_: CharacterFormat) -> Serial:
    try:
        return ConfiguredOnce(
            port=settings.port,
            baudrate=settings.baud,
            bytesize=format_.data_bits,
            parity=format_.parity,
            stopbits=format_.stop_bits,
            exclusive=True,
            # VMIN 1, VTIME 0: an idle port says "nothing yet" and only one that hung up says "end of file".
            inter_byte_timeout=0,
        )
    except (*DriverError, ValueError) as error:
        raise PortError(why_not_opened(settings, error)) from error


def _settled(descriptor: int, settings: SerialSettings, *, virtual: bool) -> float:
    """See to what pyserial does not: that the driver did as told, RS-485, and the least latency, which is returned."""
    take_breaks_as_noise(descriptor)
    if not virtual:
        _check_format(descriptor, settings)
    _check_baud(descriptor, settings.port, settings.baud)
    if settings.rs485 == "kernel" and not switch_rs485_on(descriptor):
        raise PortError(f'{settings.port} has no RS-485 support in its driver; use rs485 = "adapter"')
    latency = LATENCY if want_low_latency(descriptor) or not is_usb(descriptor) else GATHERING_LATENCY
    if not virtual:  # on a pseudo-terminal it would outlive us while a simulator holds the other end
        fcntl.ioctl(descriptor, termios.TIOCEXCL)
    return latency


def _check_format(descriptor: int, settings: SerialSettings) -> None:
    """Drivers pass over what they cannot do without a word; only reading back tells."""
    if flags_of(settings.format) != termios.tcgetattr(descriptor)[2] & FORMAT_FLAGS:
        raise PortError(f"{settings.port} cannot do {settings.format}: its driver set another format")


def _check_baud(descriptor: int, port: str, baud: int) -> None:
    actual = actual_baud(descriptor)
    if actual is not None and abs(actual - baud) > BAUD_TOLERANCE * baud:
        raise PortError(f"{port} cannot do {baud} baud: the nearest it can is {actual}")


def _drained(descriptor: int) -> bool:
    """Wait until all has been sent; False at the deadline. Not tcdrain: nothing ends that."""
    deadline = time.monotonic() + DRAINING_DEADLINE
    while bytes_to_send(descriptor):
        if time.monotonic() > deadline:
            return False
        time.sleep(0.005)
    return True
