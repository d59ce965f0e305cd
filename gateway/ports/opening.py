"""Opens, checks and closes a serial device. All of it may block, and must run in a thread.

What must hold for any library works on the descriptor: docs/adr/0015-serial-transport.md
"""

import errno
import fcntl
import os
import stat
import termios
import time
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from gateway.errors import PortError
from gateway.hardware.device_files import VIRTUAL_MAJORS, advise_on_permission
from gateway.hardware.ioctls import (
    FORMAT_FLAGS,
    count_unsent,
    derive_divided_baud,
    encode_format,
    has_redefined_38400,
    is_sending,
    is_usb,
    read_baud,
    read_rs485_delays,
    restore_rs485,
    set_low_latency,
    switch_rs485,
)
from gateway.ports.port import SerialSettings
from gateway.ports.serial_device import ConfiguredOnce, ListeningDevice
from gateway.timing.characters import CharacterFormat

#: The latency that an adapter and its driver may add to a response, in seconds; the second for a USB adapter that
#: collects bytes (16 ms in an FTDI chip) and whose driver has no low-latency mode.
LATENCY: Final = 0.005
GATHERING_LATENCY: Final = 0.020
#: The largest deviation of the actual rate: half of what a character of 11 bits tolerates.
BAUD_TOLERANCE: Final = 0.025
#: How long a closed port may still send written bytes, in seconds: 256 bytes at 1200 baud.
DRAINING_DEADLINE: Final = 2.5

_VIRTUAL_FORMAT: Final = CharacterFormat(8, "N", 1)

#: The errors of drivers. SerialException is an OSError, termios.error is not.
DriverError: Final = (OSError, termios.error)

_REASONS: Final = {
    errno.ENOENT: "{port} does not exist: is the adapter plugged in?",
    errno.EACCES: "no permission for {port}: {permission}",
    errno.EPERM: "{port} is not allowed for this service: allow it with DeviceAllow= in its unit",
    errno.EBUSY: "{port} is held by another program",
    errno.EAGAIN: "{port} is held by another program",
    errno.ENXIO: "{port} has no hardware behind it",
    errno.ENODEV: "{port} has no hardware behind it",
    errno.EIO: "{port} has no hardware behind it",
    errno.ENOTTY: "{port} is not a serial port",
    errno.EINVAL: "{port} does not support {format} at {baud} baud",
}


@dataclass(frozen=True, slots=True)
class OpenDevice:
    """An open, configured serial device. `latency` in seconds; a virtual one carries bytes at once.

    `baud` is its actual rate, None if the driver does not report it; `rs485` the driver's setting to restore at the
    end.
    """

    port: str
    serial: ConfiguredOnce
    is_virtual: bool
    latency: float
    baud: int | None
    rs485: bytes | None


def open_device(settings: SerialSettings) -> OpenDevice:
    """Open and configure the port; may block as long as its driver does.

    Raises:
        PortError: it cannot be used; the message says why and what to do.
    """
    is_virtual = _is_virtual(settings)
    with ExitStack() as on_error:
        try:
            serial = _open(settings, _VIRTUAL_FORMAT if is_virtual else settings.format)
            on_error.callback(serial.close)
            device = _set_up(serial, settings, is_virtual=is_virtual)
        except (*DriverError, ValueError) as error:
            raise PortError(explain_failure(settings, error)) from error
        on_error.pop_all()
    return device


def change_baud(device: OpenDevice, baud: int) -> None:
    """Change the rate; may block as long as the driver does.

    Raises:
        PortError: the port does not support it, or was lost.
    """
    try:
        device.serial.change_baud(baud)
        _check_baud(device.serial.fileno(), device.port, baud)
    except ValueError as error:
        raise PortError(_explain_rate(device.port, baud)) from error
    except DriverError as error:
        raise PortError(explain_loss(device.port, error)) from error


def close_device(device: OpenDevice, *, lost: bool) -> None:
    """Close the port. Unless it was `lost`, what was written is sent first, within DRAINING_DEADLINE."""
    descriptor = device.serial.fileno()
    with suppress(*DriverError):  # the device is gone
        if lost or not _drain(device):
            termios.tcflush(descriptor, termios.TCIOFLUSH)
        if not device.is_virtual:
            fcntl.ioctl(descriptor, termios.TIOCNXCL)
        if device.rs485 is not None:
            restore_rs485(descriptor, device.rs485)
    device.serial.close()


def explain_failure(settings: SerialSettings, error: OSError | termios.error | ValueError) -> str:
    """Say why the port cannot be opened, and what to do."""
    if isinstance(error, ValueError):  # pyserial could not set a custom rate
        return _explain_rate(settings.port, settings.baud)
    number = _errno(error)
    reason = _REASONS.get(number, "{port} cannot be opened: {error}")
    return reason.format(
        port=settings.port,
        format=settings.format,
        baud=settings.baud,
        permission=advise_on_permission(settings.port),
        error=os.strerror(number),
    )


def explain_loss(port: str, error: OSError | termios.error) -> str:
    """Say why an open port was lost."""
    return f"{port} is gone: {os.strerror(_errno(error))}"


def _is_virtual(settings: SerialSettings) -> bool:
    try:
        status = Path(settings.port).stat()
    except OSError as error:
        raise PortError(explain_failure(settings, error)) from error
    if not stat.S_ISCHR(status.st_mode):
        raise PortError(f"{settings.port} is not a serial port")
    return os.major(status.st_rdev) in VIRTUAL_MAJORS


def _open(settings: SerialSettings, format_: CharacterFormat) -> ConfiguredOnce:
    return (ListeningDevice if settings.listens else ConfiguredOnce)(
        port=settings.port,
        baudrate=settings.baud,
        bytesize=format_.data_bits,
        parity=format_.parity,
        stopbits=format_.stop_bits,
        exclusive=True,
        # VMIN 1, VTIME 0: reading an idle port fails with EAGAIN; only a port that hung up returns end of file.
        inter_byte_timeout=0,
    )


def _set_up(serial: ConfiguredOnce, settings: SerialSettings, *, is_virtual: bool) -> OpenDevice:
    """Check the settings in the driver, and set RS-485 and low latency, which no library does."""
    descriptor = serial.fileno()
    if not is_virtual:
        _check_format(descriptor, settings)
    has_low_latency = set_low_latency(descriptor)
    latency = settings.latency
    if latency is None:
        latency = LATENCY if has_low_latency or not is_usb(descriptor) else GATHERING_LATENCY
    baud = _check_baud(descriptor, settings.port, settings.baud)
    if not is_virtual:  # a pseudo-terminal stays exclusive while its other end is open
        fcntl.ioctl(descriptor, termios.TIOCEXCL)
    before = _set_rs485(descriptor, settings)
    if settings.rs485 == "kernel":
        latency += _check_rs485_delays(descriptor, settings, before)
    return OpenDevice(settings.port, serial, is_virtual, latency, baud, before)


def _set_rs485(descriptor: int, settings: SerialSettings) -> bytes | None:
    """Set who switches the transmitter. Return the setting from before, if it differs.

    A port that only listens keeps what it found: the change itself could switch the transmitter.
    """
    if settings.listens:
        return None
    try:
        return switch_rs485(descriptor, on=settings.rs485 == "kernel", delays=settings.rs485_delay)
    except OSError as error:
        raise PortError(f'{settings.port} has no RS-485 support in its driver; use rs485 = "adapter"') from error


def _check_rs485_delays(descriptor: int, settings: SerialSettings, found: bytes | None) -> float:
    """Return the seconds by which the driver delays a request; raise PortError if they are not those of the config."""
    delays = read_rs485_delays(descriptor)
    if settings.rs485_delay not in (None, delays):
        if found is not None:
            restore_rs485(descriptor, found)
        wanted, kept = (" and ".join(f"{each} ms" for each in pair) for pair in (settings.rs485_delay, delays))
        raise PortError(f"{settings.port}: its driver cannot do rs485_delay {wanted}, it would keep {kept}")
    return sum(delays) / 1000


def _check_format(descriptor: int, settings: SerialSettings) -> None:
    """Read the format back, and raise PortError if it differs: drivers ignore what they do not support."""
    if encode_format(settings.format) != termios.tcgetattr(descriptor)[2] & FORMAT_FLAGS:
        raise PortError(f"{settings.port} cannot do {settings.format}: its driver set another format")


def _check_baud(descriptor: int, port: str, baud: int) -> int | None:
    """Return the actual rate of the port, None if unknown. Raise PortError if it is too far from `baud`."""
    if baud == 38400 and has_redefined_38400(descriptor):
        raise PortError(f"{port}: 38400 baud was given another meaning; setserial {port} spd_normal undoes that")
    told = read_baud(descriptor)
    if told is None:
        return None
    actual = derive_divided_baud(descriptor, told) or told
    if abs(actual - baud) > BAUD_TOLERANCE * baud:
        nearest = derive_divided_baud(descriptor, baud)
        instead = f"its driver set {told} instead" if nearest is None else f"the nearest it can is {nearest}"
        raise PortError(f"{port} cannot do {baud} baud: {instead}")
    return actual


def _drain(device: OpenDevice) -> bool:
    """Wait until all bytes are sent; return False at the deadline. tcdrain has no deadline.

    Before RS-485 is restored, which may switch the transmitter off, the UART must have sent the last bit too.
    """
    descriptor, deadline = device.serial.fileno(), time.monotonic() + DRAINING_DEADLINE
    while count_unsent(descriptor) or (device.rs485 is not None and is_sending(descriptor)):
        if time.monotonic() > deadline:
            return False
        time.sleep(0.005)
    return True


def _explain_rate(port: str, baud: int) -> str:
    """Make the message for a rate that the driver does not support."""
    return f"{port} does not support {baud} baud: its driver knows standard rates only"


def _errno(error: BaseException) -> int:
    """Return the error number of `error` or its causes, else EIO: pyserial wraps some errors without it."""
    if isinstance(error, OSError) and error.errno is not None:
        return error.errno
    if isinstance(error, termios.error) and error.args and isinstance(error.args[0], int):
        return error.args[0]
    return _errno(error.__context__) if error.__context__ is not None else errno.EIO
