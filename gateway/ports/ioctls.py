"""What a serial driver can be asked and told beyond what pyserial offers. By open descriptor; all of it may block."""

import fcntl
import os
import struct
import termios
from array import array
from contextlib import suppress
from pathlib import Path
from typing import Final

from serial.serialposix import TCGETS2, TIOCOUTQ

from gateway.timing.characters import CharacterFormat

#: The control flags that make up a character format.
FORMAT_FLAGS: Final = termios.CSIZE | termios.PARENB | termios.PARODD | termios.CSTOPB

#: `struct termios2`: four words of flags, the line discipline, 19 control characters, input and output rate.
_TERMIOS2: Final = struct.Struct("=4IB19s2I")
#: `struct serial_struct` begins with these words; 128 bytes hold it on every architecture.
_SERIAL_STRUCT_SIZE: Final = 128
_SERIAL_TYPE: Final = 0
_SERIAL_FLAGS: Final = 4
_SERIAL_BAUD_BASE: Final = 7
_ASYNC_LOW_LATENCY: Final = 1 << 13
#: The UART is empty.
_TIOCSER_TEMT: Final = 1
#: What `setserial` sets with spd_hi, spd_vhi, spd_shi, spd_warp and spd_cust.
_ASYNC_SPD_MASK: Final = 0x1030
#: `PORT_16450`, `PORT_16550`, `PORT_16550A`, `PORT_16650`, `PORT_16650V2`, `PORT_16750` of the kernel's serial_core.h.
#: Other UARTs can divide their clock by fractions too.
_DIVIDE_BY_WHOLE_NUMBERS: Final = frozenset({2, 3, 4, 6, 7, 8})


def flags_of(format_: CharacterFormat) -> int:
    """The control flags for a character format."""
    data = {7: termios.CS7, 8: termios.CS8}[format_.data_bits]
    parity = {"N": 0, "E": termios.PARENB, "O": termios.PARENB | termios.PARODD}[format_.parity]
    stop = {1: 0, 2: termios.CSTOPB}[format_.stop_bits]
    return data | parity | stop


def input_flags(before: int, *, checks_parity: bool) -> int:
    """The input flags of a port that had `before`. Who checks parity has damaged characters marked (ports/marked.py).

    Left as they were (`stty sane`), a break could discard all that was received, and a damaged character be left out.
    """
    flags = before & ~(termios.BRKINT | termios.IGNPAR | termios.PARMRK | termios.INPCK)
    return flags | termios.INPCK | termios.PARMRK if checks_parity else flags


def set_input_flags(descriptor: int, *, checks_parity: bool) -> None:
    """Set what `input_flags` says; without parity, damaged characters are taken as they come."""
    attributes = termios.tcgetattr(descriptor)
    attributes[0] = input_flags(attributes[0], checks_parity=checks_parity)
    termios.tcsetattr(descriptor, termios.TCSANOW, attributes)


def actual_baud(descriptor: int) -> int | None:
    """The rate that the driver says it has set; None where the kernel cannot be asked.

    One that cannot do the rate tells the nearest, or the one from before, or repeats it and runs at `divided_baud`.
    """
    try:
        answer = fcntl.ioctl(descriptor, TCGETS2, bytes(_TERMIOS2.size))
    except OSError:
        return None
    return int(_TERMIOS2.unpack(answer)[-1])


def divided_baud(descriptor: int, baud: int) -> int | None:
    """The rate at which a UART runs that is asked for `baud`, where it divides its clock by whole numbers.

    None for all others, and for USB adapters: their drivers may pretend to be any UART.
    """
    state = _serial_struct(descriptor)
    if state is None or state[_SERIAL_TYPE] not in _DIVIDE_BY_WHOLE_NUMBERS or is_usb(descriptor):
        return None
    return divided(state[_SERIAL_BAUD_BASE], baud)


def has_redefined_38400(descriptor: int) -> bool:
    """Whether somebody has told the driver to run at another rate when it is asked for 38400, with `setserial`."""
    state = _serial_struct(descriptor)
    return state is not None and bool(state[_SERIAL_FLAGS] & _ASYNC_SPD_MASK)


def divided(baud_base: int, baud: int) -> int | None:
    """`baud_base` divided by the whole number that gets nearest to `baud`, rounded as the kernel does it."""
    return round(baud_base / max(1, (2 * baud_base + baud) // (2 * baud))) if baud_base > 0 else None


def bytes_to_send(descriptor: int) -> int:
    """How many bytes wait in the driver to be sent; of a connection, to be confirmed by the other end (SIOCOUTQ)."""
    count = array("i", [0])
    fcntl.ioctl(descriptor, TIOCOUTQ, count)
    return count[0]


def is_sending(descriptor: int) -> bool:
    """Whether bytes that have left the driver are still in the UART, as far as it tells."""
    state = array("i", [0])
    try:
        fcntl.ioctl(descriptor, termios.TIOCSERGETLSR, state)
    except OSError:
        return False
    return not state[0] & _TIOCSER_TEMT


def want_low_latency(descriptor: int) -> bool:
    """Have the driver hand over bytes at once; False where it cannot, or says yes and does not."""
    state = _serial_struct(descriptor)
    if state is None:
        return False
    state[_SERIAL_FLAGS] |= _ASYNC_LOW_LATENCY
    with suppress(OSError):
        fcntl.ioctl(descriptor, termios.TIOCSSERIAL, state)
    state = _serial_struct(descriptor)
    return state is not None and bool(state[_SERIAL_FLAGS] & _ASYNC_LOW_LATENCY)


def is_usb(descriptor: int) -> bool:
    """Whether the port is a USB adapter."""
    device = os.fstat(descriptor).st_rdev
    subsystem = Path(f"/sys/dev/char/{os.major(device)}:{os.minor(device)}/device/subsystem").resolve()
    return subsystem.name in ("usb", "usb-serial")


def _serial_struct(descriptor: int) -> "array[int] | None":
    """What TIOCGSERIAL tells; None where the driver does not know it."""
    state = array("i", bytes(_SERIAL_STRUCT_SIZE))
    try:
        fcntl.ioctl(descriptor, termios.TIOCGSERIAL, state)
    except OSError:
        return None
    return state
