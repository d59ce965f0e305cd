"""What a serial driver can be asked and told beyond what pyserial offers. By open descriptor; all of it may block."""

import fcntl
import os
import struct
import termios
from array import array
from pathlib import Path
from typing import Final

from serial.serialposix import (
    SER_RS485_ENABLED,
    SER_RS485_RTS_AFTER_SEND,
    SER_RS485_RTS_ON_SEND,
    SER_RS485_RX_DURING_TX,
    TCGETS2,
    TIOCGRS485,
    TIOCOUTQ,
    TIOCSRS485,
)

from gateway.modbus.chartime import CharacterFormat

#: The control flags that make up a character format.
FORMAT_FLAGS: Final = termios.CSIZE | termios.PARENB | termios.PARODD | termios.CSTOPB

#: `struct termios2`: four words of flags, the line discipline, 19 control characters, input and output rate.
_TERMIOS2: Final = struct.Struct("=4IB19s2I")
#: `struct serial_struct` begins with type, line, port, irq, flags; 128 bytes hold it on every architecture.
_SERIAL_STRUCT_SIZE: Final = 128
_SERIAL_FLAGS: Final = 4
_ASYNC_LOW_LATENCY: Final = 1 << 13
#: `struct serial_rs485` is 32 bytes and begins with its flags.
_RS485_SIZE: Final = 32


def flags_of(format_: CharacterFormat) -> int:
    """The control flags for a character format."""
    data = {7: termios.CS7, 8: termios.CS8}[format_.data_bits]
    parity = {"N": 0, "E": termios.PARENB, "O": termios.PARENB | termios.PARODD}[format_.parity]
    stop = {1: 0, 2: termios.CSTOPB}[format_.stop_bits]
    return data | parity | stop


def actual_baud(descriptor: int) -> int | None:
    """The rate that the driver has set, as far as it tells; None where the kernel cannot be asked."""
    try:
        answer = fcntl.ioctl(descriptor, TCGETS2, bytes(_TERMIOS2.size))
    except OSError:
        return None
    return int(_TERMIOS2.unpack(answer)[-1])


def take_breaks_as_noise(descriptor: int) -> None:
    """A break on the line reads as a zero byte. The setting before (`stty sane`) may discard all that was received."""
    attributes = termios.tcgetattr(descriptor)
    if attributes[0] & termios.BRKINT:
        attributes[0] &= ~termios.BRKINT
        termios.tcsetattr(descriptor, termios.TCSANOW, attributes)


def bytes_to_send(descriptor: int) -> int:
    """How many bytes wait in the driver to be sent; of a connection, to be confirmed by the other end (SIOCOUTQ)."""
    count = array("i", [0])
    fcntl.ioctl(descriptor, TIOCOUTQ, count)
    return count[0]


def switch_rs485_on(descriptor: int) -> bool:
    """Have the driver switch the transmitter by RTS; False where it cannot. Delays stay as the device tree says."""
    state = array("I", bytes(_RS485_SIZE))
    try:
        fcntl.ioctl(descriptor, TIOCGRS485, state)
        state[0] &= ~(SER_RS485_RTS_AFTER_SEND | SER_RS485_RX_DURING_TX)
        state[0] |= SER_RS485_ENABLED | SER_RS485_RTS_ON_SEND
        fcntl.ioctl(descriptor, TIOCSRS485, state)
        fcntl.ioctl(descriptor, TIOCGRS485, state)
    except OSError:
        return False
    return bool(state[0] & SER_RS485_ENABLED)


def want_low_latency(descriptor: int) -> bool:
    """Have the driver hand over bytes at once; False where it cannot, or says yes and does not."""
    state = array("i", bytes(_SERIAL_STRUCT_SIZE))
    try:
        fcntl.ioctl(descriptor, termios.TIOCGSERIAL, state)
        state[_SERIAL_FLAGS] |= _ASYNC_LOW_LATENCY
        fcntl.ioctl(descriptor, termios.TIOCSSERIAL, state)
        fcntl.ioctl(descriptor, termios.TIOCGSERIAL, state)
    except OSError:
        return False
    return bool(state[_SERIAL_FLAGS] & _ASYNC_LOW_LATENCY)


def is_usb(descriptor: int) -> bool:
    """Whether the port is a USB adapter."""
    device = os.fstat(descriptor).st_rdev
    subsystem = Path(f"/sys/dev/char/{os.major(device)}:{os.minor(device)}/device/subsystem").resolve()
    return subsystem.name in ("usb", "usb-serial")
