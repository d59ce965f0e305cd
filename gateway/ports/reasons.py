"""Messages about serial ports that cannot be used, each with what to do."""

import errno
import os
import termios
from typing import Final

from gateway.hardware.device_files import permission_remedy
from gateway.ports.port import SerialSettings

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


def why_not_opened(settings: SerialSettings, error: OSError | termios.error | ValueError) -> str:
    """Why the port cannot be opened, and what to do."""
    if isinstance(error, ValueError):  # pyserial could not set a custom rate
        return why_no_such_rate(settings.port, settings.baud)
    number = _errno(error)
    reason = _REASONS.get(number, "{port} cannot be opened: {error}")
    return reason.format(
        port=settings.port,
        format=settings.format,
        baud=settings.baud,
        permission=permission_remedy(settings.port),
        error=os.strerror(number),
    )


def why_no_such_rate(port: str, baud: int) -> str:
    """Why an odd rate cannot be set."""
    return f"{port} does not support {baud} baud: its driver knows standard rates only"


def why_lost(port: str, error: OSError | termios.error) -> str:
    """Why an open port was lost."""
    return f"{port} is gone: {os.strerror(_errno(error))}"


def _errno(error: BaseException) -> int:
    """The error's number, or that of its cause: pyserial wraps some errors without it."""
    if isinstance(error, OSError) and error.errno is not None:
        return error.errno
    if isinstance(error, termios.error) and error.args and isinstance(error.args[0], int):
        return error.args[0]
    return _errno(error.__context__) if error.__context__ is not None else errno.EIO
