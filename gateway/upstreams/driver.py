"""Connects an upstream to the clock and to its TCP connection.

Only this module and other subclasses of UpstreamDriver use the event loop.
"""

import asyncio
from abc import abstractmethod
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, Final

from gateway.errors import NotModbus, PortError
from gateway.events import Emit, UpstreamClosed
from gateway.lines.transaction import TakesTransactions, Transaction
from gateway.modbus.mbap import MbapFramer, TcpFrame, encode
from gateway.ports.error_boundary import ErrorBoundary
from gateway.ports.port import OpenAgain, Port
from gateway.upstreams.upstream import Upstream

#: After so many time-outs in a row, and nothing received, another address of the server is used.
SILENCES: Final = 3


class UpstreamDriver(TakesTransactions):
    """Passes time and requests to `upstream`. Its subclasses are PortOwners, which know the kind of port.

    An unexpected error is logged, and the port is closed.
    """

    def __init__(self, upstream: Upstream, loop: asyncio.AbstractEventLoop, emit: Emit) -> None:
        self.upstream = upstream
        self._time = loop.time
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

    def port_ended(self, open_again: OpenAgain, *, at_once: bool) -> bool:  # noqa: ARG002 - see PortOwner
        """Return False: a port that carries messages is always needed."""
        return False

    def port_down(self, error: PortError) -> None:  # noqa: ARG002 - the reconnector logs why
        """Stop using the port, which was lost; until it is open again, waiting requests fail at once."""
        self._boundary.lost()

    @property
    def is_busy(self) -> bool:
        """Whether a request was sent and not answered yet."""
        return self.upstream.under_way > 0

    def finish(self) -> None:
        """Accept no more requests; those already sent may still be answered."""
        self._run(self.upstream.finish, self._time())

    def overdue(self, now: float) -> float:
        """Return how many seconds it is behind its own deadline."""
        return self._boundary.overdue(now)

    def close(self) -> None:
        """Stop the timer."""
        self._boundary.close()

    def _run(self, step: Callable[..., None], *arguments: Any) -> None:
        self._boundary.run(self._step, step, *arguments)

    def _tick(self) -> None:
        self._step(self.upstream.tick, self._time())

    def _step(self, step: Callable[..., None], *arguments: Any) -> None:
        """Do one step; subclasses add its consequences."""
        step(*arguments)

    @abstractmethod
    def _down(self) -> None:
        """Finish requests after the loss of the port."""


class TcpDriver(UpstreamDriver):
    """Passes bytes, time and requests to `upstream`; the PortOwner of the connection.

    It closes an unusable connection; the reconnector opens the next one. After a loss its requests fail. A connection
    that ends while nothing is under way is opened again for the next request. `next_address` chooses another address
    of the server, if it has several.
    """

    def __init__(
        self,
        upstream: Upstream,
        loop: asyncio.AbstractEventLoop,
        emit: Emit,
        next_address: Callable[[], str] | None = None,
    ) -> None:
        super().__init__(upstream, loop, emit)
        self._emit = emit
        self._next_address = next_address
        self._framer = MbapFramer(strict=True)

    def port_up(self, port: Port) -> None:
        """Use this open connection."""
        self._boundary.port = port
        self._framer = MbapFramer(strict=True)
        write = port.write

        def send(identifier: int, transaction: Transaction) -> None:
            write(encode(identifier, transaction.unit, transaction.asked.data))

        self._run(self.upstream.port_up, send, self._time(), port.read_now)
        self._run(self.upstream.tick, self._time())

    def port_ended(self, open_again: OpenAgain, *, at_once: bool) -> bool:
        """End the connection; return whether it may stay closed until it is needed."""
        self._boundary.port = None
        self._run(partial(self.upstream.port_ended, at_once=at_once), open_again, self._time())
        return self.upstream.is_closed

    def received(self, data: bytes, *, damaged: bool = False) -> None:  # noqa: ARG002 - TCP delivers no damaged bytes
        """Take received bytes."""
        self._run(self._take, data)

    def _take(self, data: bytes) -> None:
        self.upstream.received(self._cut(data), self._time())

    def _cut(self, data: bytes) -> Iterator[TcpFrame]:
        """Yield the frames that `data` completes. What is left over while nothing is under way is no response."""
        yield from self._framer.cut(data)
        if self._framer.unfinished and not self.upstream.under_way:
            self.upstream.spoil()

    def _tick(self) -> None:
        if self._framer.unfinished and self._is_stuck():
            came = f"{self._framer.unfinished} bytes came of it{self._framer.hint}"
            self._renew(f"a response was cut, or its length is wrong: {came}")
        super()._tick()
        if self.upstream.may_leave(self._time()):
            self._renew()
        if self._next_address is not None and self.upstream.silences >= SILENCES:
            address = self._next_address()
            self._renew(f"{SILENCES} requests in a row have timed out, and nothing came; {address} is tried next")

    def _step(self, step: Callable[..., None], *arguments: Any) -> None:
        try:
            step(*arguments)
        except NotModbus as error:
            self._tell(f"what came is not Modbus TCP: {error}")
            self._boundary.close_port()
        if self.upstream.must_renew and self.upstream.is_unused:  # a new one would be no better
            self._tell("the server sends before it is asked, and does not say which request it answers")
            self._boundary.close_port()
        elif self.upstream.must_renew:
            self._renew("too many answers are overdue on it" if self.upstream.is_spent else "")

    def _down(self) -> None:
        self.upstream.port_down(self._time())

    def _is_stuck(self) -> bool:
        """Tell whether a request has timed out, and the unfinished response is not for one that still has time."""
        awaited = self.upstream.awaited(self._time())
        return len(awaited) < self.upstream.under_way and not any(map(self._framer.holds, awaited))

    def _renew(self, reason: str = "") -> None:
        """Close the connection; a new one is opened when it is needed. Tell the `reason`, if there is one to tell."""
        port, self._boundary.port = self._boundary.port, None
        if reason:
            self._tell(reason)
        if port is not None:
            port.close()
        self.upstream.renew(self._time())

    def _tell(self, reason: str) -> None:
        self._emit(UpstreamClosed(self.upstream.settings.name, reason))
