"""Connects an upstream to its TCP connection."""

import asyncio
from collections.abc import Callable
from typing import Any

from gateway.errors import NotModbus
from gateway.events import Emit, UpstreamClosed
from gateway.lines.transaction import Transaction
from gateway.modbus.mbap import MbapFramer, encode
from gateway.ports.port import Port
from gateway.upstreams.driver import UpstreamDriver
from gateway.upstreams.upstream import Upstream


class TcpDriver(UpstreamDriver):
    """Passes bytes, time and requests to `upstream`. It is the PortOwner of the connection.

    It closes a connection that cannot be used any more; the reconnector opens the next one. When it is lost, its
    requests fail.
    """

    def __init__(self, upstream: Upstream, loop: asyncio.AbstractEventLoop, emit: Emit) -> None:
        super().__init__(upstream, loop, emit)
        self._emit = emit
        self._framer = MbapFramer(strict=True)

    def port_up(self, port: Port) -> None:
        """The connection is open."""
        self._boundary.port = port
        self._framer = MbapFramer(strict=True)
        write = port.write

        def send(identifier: int, transaction: Transaction) -> None:
            write(encode(identifier, transaction.unit, transaction.asked.data))

        self._run(self.upstream.port_up, send)

    def received(self, data: bytes, *, damaged: bool = False) -> None:  # noqa: ARG002 - TCP delivers no damaged bytes
        """These bytes were received."""
        self._run(self._take, data)

    def _take(self, data: bytes) -> None:
        self.upstream.received(self._framer.cut(data), self._time())

    def _step(self, step: Callable[..., None], *arguments: Any) -> None:
        try:
            step(*arguments)
        except NotModbus as error:
            self._close_connection(f"what came is not Modbus TCP: {error}")
        if self.upstream.is_spent:
            self._close_connection("too many answers are overdue on it")

    def _down(self) -> None:
        self.upstream.port_down(self._time())

    def _close_connection(self, reason: str) -> None:
        self._emit(UpstreamClosed(self.upstream.settings.name, reason))
        self._boundary.close_port()
