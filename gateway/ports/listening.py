"""A port that never sends: that of a line which only listens."""

import io
from collections.abc import Callable
from typing import NoReturn

from gateway.ports.port import CharacterErrors, OpenPort, Port, PortUser


def open_to_listen(open_port: OpenPort) -> OpenPort:
    """Make the function that opens the same port as one that never sends."""

    async def open_listening(user: PortUser) -> Port:
        return ListeningPort(await open_port(user))

    return open_listening


class ListeningPort:
    """Another port without its ways to send or to change anything: they raise `io.UnsupportedOperation`."""

    def __init__(self, port: Port) -> None:
        self.latency = port.latency
        self.is_virtual = port.is_virtual
        self.baud = port.baud
        self._port = port
        self.pause = port.pause
        self.read_now = port.read_now
        self.close = port.close
        self.wait_closed = port.wait_closed

    @property
    def has_arrived(self) -> Callable[[], bool] | None:
        """Nothing is written, so nothing has to arrive."""
        return None

    @property
    def errors(self) -> CharacterErrors | None:
        """Counts of faulty characters; None if the driver has none."""
        return self._port.errors

    def write(self, data: bytes) -> NoReturn:  # noqa: ARG002 - Port's signature
        """Refuse to send."""
        raise io.UnsupportedOperation("a line that only listens has nothing to send")

    def change_baud(self, baud: int) -> NoReturn:  # noqa: ARG002 - Port's signature
        """Refuse to change the rate."""
        raise io.UnsupportedOperation("the rate of a line that only listens is that of its bus")

    def __repr__(self) -> str:
        return f"<ListeningPort of {self._port!r}>"
