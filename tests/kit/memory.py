"""A line in memory, for tests: the gateway's end is a Port, the test has the devices' end."""

import asyncio
from collections.abc import Callable

from gateway.errors import ConnectionEnded, PortClosed, PortError
from gateway.ports.port import CharacterErrors, Port, PortUser


class MemoryLine:
    """The devices' end of a line in memory, and the plug between the two ends.

    The gateway gets `open_port`. What it writes is added to `written` at once, and passed to `on_write` in the loop's
    next turn, because no device answers inside a write. Only opening takes time, `opens_in` seconds; `opened` is called
    after that. `has_arrived` makes it a connection: see Port.
    """

    def __init__(
        self,
        name: str = "memory",
        latency: float = 0.0,
        on_write: Callable[[bytes], None] | None = None,
        has_arrived: Callable[[], bool] | None = None,
    ) -> None:
        self.name = name
        self.latency = latency
        self.on_write = on_write
        self.has_arrived = has_arrived
        self.written = bytearray()
        self.openings = 0
        self.opens_in = 0.0
        self.opened: Callable[[], object] = lambda: None
        self.baud = 0
        self.errors: CharacterErrors | None = None
        self.is_virtual = True
        self._port: MemoryPort | None = None
        self._absent: str | None = None

    @property
    def is_open(self) -> bool:
        """Whether the gateway's end is open."""
        return self._port is not None

    async def open_port(self, user: PortUser) -> Port:
        """Open the gateway's end.

        Raises:
            PortError: the line is unplugged, or its end is open already.
        """
        if self.opens_in:
            await asyncio.sleep(self.opens_in)
        if self._absent is not None:
            raise PortError(self._absent)
        if self._port is not None:
            raise PortError(f"{self.name} is in use")
        self.openings += 1
        self._port = MemoryPort(self, user)
        self.opened()
        return self._port

    def take_written(self) -> bytes:
        """What was written since the last call."""
        written = bytes(self.written)
        self.written.clear()
        return written

    def deliver(self, data: bytes) -> None:
        """Devices send `data`; unless the port is paused, it has been received when this returns.

        Without an open port it is lost.
        """
        if self._port is not None:
            self._port.receive(data)

    def pull(self, reason: str = "unplugged") -> None:
        """Unplug the line: an open port is lost before this returns, and cannot be opened until `plug`."""
        self._absent = reason
        if self._port is not None:
            self._port.lose(PortError(reason))

    def hang_up(self, *, at_once: bool = False, unread: bool = False) -> None:
        """The server at the other end closes the connection in order; it can be opened again.

        `unread`: the gateway has not noticed yet; it does when it reads.
        """
        if self._port is not None:
            ended = ConnectionEnded(f"{self.name} has closed the connection", at_once=at_once)
            self._port.end_unread(ended) if unread else self._port.lose(ended)

    def leave_unread(self) -> None:
        """Let the gateway not notice what comes until it reads."""
        if self._port is not None:
            self._port.pause()

    def notice(self) -> None:
        """Let the gateway read what has come."""
        if self._port is not None:
            self._port.read_now()

    def plug(self) -> None:
        """Plug the line in again."""
        self._absent = None

    def take(self, data: bytes) -> None:
        """Take what the gateway wrote."""
        self.written += data
        if self.on_write is not None:
            asyncio.get_running_loop().call_soon(self.on_write, data)

    def release(self) -> None:
        """The gateway's end was closed."""
        self._port = None


class MemoryPort:
    """The gateway's end of a MemoryLine."""

    def __init__(self, line: MemoryLine, user: PortUser) -> None:
        self.latency = line.latency
        self.is_virtual = line.is_virtual
        self.has_arrived = line.has_arrived
        self.baud: int | None = None
        self.user = user
        self._line: MemoryLine | None = line
        self._is_paused = False
        self._kept = b""
        self._ended: PortError | None = None

    @property
    def errors(self) -> CharacterErrors | None:
        """What the test says."""
        return None if self._line is None else self._line.errors

    def write(self, data: bytes) -> None:
        """Send `data` now."""
        if self._line is not None:
            self._line.take(bytes(data))

    def pause(self) -> bool:
        """Buffer what the devices send until `read_now`."""
        self._is_paused = True
        return True

    def read_now(self) -> None:
        """Deliver what the devices have sent."""
        self._is_paused = False
        data, self._kept = self._kept, b""
        if data:
            self.user.received(data)
        if self._ended is not None:
            self.lose(self._ended)

    def end_unread(self, ended: PortError) -> None:
        """Let the gateway notice at its next reading that the connection has `ended`."""
        self._ended = ended

    def receive(self, data: bytes) -> None:
        """The devices send `data`."""
        if self._is_paused:
            self._kept += data
        else:
            self.user.received(data)

    def change_baud(self, baud: int) -> None:
        """Remember the rate for the test."""
        if self._line is not None:
            self._line.baud = baud

    def close(self) -> None:
        """Close the port; `lost` follows in the loop's next turn."""
        if self._detach():
            asyncio.get_running_loop().call_soon(self.user.lost, PortClosed())

    async def wait_closed(self) -> None:
        """Wait until `lost` has been called: one turn of the loop."""
        await asyncio.sleep(0)

    def lose(self, loss: PortError) -> None:
        """The line was unplugged, or the connection was closed."""
        if self._detach():
            self.user.lost(loss)

    def _detach(self) -> bool:
        """Detach from the line; False if that has happened before."""
        if self._line is None:
            return False
        self._line.release()
        self._line = None
        return True
