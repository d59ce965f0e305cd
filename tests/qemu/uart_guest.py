"""What qemu/uart.py runs in the machine: prints a line for each check, `ok` or what was seen instead."""

import asyncio
import fcntl
import os
import struct
import sys
import termios
from array import array

from serial.serialposix import SER_RS485_ENABLED, SER_RS485_RTS_ON_SEND, TIOCGRS485, TIOCSRS485

from gateway.errors import PortError
from gateway.hardware.ioctls import FORMAT_FLAGS, encode_format, read_rs485_delays
from gateway.ports.opener import make_opener
from gateway.ports.port import SerialSettings
from gateway.timing.characters import CharacterFormat

PARITY = termios.INPCK | termios.IGNPAR | termios.PARMRK | termios.BRKINT
ROUNDS_OF_LISTENING = 10
SPD_VHI, SPD_MASK = 0x20, 0x1030


class User:
    """Notes what the port hands over."""

    def __init__(self):
        self.heard = b""

    def received(self, data, *, damaged=False):
        self.heard += b"<damaged>" if damaged else data

    def lost(self, error):
        pass


def check(what, seen, expected):
    print(f"{'ok' if seen == expected else 'FAILED'}: {what}: {seen!r}, expected {expected!r}", flush=True)


class Held:
    """The port as the gateway holds it, and a descriptor beside it, as `stty -F` has one."""

    def __init__(self, port, format_="8E1", baud=19200, rs485="adapter", **others):
        self.settings = SerialSettings(port, baud, CharacterFormat.parse(format_), rs485, **others)
        self.user = User()

    async def __aenter__(self):
        self.port = await make_opener(self.settings)(self.user)
        return self

    async def __aexit__(self, *_):
        self.port.close()
        await self.port.wait_closed()


async def opening(port, **settings):
    """What comes of it when the gateway opens the port."""
    try:
        async with Held(port, **settings) as held:
            return f"opened, at {held.port.baud} baud"
    except PortError as error:
        return str(error)


async def check_parity(port, beside):
    for format_ in ("7E1", "8E1", "7O1", "8O1", "8N1", "8N2"):
        flags = termios.tcgetattr(beside)
        flags[0] |= termios.IGNPAR | termios.PARMRK | termios.BRKINT
        termios.tcsetattr(beside, termios.TCSANOW, flags)
        async with Held(port, format_) as held:
            expected = 0 if "N" in format_ else termios.INPCK | termios.PARMRK
            check(f"input flags, {format_}", termios.tcgetattr(beside)[0] & PARITY, expected)
            check(
                f"format, {format_}", termios.tcgetattr(beside)[2] & FORMAT_FLAGS, encode_format(held.settings.format)
            )
            held.port.change_baud(9600)
            await asyncio.sleep(0.3)
            check(f"input flags at another rate, {format_}", termios.tcgetattr(beside)[0] & PARITY, expected)


async def check_rates(port):
    for baud, actual in ((1200, 1200), (14400, 14400), (38400, 38400), (115200, 115200), (1000, 1002), (5000, 5009)):
        check(f"rate, {baud}", await opening(port, baud=baud), f"opened, at {actual} baud")
    for baud, nearest in ((12345, 12800), (33333, 38400), (76800, 57600), (100000, 115200), (250000, 115200)):
        reason = f"{port} cannot do {baud} baud: the nearest it can is {nearest}"
        check(f"rate, {baud}", await opening(port, baud=baud), reason)


def set_serial_flags(descriptor, change):
    state = array("i", bytes(128))
    fcntl.ioctl(descriptor, termios.TIOCGSERIAL, state)
    state[4] = change(state[4])
    fcntl.ioctl(descriptor, termios.TIOCSSERIAL, state)


async def check_setserial(port, beside):
    set_serial_flags(beside, lambda flags: flags | SPD_VHI)
    reason = f"{port}: 38400 baud was given another meaning; setserial {port} spd_normal undoes that"
    check("38400 with spd_vhi", await opening(port, baud=38400), reason)
    set_serial_flags(beside, lambda flags: flags & ~SPD_MASK)
    check("38400 with spd_normal", await opening(port, baud=38400), "opened, at 38400 baud")


async def check_break(port):
    async with Held(port, "7E1") as held:
        print("send a break", flush=True)
        for _ in range(100):
            await asyncio.sleep(0.1)
            if held.user.heard.endswith(b"B"):
                break
        check("what is heard of A, a break, B", held.user.heard, b"A<damaged>B")


def rs485(descriptor, flags=None):
    if flags is not None:
        fcntl.ioctl(descriptor, TIOCSRS485, struct.pack("=I28x", flags))
    return struct.unpack("=I28x", fcntl.ioctl(descriptor, TIOCGRS485, bytes(32)))[0]


async def check_rs485(port, beside):
    on = SER_RS485_ENABLED | SER_RS485_RTS_ON_SEND
    check("RS-485 before", rs485(beside) & SER_RS485_ENABLED, 0)
    async with Held(port, rs485="kernel"):
        check("RS-485, kernel", rs485(beside) & on, on)
    check("RS-485 after kernel", rs485(beside) & SER_RS485_ENABLED, 0)
    found = rs485(beside, on)
    async with Held(port):
        check("RS-485, adapter", rs485(beside) & SER_RS485_ENABLED, 0)
    check("RS-485 after adapter", rs485(beside), found)
    async with Held(port, listens=True):
        check("RS-485, listening, found on", rs485(beside), found)
    async with Held(port, rs485="kernel"):
        check("RS-485, kernel, found on", rs485(beside) & on, on)
    check("RS-485 after kernel, found on", rs485(beside), found)
    async with Held(port, rs485="kernel", latency=0.0, rs485_delay=(3, 1)) as held:
        check("RS-485, delays", (read_rs485_delays(beside), held.port.latency), ((3, 1), 0.004))
    check("RS-485, delays after kernel", read_rs485_delays(beside), (0, 0))
    reason = f"{port}: its driver cannot do rs485_delay 3 ms and 101 ms, it would keep 3 ms and 100 ms"
    check("RS-485, longer delays", await opening(port, rs485="kernel", rs485_delay=(3, 101)), reason)


def modem_lines(descriptor):
    state = struct.unpack("=I", fcntl.ioctl(descriptor, termios.TIOCMGET, bytes(4)))[0]
    return state & (termios.TIOCM_RTS | termios.TIOCM_DTR)


def set_echo(port):
    """Leave the terminal as one is that nobody has set: it sends what it receives."""
    descriptor = os.open(port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    attributes = termios.tcgetattr(descriptor)
    attributes[3] |= termios.ECHO | termios.ICANON
    termios.tcsetattr(descriptor, termios.TCSANOW, attributes)
    os.close(descriptor)


async def ask(wish):
    """Have the host do something, and give it time for that."""
    print(wish, flush=True)
    await asyncio.sleep(0.3)


async def listen_to_talk(port, *, from_before):
    """Open the port to listen, before others talk or while they do; they are silent and heard to the end after it."""
    if from_before:
        await ask("talk")
    async with Held(port, "8N1", listens=True) as held:
        if not from_before:
            await ask("talk")
        await ask("be silent")
        check("whether talk is heard", bool(held.user.heard), True)


async def check_listening(port):
    """Whatever is sent meanwhile is heard by the host."""
    set_echo(port)
    await listen_to_talk(port, from_before=False)
    for _ in range(ROUNDS_OF_LISTENING):
        await listen_to_talk(port, from_before=True)
    await ask("nothing was sent")
    beside = os.open(port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    check("lines of a port that may send", modem_lines(beside), termios.TIOCM_RTS | termios.TIOCM_DTR)
    async with Held(port, listens=True):
        check("lines of a port that listens", modem_lines(beside), 0)
    attributes = termios.tcgetattr(beside)
    attributes[4] = attributes[5] = termios.B0
    termios.tcsetattr(beside, termios.TCSANOW, attributes)
    async with Held(port, listens=True):
        check("lines of a port that listens and had no rate before", modem_lines(beside), 0)
    os.close(beside)


async def main(port, kind):
    print("booted", flush=True)  # in one line with what the machine said before
    await check_listening(port)
    beside = os.open(port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    await check_parity(port, beside)
    await check_break(port)
    if kind == "8250":
        await check_rates(port)
        await check_setserial(port, beside)
        reason = f'{port} has no RS-485 support in its driver; use rs485 = "adapter"'
        check("RS-485, kernel", await opening(port, rs485="kernel"), reason)
    else:
        await check_rs485(port, beside)
    print("done", flush=True)


asyncio.run(main(*sys.argv[1:]))
