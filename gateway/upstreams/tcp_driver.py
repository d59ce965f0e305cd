"""Connects an upstream to its TCP connection."""

import asyncio
from collections.abc import Callable
from functools import partial
from typing import Any

from gateway.errors import NotModbus
from gateway.events import Emit, UpstreamClosed
from gateway.lines.transaction import Transaction
from gateway.modbus.mbap import MbapFramer, encode
from gateway.ports.port import OpenAgain, Port
from gateway.upstreams.driver import UpstreamDriver
from gateway.upstreams.upstream import Upstream


class TcpDriver(UpstreamDriver):
    """Passes bytes, time and requests to `upstream`. It is the PortOwner of the connection.

    It closes a connection that cannot be used any more; the reconnector opens the next one. When it is lost, its
    requests fail. One that ends while nothing is under way is opened again for the next request.
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
        self._run(self.upstream.tick, self._time())

    def port_ended(self, open_again: OpenAgain, *, at_once: bool) -> bool:
        """See PortOwner."""
        self._boundary.port = None
        self._run(partial(self.upstream.port_ended, at_once=at_once), open_again, self._time())
        return self.upstream.is_closed

    def received(self, data: bytes, *, damaged: bool = False) -> None:  # noqa: ARG002 - TCP delivers no damaged bytes
        """These bytes were received."""
        self._run(self._take, data)

    def _take(self, data: bytes) -> None:
        self.upstream.received(self._framer.cut(data), self._time())

    def _tick(self) -> None:
        if self._framer.unfinished and self._is_stuck():
            came = f"{self._framer.unfinished} bytes came of it{self._framer.hint}"
            self._renew(f"a response was cut, or its length is wrong: {came}")
        super()._tick()

    def _step(self, step: Callable[..., None], *arguments: Any) -> None:
        try:
            step(*arguments)
        except NotModbus as error:
            self._tell(f"what came is not Modbus TCP: {error}")
            self._boundary.close_port()
        if self.upstream.is_spent:
            self._renew("too many answers are overdue on it")

    def _down(self) -> None:
        self.upstream.port_down(self._time())

    def _is_stuck(self) -> bool:
        """Whether a request times out, and what is unfinished is no response that may still be completed in time."""
        awaited = self.upstream.awaited(self._time())
        return len(awaited) < self.upstream.under_way and not any(map(self._framer.holds, awaited))

    def _renew(self, reason: str) -> None:
        """Use a new connection; `port_ended` has it opened."""
        port, self._boundary.port = self._boundary.port, None
        self._tell(reason)
        if port is not None:
            port.close()
        self.upstream.renew(self._time())

    def _tell(self, reason: str) -> None:
        self._emit(UpstreamClosed(self.upstream.settings.name, reason))
