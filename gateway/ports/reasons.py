"""Messages about serial ports that cannot be used, each with what to do."""

import errno
import grp
import os
import termios
from pathlib import Path
from typing import Final

from gateway.hardware.udev import udev_rule
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


#: What gives a user the right to a port, by the port's group; for pseudo-terminals that is tty.
_PERMISSION: Final = {
    "root": "it belongs to root alone; give it to the group dialout: {rule}",
    "tty": "it belongs to the group tty; for a simulated port: chgrp dialout {port}; chmod 660 {port}",
    "dialout": "add the user to the dialout group",
}
_ANOTHER_GROUP: Final = "add the user to the {group} group, the service with SupplementaryGroups={group}"


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


def permission_remedy(port: str) -> str:
    """What to do if a user may not use the port."""
    group, rule = group_of(port), udev_rule(Path(port).resolve().name)
    return _PERMISSION.get(group, _ANOTHER_GROUP).format(port=port, group=group, rule=rule)


def group_of(port: str) -> str:
    """The group that may use the port: dialout on Debian, uucp elsewhere."""
    try:
        return grp.getgrgid(Path(port).stat().st_gid).gr_name
    except (OSError, KeyError):
        return "dialout"
