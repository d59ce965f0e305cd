"""Connects an upstream to its TCP connection and to the clock: its only part that knows the event loop."""

import asyncio
from collections.abc import Callable
from typing import Any

from gateway.errors import NotModbus, PortError
from gateway.events import Emit, UpstreamClosed
from gateway.lines.transaction import Transaction
from gateway.modbus.mbap import MbapFramer, encode
from gateway.ports.error_boundary import ErrorBoundary
from gateway.ports.port import Port
from gateway.upstreams.upstream import Upstream


class UpstreamDriver:
    """Passes bytes, time and requests to `upstream`. It is the PortOwner of the connection.

    It closes a connection that cannot be used any more; the reconnector opens the next one. An unexpected error is
    logged here, all requests of the upstream fail, and the connection is closed too.
    """

    is_renewing = False

    def __init__(self, upstream: Upstream, loop: asyncio.AbstractEventLoop, emit: Emit) -> None:
        self.upstream = upstream
        self._emit = emit
        self._time = loop.time
        self._framer = MbapFramer(strict=True)
        self._boundary = ErrorBoundary(
            f"upstream {upstream.settings.name}",
            loop,
            emit,
            deadline=upstream.deadline,
            tick=self._tick,
            down=self._down,
        )

    def submit(self, transaction: Transaction, now: float) -> None:
        """Take over a transaction."""
        self._run(self.upstream.submit, transaction, now)

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

    def port_down(self, error: PortError) -> None:  # noqa: ARG002 - the reconnector logs why
        """The connection was lost; requests fail at once until it is open again."""
        self._boundary.lost()

    @property
    def is_busy(self) -> bool:
        """Whether a request has been sent and not been answered."""
        return self.upstream.under_way > 0

    def finish(self) -> None:
        """Accept no more requests; those already sent may still be answered."""
        self._run(self.upstream.finish, self._time())

    def overdue(self, now: float) -> float:
        """How many seconds it is behind its own deadline."""
        return self._boundary.overdue(now)

    def close(self) -> None:
        """Stop the timer."""
        self._boundary.close()

    def _take(self, data: bytes) -> None:
        self.upstream.received(self._framer.cut(data), self._time())

    def _tick(self) -> None:
        self._step(self.upstream.tick, self._time())

    def _down(self) -> None:
        self.upstream.port_down(self._time())

    def _run(self, step: Callable[..., None], *arguments: Any) -> None:
        self._boundary.run(self._step, step, *arguments)

    def _step(self, step: Callable[..., None], *arguments: Any) -> None:
        try:
            step(*arguments)
        except NotModbus as error:
            self._hang_up(f"what came is no Modbus TCP: {error}")
        if self.upstream.is_spent:
            self._hang_up("too many answers are overdue on it")

    def _hang_up(self, reason: str) -> None:
        self._emit(UpstreamClosed(self.upstream.settings.name, reason))
        self._boundary.hang_up()
