"""An open serial port in the event loop: it never blocks, and its buffers are bounded. Compiled.

It knows the descriptor, and no library: docs/adr/0015-serial-transport.md
"""

import asyncio
import os
from typing import Any, ClassVar, Final

from gateway.errors import PortClosed, PortError
from gateway.ports.exact_loop import ExactLoop
from gateway.ports.ioctls import character_errors
from gateway.ports.marked import MarkedInput
from gateway.ports.opening import OpenDevice, change_baud, close_device
from gateway.ports.port import CharacterErrors, PortUser
from gateway.ports.reasons import DriverError, why_lost
from gateway.ports.threads import ThreadPerCall

#: More than a line delivers between two looks, and little enough that Python has room for it at hand.
READ_SIZE: Final = 256
#: Bytes that may wait for a driver that takes none. A line has one frame under way.
WRITE_BOUND: Final = 16 * 1024
#: How long a closed port may go on passing them to the driver, in seconds.
FLUSHING_DEADLINE: Final = 1.0


class SerialPort:
    """One open serial port.

    `latency` in seconds. `virtual`: a pseudo-terminal, which carries bytes at once instead of at the line's rate.
    """

    has_arrived: ClassVar[None] = None

    def __init__(self, loop: asyncio.AbstractEventLoop, device: OpenDevice[Any], user: PortUser) -> None:
        self.latency = device.latency
        self.virtual = device.virtual
        self.baud = device.baud
        self._loop = loop
        self._device = device
        self._descriptor: int = device.serial.fileno()
        self._user: PortUser | None = user
        self._received = MarkedInput(user.received).received if device.marked else user.received
        #: What the driver has not taken yet.
        self._unsent = b""
        self._is_closing = False
        self._closed = asyncio.Event()
        #: How the loop leaves the port alone for a while; None if it has to forget it.
        self._mask = loop.mask if isinstance(loop, ExactLoop) else None
        self._is_known = False
        self._is_read = False
        self._errors_before = character_errors(self._descriptor)
        loop.call_soon(self._watch)

    @property
    def errors(self) -> CharacterErrors | None:
        """Counters of wrong characters; None if the driver has none."""
        counted = None if self._is_closing else character_errors(self._descriptor)
        return None if counted is None or self._errors_before is None else counted.since(self._errors_before)

    def write(self, data: bytes) -> None:
        """Send `data` now; what the driver does not take at once follows later."""
        if self._is_closing:
            return
        if not self._unsent:
            data = data[self._send(data) :]
        if data and not self._is_closing:
            self._keep(data)

    def pause(self) -> bool:
        """Read nothing until `read_now`."""
        if self._is_read:
            self._is_read = False
            if self._mask is not None:
                self._mask(self._descriptor, is_masked=True)
            else:
                self._forget()
        return True

    def read_now(self) -> None:
        """See Port."""
        self._watch()
        self._read_ready()

    def change_baud(self, baud: int) -> None:
        """Change the rate, in a thread, because the driver may block."""
        changing = self._loop.run_in_executor(
            ThreadPerCall(f"baud {self._device.port}"), change_baud, self._device, baud
        )
        changing.add_done_callback(self._baud_changed)

    def close(self) -> None:
        """Close the port once the driver has taken what was written, or after FLUSHING_DEADLINE."""
        if self._is_closing:
            return
        self._is_closing = True
        self._forget()
        if self._unsent:
            self._loop.call_later(FLUSHING_DEADLINE, self._abort, PortError(f"{self._device.port} takes no more data"))
        else:
            self._loop.call_soon(self._end, PortClosed())

    async def wait_closed(self) -> None:
        """Wait until the driver has closed the port."""
        await self._closed.wait()

    def __repr__(self) -> str:
        state = "closing" if self._is_closing else "open"
        return f"<SerialPort {self._device.port} {state}, {len(self._unsent)} bytes to send>"

    def _watch(self) -> None:
        """Have the loop read what comes from now on."""
        if self._is_read or self._is_closing:
            return
        self._is_read = True
        if self._is_known and self._mask is not None:
            self._mask(self._descriptor, is_masked=False)
        else:
            self._is_known = True
            self._loop.add_reader(self._descriptor, self._read_ready)

    def _forget(self) -> None:
        """Have the loop read nothing any more."""
        if self._is_known:
            self._is_known = self._is_read = False
            self._loop.remove_reader(self._descriptor)

    def _read_ready(self) -> None:
        """Deliver what is there, in pieces of READ_SIZE."""
        size = READ_SIZE
        while size == READ_SIZE and not self._is_closing:
            data = self._read()
            size = len(data)
            if size and not self._is_closing:
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

    def _baud_changed(self, changing: "asyncio.Future[None]") -> None:
        error = None if changing.cancelled() else changing.exception()
        if isinstance(error, PortError) and not self._is_closing:
            self._abort(error)

    def _send(self, data: bytes) -> int:
        """Write what the driver takes; returns how many bytes."""
        try:
            return os.write(self._descriptor, data)
        except (BlockingIOError, InterruptedError):
            return 0
        except DriverError as error:
            self._abort(PortError(why_lost(self._device.port, error)))
            return 0

    def _keep(self, data: bytes) -> None:
        """Keep `data` until the driver takes it."""
        if not self._unsent:
            self._loop.add_writer(self._descriptor, self._write_ready)
        self._unsent += data
        if len(self._unsent) > WRITE_BOUND:
            self._abort(PortError(f"{self._device.port} takes no more data"))

    def _write_ready(self) -> None:
        sent = self._send(self._unsent)
        self._unsent = self._unsent[sent:]
        if self._unsent or not sent:
            return
        self._loop.remove_writer(self._descriptor)
        if self._is_closing:
            self._end(PortClosed())

    def _abort(self, error: PortError) -> None:
        """Close the port, and drop what the driver has not taken."""
        if self._user is None:
            return  # another port may have the descriptor
        self._is_closing = True
        self._forget()
        if self._unsent:
            self._unsent = b""
            self._loop.remove_writer(self._descriptor)
        self._loop.call_soon(self._end, error)

    def _end(self, error: PortError) -> None:
        """Call the user's `lost`, once, and close the port in a thread, because the driver may block."""
        if self._user is None:
            return
        user, self._user = self._user, None
        threads = ThreadPerCall(f"close {self._device.port}")
        is_lost = not isinstance(error, PortClosed)
        closing = self._loop.run_in_executor(threads, lambda: close_device(self._device, lost=is_lost))
        closing.add_done_callback(lambda _: self._closed.set())
        user.lost(error)
