"""Opens the port of a line, serial or TCP, in the event loop.

Only this module chooses the library for serial ports. Another library must pass tests/system/test_serial_contract.py.
"""

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from threading import Event
from typing import Final

from serial import Serial

from gateway.clock.threads import ThreadPerCall
from gateway.errors import PortError
from gateway.hardware.ioctls import set_input_flags
from gateway.ports.listening import open_to_listen
from gateway.ports.opening import OpenDevice, close_device, open_device
from gateway.ports.port import OpenPort, Port, PortSettings, PortUser, PtySettings, SerialSettings, TcpSettings
from gateway.ports.pty_link import open_pty
from gateway.ports.serial_port import SerialPort
from gateway.ports.tcp import open_tcp
from gateway.tls.store import TlsStore

#: How long a cancelled attempt waits for the driver, in seconds: what comes next may open the port at once.
_UNWANTED_TIME: Final = 0.5
#: Ports whose driver is still opening them, perhaps after the attempt was cancelled.
_being_opened: set[str] = set()


def make_opener(settings: PortSettings, store: TlsStore | None = None, folder: Path = Path()) -> OpenPort:
    """Make the function that opens a port with these settings.

    For TLS its context is looked up in `store`. `folder` has the links of virtual ports.
    """
    if isinstance(settings, PtySettings):
        return partial(open_pty, settings, folder)
    open_port = _make_sending(settings, store)
    return open_to_listen(open_port) if settings.listens else open_port


def _make_sending(settings: SerialSettings | TcpSettings, store: TlsStore | None) -> OpenPort:
    if not isinstance(settings, TcpSettings):
        return partial(open_serial, settings)
    tls = settings.tls
    if tls is None or store is None:
        return partial(open_tcp, settings)
    return lambda user: open_tcp(settings, user, store[tls].context)


async def open_serial(settings: SerialSettings, user: PortUser) -> Port:
    """Open a serial port for `user` and discard bytes received before. If cancelled, nothing stays open.

    Raises:
        PortError: the port cannot be used; the message says why and what to do.
    """
    if settings.port in _being_opened:
        raise PortError(f"{settings.port}: its driver hangs in an earlier attempt to open it")
    loop = asyncio.get_running_loop()
    _being_opened.add(settings.port)
    is_unwanted = Event()
    opening = loop.run_in_executor(ThreadPerCall(f"open {settings.port}"), _open, settings, is_unwanted)
    try:
        device = await asyncio.shield(opening)
    except asyncio.CancelledError:
        is_unwanted.set()
        is_closed = asyncio.Event()
        opening.add_done_callback(partial(_close_unwanted, loop, is_closed))
        with suppress(TimeoutError):
            async with asyncio.timeout(_UNWANTED_TIME):
                await is_closed.wait()
        raise
    return SerialPort(loop, device, user)


@contextmanager
def open_blocking(settings: SerialSettings, timeout: float) -> Iterator[Serial]:
    """Open a serial port without an event loop, for a library that reads and writes it.

    It is opened, locked and closed like a line's port. `timeout` is for each read and write, in seconds.

    Raises:
        PortError: the port cannot be used; the message says why and what to do.
    """
    device = open_device(settings)
    try:
        set_input_flags(device.serial.fileno(), checks_parity=False)  # the library knows no marks
        device.serial.timeout = device.serial.write_timeout = timeout
        yield device.serial
    finally:
        if device.serial.is_open:  # the library closes a lost port
            close_device(device, lost=False)


def _open(settings: SerialSettings, is_unwanted: Event) -> OpenDevice:
    """Open a port; close it again if it is unwanted by then: there may be no event loop any more."""
    try:
        device = open_device(settings)
    finally:
        _being_opened.discard(settings.port)
    if is_unwanted.is_set():
        close_device(device, lost=True)
        raise PortError(f"{settings.port} is not wanted any more")
    return device


def _close_unwanted(
    loop: asyncio.AbstractEventLoop, is_closed: asyncio.Event, opening: asyncio.Future[OpenDevice]
) -> None:
    """Close a port that was open already when its opening was cancelled; then set `is_closed`."""
    if opening.cancelled() or opening.exception() is not None:
        is_closed.set()
        return
    device = opening.result()
    close = partial(close_device, device, lost=True)
    closing = loop.run_in_executor(ThreadPerCall(f"close {device.port}"), close)
    closing.add_done_callback(lambda _: is_closed.set())
