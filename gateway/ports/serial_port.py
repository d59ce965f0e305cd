"""An open serial port in the event loop: the part that each request uses, on its descriptor. Compiled.

Rare events are in gateway/ports/serial_transport.py. Why two: docs/adr/0015-serial-transport.md
"""

import asyncio
import re
from typing import ClassVar, Final

from gateway.clock.exact_loop import ExactLoop
from gateway.clock.system_calls import read, write
from gateway.errors import PortError
from gateway.hardware.ioctls import count_errors
from gateway.ports.opening import DriverError, OpenDevice, explain_loss
from gateway.ports.port import CharacterErrors, PortUser, Received
from gateway.ports.serial_transport import PortTransport

#: More than a line delivers between two reads, and small enough for Python's own allocator.
READ_SIZE: Final = 256
#: The pieces that a terminal keeps (N_TTY_BUF_SIZE, 4096 bytes): all that can have arrived before a read.
PIECES_OF_A_TERMINAL: Final = 16
#: The most pieces in one turn of the event loop; then others get a turn.
PIECES_IN_A_TURN: Final = 4

#: Looking them up in their module would cost as much as calling them.
_read: Final = read
_write: Final = write
_FF: Final = b"\xff"
#: FF FF is one FF. FF, NUL and a character mean a parity error, a framing error or a break.
_MARK: Final = re.compile(rb"(\xff\xff)|((?:\xff\x00.)+)", re.DOTALL)
_BEGUN: Final = (_FF, b"\xff\x00")


class SerialPort:
    """One open serial port.

    `latency` in seconds. `is_virtual`: a pseudo-terminal, which carries bytes at once instead of at the line's rate.
    """

    has_arrived: ClassVar[None] = None

    def __init__(self, loop: asyncio.AbstractEventLoop, device: OpenDevice, user: PortUser) -> None:
        self.latency = device.latency
        self.is_virtual = device.is_virtual
        self.baud = device.baud
        self._name = device.port
        self._descriptor: int = device.serial.fileno()
        self._received = MarkedInput(user.received).received if device.serial.checks_parity else user.received
        self._transport = PortTransport(loop, device, user, self._read_ready, self._send)
        #: Make the loop ignore the port for a while; None if the port must be removed from it.
        self._mask = loop.mask if isinstance(loop, ExactLoop) else None
        self._unmask = loop.unmask if isinstance(loop, ExactLoop) else None
        self._is_paused = False
        #: Whether the transport may hold unsent bytes.
        self._is_behind = False
        self._errors_before = count_errors(self._descriptor)

    @property
    def errors(self) -> CharacterErrors | None:
        """Counts of faulty characters; None if the driver has none."""
        errors = None if self._transport.is_closing() else count_errors(self._descriptor)
        if errors is None or self._errors_before is None:
            return None
        return CharacterErrors(*(now - before for now, before in zip(errors, self._errors_before, strict=True)))

    def write(self, data: bytes) -> None:
        """Send `data` now; bytes that the driver does not take at once follow later."""
        if self._transport._closing:  # noqa: SLF001 - a method would be one more call per request
            return
        self._is_behind = self._is_behind and bool(self._transport._write_buffer)  # noqa: SLF001
        if not self._is_behind:
            data = data[self._send(data) :]
        if data:
            self._is_behind = True
            self._transport.write(data)

    def pause(self) -> bool:
        """Read nothing until `read_now`. Return True."""
        if not self._is_paused and self._transport._has_reader:  # noqa: SLF001
            self._is_paused = True
            if self._mask is not None:
                self._mask(self._descriptor)
            else:
                self._transport.pause_reading()
        return True

    def read_now(self) -> None:
        """Deliver all bytes that have arrived, and from now on bytes as they come."""
        if self._transport._closing:  # noqa: SLF001
            return
        if self._is_paused:
            self._is_paused = False
            if self._unmask is not None:
                self._unmask(self._descriptor)
            else:
                self._transport.resume_reading()
        for _ in range(PIECES_OF_A_TERMINAL):
            if not self._deliver():
                return

    def change_baud(self, baud: int) -> None:
        """Change the rate; see Port."""
        self._transport.change_baud(baud)

    def close(self) -> None:
        """Close the port once the driver has taken all written bytes, or after a deadline."""
        self._transport.close()

    async def wait_closed(self) -> None:
        """Wait until the driver has closed the port."""
        await self._transport.closed.wait()

    def __repr__(self) -> str:
        state = "closing" if self._transport.is_closing() else "open"
        return f"<SerialPort {self._name} {state}, {self._transport.get_write_buffer_size()} bytes to send>"

    def _read_ready(self) -> None:
        """Deliver what is there until the user pauses, but no more than PIECES_IN_A_TURN: the loop calls again."""
        for _ in range(PIECES_IN_A_TURN):
            if not self._deliver() or self._is_paused:
                return

    def _deliver(self) -> bool:
        """Deliver READ_SIZE bytes at most. Return whether there may be more."""
        data = self._read()
        if data:
            self._received(data)
        return len(data) == READ_SIZE and not self._transport.is_closing()

    def _read(self) -> bytes:
        """Read what the driver has; empty if there is nothing, or the port is lost."""
        try:
            data = _read(self._descriptor, READ_SIZE)
        except DriverError as error:
            self._transport.lose(PortError(explain_loss(self._name, error)))
            return b""
        if data is None:
            return b""
        if not data:
            self._transport.lose(PortError(f"{self._name} is gone: unplugged, or its driver has closed it"))
        return data

    def _send(self, data: bytes) -> int:
        """Write to the driver. Return how many bytes it has taken."""
        try:
            return _write(self._descriptor, data)
        except DriverError as error:
            self._transport.lose(PortError(explain_loss(self._name, error)))
            return 0


class MarkedInput:
    """Removes a terminal's marks of damaged characters (termios(3), PARMRK), and passes on the bytes.

    Consecutive damaged characters are passed on together: for one of them, some drivers mark a whole USB packet.
    """

    def __init__(self, received: Received) -> None:
        self._received = received
        self._begun = b""

    def received(self, marked: bytes) -> None:
        """Take bytes that were read."""
        if self._begun or _FF in marked:
            self._parse(self._begun + marked)
        else:
            self._received(marked)

    def _parse(self, marked: bytes) -> None:
        self._begun = b""
        data, at = b"", 0
        for mark in _MARK.finditer(marked):
            data += marked[at : mark.start()]
            at = mark.end()
            if mark[1]:
                data += _FF
                continue
            self._pass_on(data)
            self._received(mark[2][2::3], damaged=True)
            data = b""
        data += marked[at:]
        self._begun = next((begun for begun in _BEGUN if marked.endswith(begun, at)), b"")
        self._pass_on(data.removesuffix(self._begun))

    def _pass_on(self, data: bytes) -> None:
        if data:
            self._received(data)
