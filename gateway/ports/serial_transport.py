"""Rare events of an open serial port: its driver takes no more for now, it is lost, it is closed.

Only this module uses pyserial-asyncio, private members included: docs/adr/0015-serial-transport.md
"""

import asyncio
from collections.abc import Callable
from functools import partial
from typing import Final

from serial_asyncio import SerialTransport

from gateway.clock.threads import ThreadPerCall
from gateway.errors import PortClosed, PortError
from gateway.ports.opening import OpenDevice, change_baud, close_device
from gateway.ports.port import PortUser

#: The most bytes that wait for a driver that takes none. A line has one frame under way.
WRITE_BOUND: Final = 16 * 1024
#: How long a closed port may still pass them to the driver, in seconds.
FLUSHING_DEADLINE: Final = 1.0


class PortTransport(SerialTransport):
    """pyserial-asyncio's transport with a bounded buffer; it never blocks.

    The loop calls `read_ready` when there is something to read. `send` passes bytes to the driver and returns how many
    it took. Both call `lose` if they find the port lost. The loop begins to read in its next turn.
    """

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        device: OpenDevice,
        user: PortUser,
        read_ready: Callable[[], None],
        send: Callable[[bytes], int],
    ) -> None:
        super().__init__(loop, asyncio.Protocol(), device.serial)
        self._read_ready = read_ready
        self._send = send
        self._device = device
        self._user: PortUser | None = user
        self._takes_no_more = PortError(f"{device.port} takes no more data")
        #: Set once the driver has closed the port.
        self.closed = asyncio.Event()

    def write(self, data: bytes | bytearray | memoryview) -> None:
        """Keep `data` until the driver takes it. Too much waiting data is a loss."""
        super().write(data)
        if self.get_write_buffer_size() > WRITE_BOUND:
            self.lose(self._takes_no_more)

    def change_baud(self, baud: int) -> None:
        """Change the rate, in a thread, because the driver may block."""
        threads = ThreadPerCall(f"baud {self._device.port}")
        self._loop.run_in_executor(threads, change_baud, self._device, baud).add_done_callback(self._baud_changed)

    def lose(self, error: PortError) -> None:
        """Close the port, and drop bytes that the driver has not taken."""
        self._abort(error)

    def close(self) -> None:
        """Close the port once the driver has taken all written bytes, or after FLUSHING_DEADLINE."""
        super().close()
        if self._write_buffer:
            self._loop.call_later(FLUSHING_DEADLINE, self.lose, self._takes_no_more)

    def _baud_changed(self, changing: asyncio.Future[None]) -> None:
        error = None if changing.cancelled() else changing.exception()
        if isinstance(error, PortError) and not self._closing:
            self.lose(error)

    def _write_ready(self) -> None:
        data = b"".join(self._write_buffer)
        rest = data[self._send(data) :]
        self._write_buffer[:] = [rest] if rest else []
        if not rest:
            self._remove_writer()
            if self._closing:
                self._close()

    def _call_connection_lost(self, exc: Exception | None) -> None:
        """Call the user's `lost`, once, and close the port in a thread, because the driver may block."""
        if self._user is None:
            return
        user, self._user = self._user, None
        self._write_buffer.clear()
        threads = ThreadPerCall(f"close {self._device.port}")
        closing = self._loop.run_in_executor(threads, partial(close_device, self._device, lost=exc is not None))
        closing.add_done_callback(lambda _: self.closed.set())
        user.lost(exc if isinstance(exc, PortError) else PortClosed())
