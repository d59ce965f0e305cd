"""RS-485 in a UART's driver: the kernel switches the transmitter by RTS. All of it may block.

A driver keeps its setting when the port is closed. So it is set as a line needs it, and put back in the end.
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

#: `struct serial_rs485`: flags, two delays, and what other transceivers need.
_STATE: Final = struct.Struct("=I28s")


def switch_rs485(descriptor: int, *, on: bool) -> bytes | None:
    """Let the driver switch the transmitter, or leave that to the adapter. Delays stay as the device tree says.

    What was set before, for `put_back`; None if that was the same, or the driver knows nothing of RS-485.

    Raises:
        OSError: it is to be switched on, and the driver cannot.
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
    put_back(descriptor, _STATE.pack(wanted, others))
    if on and not _STATE.unpack(fcntl.ioctl(descriptor, TIOCGRS485, bytes(_STATE.size)))[0] & SER_RS485_ENABLED:
        raise OSError(errno.EOPNOTSUPP, "the driver passes over it")
    return found


def switched(flags: int, *, on: bool) -> int:
    """The flags of a driver that had `flags`: RTS is high while it sends, and it does not hear itself."""
    if not on:
        return flags & ~SER_RS485_ENABLED
    return flags & ~(SER_RS485_RTS_AFTER_SEND | SER_RS485_RX_DURING_TX) | SER_RS485_ENABLED | SER_RS485_RTS_ON_SEND


def put_back(descriptor: int, found: bytes) -> None:
    """Set what `switch_rs485` has found.

    Raises:
        OSError: the port is gone.
    """
    fcntl.ioctl(descriptor, TIOCSRS485, found)
