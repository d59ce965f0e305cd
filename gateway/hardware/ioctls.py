"""Requests to serial drivers that pyserial does not offer, by open descriptor. All of it may block."""

import errno
import fcntl
import os
import struct
import termios
from array import array
from contextlib import suppress
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

from gateway.timing.characters import CharacterFormat

#: The control flags that make up a character format.
FORMAT_FLAGS: Final = termios.CSIZE | termios.PARENB | termios.PARODD | termios.CSTOPB

#: `struct termios2`: four words of flags, the line discipline, 19 control characters, input and output rate.
_TERMIOS2: Final = struct.Struct("=4IB19s2I")
#: `struct serial_icounter_struct`: changes of CTS, DSR, RI and DCD, bytes received and sent, framing errors, overruns
#: of the UART, parity errors, breaks, overruns of the driver's buffer; the rest is reserved.
_ICOUNTER: Final = struct.Struct("=11i36x")
#: `struct serial_rs485`: flags, the delays before and after sending in milliseconds, and more.
_RS485: Final = struct.Struct("=3I20s")
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


def encode_format(format_: CharacterFormat) -> int:
    """Translate a character format into control flags."""
    data = {7: termios.CS7, 8: termios.CS8}[format_.data_bits]
    parity = {"N": 0, "E": termios.PARENB, "O": termios.PARENB | termios.PARODD}[format_.parity]
    stop = {1: 0, 2: termios.CSTOPB}[format_.stop_bits]
    return data | parity | stop


def derive_input_flags(before: int, *, checks_parity: bool) -> int:
    """Work out the input flags of a port that had `before`; with parity, damaged characters are marked.

    With the flags of `stty sane`, a break could discard received bytes, and damaged characters would be dropped.
    """
    flags = before & ~(termios.BRKINT | termios.IGNPAR | termios.PARMRK | termios.INPCK)
    return flags | termios.INPCK | termios.PARMRK if checks_parity else flags


def set_input_flags(descriptor: int, *, checks_parity: bool) -> None:
    """Set the flags of `derive_input_flags`; without parity, damaged characters are not marked."""
    attributes = termios.tcgetattr(descriptor)
    attributes[0] = derive_input_flags(attributes[0], checks_parity=checks_parity)
    termios.tcsetattr(descriptor, termios.TCSANOW, attributes)


def read_baud(descriptor: int) -> int | None:
    """Read the rate that the driver reports; None if the kernel does not support that.

    A driver that cannot set a rate reports the nearest one, or the one before; or that rate, and uses another one: see
    `derive_divided_baud`.
    """
    try:
        answer = fcntl.ioctl(descriptor, TCGETS2, bytes(_TERMIOS2.size))
    except OSError:
        return None
    return int(_TERMIOS2.unpack(answer)[-1])


def derive_divided_baud(descriptor: int, baud: int) -> int | None:
    """Work out the actual rate for `baud` of a UART that divides its clock by whole numbers.

    None for others, and for USB adapters, whose drivers may report any type of UART.
    """
    state = _read_serial_struct(descriptor)
    if state is None or state[_SERIAL_TYPE] not in _DIVIDE_BY_WHOLE_NUMBERS or is_usb(descriptor):
        return None
    return divide_clock(state[_SERIAL_BAUD_BASE], baud)


def has_redefined_38400(descriptor: int) -> bool:
    """Tell whether `setserial` has assigned another rate to 38400."""
    state = _read_serial_struct(descriptor)
    return state is not None and bool(state[_SERIAL_FLAGS] & _ASYNC_SPD_MASK)


def divide_clock(baud_base: int, baud: int) -> int | None:
    """Divide `baud_base` by the whole number that comes nearest to `baud`, rounded as in the kernel."""
    return round(baud_base / max(1, (2 * baud_base + baud) // (2 * baud))) if baud_base > 0 else None


def count_errors(descriptor: int) -> tuple[int, int, int, int] | None:
    """Read what the driver has counted since it found the port: received, framing, parity, overrun characters.

    None where it does not count.
    """
    try:
        answer = fcntl.ioctl(descriptor, termios.TIOCGICOUNT, bytes(_ICOUNTER.size))
    except OSError:
        return None
    *_, received, _sent, framing, overrun, parity, _breaks, lost = _ICOUNTER.unpack(answer)
    return received, framing, parity, overrun + lost


def count_unsent(descriptor: int) -> int:
    """Count the bytes that the driver has not sent; of a connection, those that are not confirmed (SIOCOUTQ)."""
    count = array("i", [0])
    fcntl.ioctl(descriptor, TIOCOUTQ, count)
    return count[0]


def is_sending(descriptor: int) -> bool:
    """Tell whether bytes are still in the UART, if its driver reports that."""
    state = array("i", [0])
    try:
        fcntl.ioctl(descriptor, termios.TIOCSERGETLSR, state)
    except OSError:
        return False
    return not state[0] & _TIOCSER_TEMT


def set_low_latency(descriptor: int) -> bool:
    """Set the driver's low-latency mode; False if it has none."""
    state = _read_serial_struct(descriptor)
    if state is None:
        return False
    state[_SERIAL_FLAGS] |= _ASYNC_LOW_LATENCY
    with suppress(OSError):
        fcntl.ioctl(descriptor, termios.TIOCSSERIAL, state)
    state = _read_serial_struct(descriptor)
    return state is not None and bool(state[_SERIAL_FLAGS] & _ASYNC_LOW_LATENCY)


def stop_echo(descriptor: int) -> None:
    """Keep the terminal from sending by itself: what it receives (ECHO), and characters that stop the other end."""
    attributes = termios.tcgetattr(descriptor)
    attributes[0] &= ~(termios.IXON | termios.IXOFF)
    attributes[3] &= ~(termios.ECHO | termios.ECHONL | termios.ICANON | termios.IEXTEN)
    termios.tcsetattr(descriptor, termios.TCSANOW, attributes)


def lower_modem_lines(descriptor: int) -> None:
    """Lower RTS and DTR, if the port has them.

    Raises:
        OSError: the port was lost.
    """
    try:
        fcntl.ioctl(descriptor, termios.TIOCMBIC, struct.pack("=I", termios.TIOCM_RTS | termios.TIOCM_DTR))
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTTY):
            raise


def is_usb(descriptor: int) -> bool:
    """Tell whether the port is a USB adapter."""
    device = os.fstat(descriptor).st_rdev
    subsystem = Path(f"/sys/dev/char/{os.major(device)}:{os.minor(device)}/device/subsystem").resolve()
    return subsystem.name in ("usb", "usb-serial")


def switch_rs485(descriptor: int, *, on: bool, delays: tuple[int, int] | None = None) -> bytes | None:
    """Let the driver switch the transmitter (RS-485), or leave that to the adapter.

    `delays` are from switching on to the first bit and from the last bit to switching off, in milliseconds; without
    them those of the driver stay, and it may round or ignore others: `read_rs485_delays` tells.

    Returns the setting from before, for `restore_rs485`; None if it was the same, or the driver has no RS-485.

    Raises:
        OSError: `on`, but the driver does not support it.
    """
    try:
        found = fcntl.ioctl(descriptor, TIOCGRS485, bytes(_RS485.size))
        flags, before, after, others = _RS485.unpack(found)
        wanted, delays = flags & ~SER_RS485_ENABLED, delays or (before, after)
        if on:  # RTS is high while it sends, and it does not receive itself
            wanted = flags & ~(SER_RS485_RTS_AFTER_SEND | SER_RS485_RX_DURING_TX)
            wanted |= SER_RS485_ENABLED | SER_RS485_RTS_ON_SEND
        if (wanted, delays) == (flags, (before, after)):
            return None
        restore_rs485(descriptor, _RS485.pack(wanted, *delays, others))
        now, *_ = _RS485.unpack(fcntl.ioctl(descriptor, TIOCGRS485, bytes(_RS485.size)))
    except OSError:
        if on:
            raise
        return None
    if on and not now & SER_RS485_ENABLED:
        raise OSError(errno.EOPNOTSUPP, "the driver ignores it")
    return found


def read_rs485_delays(descriptor: int) -> tuple[int, int]:
    """Return the delays that a driver keeps which switches the transmitter, as `switch_rs485` takes them.

    Raises:
        OSError: the driver has no RS-485, or the port was lost.
    """
    _, before, after, _ = _RS485.unpack(fcntl.ioctl(descriptor, TIOCGRS485, bytes(_RS485.size)))
    return before, after


def restore_rs485(descriptor: int, found: bytes) -> None:
    """Restore the setting that `switch_rs485` returned.

    Raises:
        OSError: the port was lost.
    """
    fcntl.ioctl(descriptor, TIOCSRS485, found)


def _read_serial_struct(descriptor: int) -> "array[int] | None":
    """Read the driver's `struct serial_struct`; None if it does not support that."""
    state = array("i", bytes(_SERIAL_STRUCT_SIZE))
    try:
        fcntl.ioctl(descriptor, termios.TIOCGSERIAL, state)
    except OSError:
        return None
    return state
