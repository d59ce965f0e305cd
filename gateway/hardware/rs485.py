"""RS-485 in a UART's driver: the kernel switches the transmitter by RTS. All of it may block.

A driver keeps its setting when the port is closed, so the setting from before is restored then.
"""

import errno
import fcntl
import struct
from typing import Final

from serial.serialposix import (
    SER_RS485_ENABLED,
    SER_RS485_RTS_AFTER_SEND,
    SER_RS485_RTS_ON_SEND,
    SER_RS485_RX_DURING_TX,
    TIOCGRS485,
    TIOCSRS485,
)

#: `struct serial_rs485`: flags, two delays, and more.
_STATE: Final = struct.Struct("=I28s")


def switch_rs485(descriptor: int, *, on: bool) -> bytes | None:
    """Let the driver switch the transmitter, or leave that to the adapter. Delays stay unchanged.

    Returns the setting from before, for `restore_rs485`; None if it was the same, or the driver has no RS-485.

    Raises:
        OSError: `on`, but the driver does not support it.
    """
    try:
        found = fcntl.ioctl(descriptor, TIOCGRS485, bytes(_STATE.size))
    except OSError:
        if on:
            raise
        return None
    flags, others = _STATE.unpack(found)
    wanted = switched(flags, on=on)
    if wanted == flags:
        return None
    restore_rs485(descriptor, _STATE.pack(wanted, others))
    if on and not _STATE.unpack(fcntl.ioctl(descriptor, TIOCGRS485, bytes(_STATE.size)))[0] & SER_RS485_ENABLED:
        raise OSError(errno.EOPNOTSUPP, "the driver ignores it")
    return found


def switched(flags: int, *, on: bool) -> int:
    """The new flags instead of `flags`: RTS is high while it sends, and it does not receive itself."""
    if not on:
        return flags & ~SER_RS485_ENABLED
    return flags & ~(SER_RS485_RTS_AFTER_SEND | SER_RS485_RX_DURING_TX) | SER_RS485_ENABLED | SER_RS485_RTS_ON_SEND


def restore_rs485(descriptor: int, found: bytes) -> None:
    """Restore the setting that `switch_rs485` returned.

    Raises:
        OSError: the port was lost.
    """
    fcntl.ioctl(descriptor, TIOCSRS485, found)
