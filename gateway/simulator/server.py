"""Simulated devices behind a Modbus TCP server, for programs.

async with SimulatedServer("127.0.0.1", 5502, [Profiled(1, kind)]) as server:
    ...  # its devices can be asked at server.address
"""

import asyncio
from collections.abc import Sequence
from functools import partial
from typing import Final, Self

from gateway.errors import NotModbus, PortError
from gateway.modbus import mbap
from gateway.modbus.frame import Frame
from gateway.modbus.mbap import NO_UNIT, MbapFramer, TcpFrame
from gateway.simulator.device import Device
from gateway.simulator.paced_line import Tell, ignore_frame

#: The most connections at once, and the most requests of one of them that are in progress.
MOST_CONNECTIONS: Final = 64
MOST_REQUESTS: Final = 16
#: The rate of devices that have none.
_ANY_BAUD: Final = 19200


class SimulatedServer:
    """`devices` behind a server at `host` and `port`, which exists inside the context; `port` 0 is any free one.

    A lone device also answers to the unit identifiers of servers with one unit. `tell` is called with each frame.

    Raises:
        PortError: on entering, if the address cannot be used.
    """

    def __init__(self, host: str, port: int, devices: Sequence[Device], *, tell: Tell = ignore_frame) -> None:
        self.address = (host, port)
        self.devices = tuple(devices)
        self.tell = tell
        self.connections: set[Connection] = set()

    async def __aenter__(self) -> Self:
        host, port = self.address
        loop = asyncio.get_running_loop()
        try:
            self._server = await loop.create_server(partial(Connection, self, loop), host, port)
        except OSError as error:
            raise PortError(f"{host}:{port} cannot be used: {error.strerror or error}") from error
        self.address = self._server.sockets[0].getsockname()[:2]
        return self

    async def __aexit__(self, *_: object) -> None:
        self._server.close()
        for connection in list(self.connections):
            connection.close()
        await self._server.wait_closed()

    def device(self, unit: int) -> Device | None:
        """Find the device that a request to `unit` is for."""
        if unit in NO_UNIT and len(self.devices) == 1:
            return self.devices[0]
        return next((device for device in self.devices if device.unit == unit), None)


class Connection(asyncio.BufferedProtocol):
    """One client. Beyond MOST_REQUESTS, and while it takes no responses, nothing is read from it."""

    def __init__(self, server: SimulatedServer, loop: asyncio.AbstractEventLoop) -> None:
        self._server = server
        self._loop = loop
        self._framer = MbapFramer()
        self._in_progress = 0
        self._is_stuck = False

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Take a connection, unless there are too many."""
        assert isinstance(transport, asyncio.Transport)  # noqa: S101 - create_server makes no other
        self._transport = transport
        if len(self._server.connections) >= MOST_CONNECTIONS:
            transport.abort()
            return
        self._server.connections.add(self)

    def connection_lost(self, error: Exception | None) -> None:  # noqa: ARG002 - asyncio's
        """Forget the connection."""
        self._server.connections.discard(self)

    def close(self) -> None:
        """Close the connection at once."""
        self._transport.abort()

    def get_buffer(self, sizehint: int) -> memoryview:  # noqa: ARG002 - the framer has room for whole requests
        """Return the room for the next bytes."""
        return self._framer.room()

    def buffer_updated(self, nbytes: int) -> None:
        """Take received bytes."""
        self._framer.filled(nbytes)
        self._proceed()

    def pause_writing(self) -> None:
        """Read nothing more: the client takes no responses."""
        self._is_stuck = True
        self._transport.pause_reading()

    def resume_writing(self) -> None:
        """Go on."""
        self._is_stuck = False
        self._proceed()

    def _proceed(self) -> None:
        """Execute the requests that were read, as far as possible, and read on if none is left."""
        try:
            while self._takes_requests and (adu := self._framer.next()) is not None:
                self._ask(adu)
        except NotModbus:
            self._transport.abort()
            return
        if self._takes_requests:
            self._transport.resume_reading()
        else:
            self._transport.pause_reading()

    @property
    def _takes_requests(self) -> bool:
        return self._in_progress < MOST_REQUESTS and not self._is_stuck

    def _ask(self, adu: TcpFrame) -> None:
        self._server.tell("port", mbap.encode(*adu))
        device = self._server.device(adu.unit)
        if device is None:
            return
        answer = device.receive(Frame(device.unit, adu.pdu), self._loop.time(), _ANY_BAUD)
        if answer is None:
            return
        self._in_progress += 1
        self._loop.call_later(answer.delay, self._respond, mbap.encode(adu.transaction, adu.unit, answer.frame.pdu))

    def _respond(self, response: bytes) -> None:
        self._in_progress -= 1
        if self._transport.is_closing():
            return
        self._server.tell("device", response)
        self._transport.write(response)
        self._proceed()
