"""Serial ports in the event loop: pyserial-asyncio's transport, which never blocks and has bounded buffers.

The only module that uses a serial library's ports. A module for another library must pass
tests/system/test_serial_contract.py. See docs/adr/0015-serial-transport.md.
"""

import asyncio
import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

from serial import PARITY_NONE, Serial
from serial_asyncio import SerialTransport

from gateway.errors import PortClosed, PortError
from gateway.ports.exact_loop import ExactLoop
from gateway.ports.ioctls import character_errors, set_input_flags
from gateway.ports.marked import MarkedInput
from gateway.ports.opening import OpenDevice, change_baud, close_device, open_device
from gateway.ports.port import CharacterErrors, Port, PortUser, SerialSettings
from gateway.ports.reasons import DriverError, why_lost
from gateway.ports.threads import ThreadPerCall
from gateway.timing.characters import CharacterFormat

#: More than a line delivers between two looks, and little enough that Python has room for it at hand.
READ_SIZE: Final = 256
#: Bytes that may wait for a driver that takes none. A line has one frame under way.
WRITE_BOUND: Final = 16 * 1024
#: How long a closed port may go on passing them to the driver, in seconds.
FLUSHING_DEADLINE: Final = 1.0

#: Ports whose driver is still opening them, perhaps after the attempt was cancelled.
_being_opened: set[str] = set()


class ConfiguredOnce(Serial):
    """pyserial's port, which is configured only when it is opened.

    pyserial configures a port whenever a setting is assigned, and pyserial-asyncio assigns two in the event loop, where
    a USB adapter that hangs would stop everything for seconds. It also leaves parity unchecked; this corrects it.
    """

    def _reconfigure_port(self, force_update: bool = False) -> None:  # noqa: FBT001, FBT002 - pyserial's signature
        if force_update and self.fd is not None:
            super()._reconfigure_port(force_update=True)  # type: ignore[misc]  # private, so not in the stubs
            set_input_flags(self.fd, checks_parity=self.checks_parity)

    @property
    def checks_parity(self) -> bool:
        """Whether characters have a parity bit."""
        return bool(self.parity != PARITY_NONE)

    def change_baud(self, baud: int) -> None:
        """Change the rate."""
        self.baudrate = baud
        self._reconfigure_port(force_update=True)


def configured(settings: SerialSettings, format_: CharacterFormat) -> ConfiguredOnce:
    """Open, lock and configure a port; may block as long as its driver takes. Raises what pyserial raises."""
    return ConfiguredOnce(
        port=settings.port,
        baudrate=settings.baud,
        bytesize=format_.data_bits,
        parity=format_.parity,
        stopbits=format_.stop_bits,
        exclusive=True,
        # VMIN 1, VTIME 0: reading an idle port fails with EAGAIN; only a port that hung up returns end of file.
        inter_byte_timeout=0,
    )


async def open_serial(settings: SerialSettings, user: PortUser) -> Port:
    """Open a serial port for `user` and discard earlier bytes. If cancelled, nothing stays open.

    Raises:
        PortError: the port cannot be used; the message says why and what to do.
    """
    if settings.port in _being_opened:
        raise PortError(f"{settings.port}: its driver hangs in an earlier attempt to open it")
    loop = asyncio.get_running_loop()
    _being_opened.add(settings.port)
    opening = loop.run_in_executor(ThreadPerCall(f"open {settings.port}"), open_device, settings, configured)
    opening.add_done_callback(lambda _: _being_opened.discard(settings.port))
    try:
        device = await asyncio.shield(opening)
    except asyncio.CancelledError:
        opening.add_done_callback(_close_unwanted)
        raise
    return SerialPort(loop, device, user)


@contextmanager
def open_blocking(settings: SerialSettings, timeout: float) -> Iterator[Serial]:
    """A serial port without an event loop, for a library that reads and writes it.

    It is opened, locked and closed as for a line. `timeout` is for each read and write, in seconds.

    Raises:
        PortError: the port cannot be used; the message says why and what to do.
    """
    device = open_device(settings, configured)
    try:
        set_input_flags(device.serial.fileno(), checks_parity=False)  # its reader does not know marked characters
        device.serial.timeout = device.serial.write_timeout = timeout
        yield device.serial
    finally:
        if device.serial.is_open:  # the library closes a lost port
            close_device(device, lost=False)


class SerialPort(SerialTransport):
    """One open serial port.

    `latency` in seconds. `virtual`: a pseudo-terminal, which carries bytes at once instead of at the line's rate.
    """

    has_arrived = None

    def __init__(self, loop: asyncio.AbstractEventLoop, device: OpenDevice[ConfiguredOnce], user: PortUser) -> None:
        super().__init__(loop, asyncio.Protocol(), device.serial)
        self.latency = device.latency
        self.virtual = device.virtual
        self.baud = device.baud
        self._device = device
        self._descriptor = device.serial.fileno()
        self._user: PortUser | None = user
        self._received = MarkedInput(user.received).received if device.marked else user.received
        self._closed = asyncio.Event()
        #: How the loop leaves the port alone for a while; None if it has to forget it.
        self._mask = loop.mask if isinstance(loop, ExactLoop) else None
        self._is_paused = False
        self._errors_before = character_errors(self._descriptor)

    @property
    def errors(self) -> CharacterErrors | None:
        """Counters of wrong characters; None if the driver has none."""
        counted = None if self._closing else character_errors(self._descriptor)
        return None if counted is None or self._errors_before is None else counted.since(self._errors_before)

    def write(self, data: bytes | bytearray | memoryview) -> None:
        """Send `data` now; what the driver does not take at once follows later."""
        if self._closing:
            return
        sent = 0 if self._write_buffer else self._send(data)
        if sent < len(data) and not self._closing:
            self._buffer(bytes(data[sent:]))

    def pause(self) -> bool:
        """Read nothing until `read_now`."""
        if self._mask is None or not self._has_reader:
            self._remove_reader()
        elif not self._is_paused:
            self._is_paused = True
            self._mask(self._descriptor, is_masked=True)
        return True

    def read_now(self) -> None:
        """See Port."""
        if self._closing:
            return
        if self._is_paused and self._mask is not None:
            self._is_paused = False
            self._mask(self._descriptor, is_masked=False)
        self._ensure_reader()
        self._read_ready()

    def change_baud(self, baud: int) -> None:
        """Change the rate, in a thread, because the driver may block."""
        changing = self._loop.run_in_executor(
            ThreadPerCall(f"baud {self._device.port}"), change_baud, self._device, baud
        )
        changing.add_done_callback(self._baud_changed)

    def close(self) -> None:
        """Close the port once the driver has taken what was written, or after FLUSHING_DEADLINE."""
        super().close()
        if self._write_buffer:
            self._loop.call_later(FLUSHING_DEADLINE, self._abort, PortError(f"{self._device.port} takes no more data"))

    async def wait_closed(self) -> None:
        """Wait until the driver has closed the port."""
        await self._closed.wait()

    def __repr__(self) -> str:
        state = "closing" if self._closing else "open"
        return f"<SerialPort {self._device.port} {state}, {self.get_write_buffer_size()} bytes to send>"

    def _read_ready(self) -> None:
        """Deliver what is there, in pieces of READ_SIZE."""
        data = self._read()
        while len(data) == READ_SIZE and not self._closing:
            self._received(data)
            data = self._read()
        if data and not self._closing:
            self._received(data)

    def _read(self) -> bytes:
        """What the driver has; empty if that is nothing, or if the port is lost."""
        try:
            data = os.read(self._descriptor, READ_SIZE)
        except (BlockingIOError, InterruptedError):
            return b""
        except DriverError as error:
            self._abort(PortError(why_lost(self._device.port, error)))
            return b""
        if not data:
            self._abort(PortError(f"{self._device.port} is gone: unplugged, or its driver has closed it"))
        return data

    def _baud_changed(self, changing: asyncio.Future[None]) -> None:
        error = None if changing.cancelled() else changing.exception()
        if isinstance(error, PortError) and not self._closing:
            self._abort(error)

    def _send(self, data: bytes | bytearray | memoryview) -> int:
        """Write what the driver takes; returns how many bytes."""
        try:
            return os.write(self._descriptor, data)
        except (BlockingIOError, InterruptedError):
            return 0
        except DriverError as error:
            self._abort(PortError(why_lost(self._device.port, error)))
            return 0

    def _buffer(self, data: bytes) -> None:
        self._write_buffer.append(data)
        if self.get_write_buffer_size() > WRITE_BOUND:
            self._abort(PortError(f"{self._device.port} takes no more data"))
        else:
            self._ensure_writer()

    def _write_ready(self) -> None:
        data = b"".join(self._write_buffer)
        self._write_buffer.clear()
        rest = data[self._send(data) :]
        if rest:
            self._write_buffer.append(rest)
            return
        self._remove_writer()
        if self._closing:
            self._close()

    def _call_connection_lost(self, exc: Exception | None) -> None:
        """Call the user's `lost`, once, and close the port in a thread, because the driver may block."""
        if self._user is None:
            return
        user, self._user = self._user, None
        self._write_buffer.clear()
        self._close_in_thread(lost=exc is not None)
        user.lost(exc if isinstance(exc, PortError) else PortClosed())

    def _close_in_thread(self, *, lost: bool) -> None:
        threads = ThreadPerCall(f"close {self._device.port}")
        closing = self._loop.run_in_executor(threads, lambda: close_device(self._device, lost=lost))
        closing.add_done_callback(lambda _: self._closed.set())


def _close_unwanted(opening: asyncio.Future[OpenDevice[ConfiguredOnce]]) -> None:
    """Close a port after its opening was cancelled."""
    if opening.cancelled() or opening.exception() is not None:
        return
    device = opening.result()
    ThreadPerCall(f"close {device.port}").submit(close_device, device, lost=True)
