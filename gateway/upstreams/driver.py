"""Connects an upstream to the clock: with its subclasses its only part that knows the event loop."""

import asyncio
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

from gateway.errors import PortError
from gateway.events import Emit
from gateway.lines.transaction import Transaction
from gateway.ports.error_boundary import ErrorBoundary
from gateway.ports.port import OpenAgain
from gateway.upstreams.upstream import Upstream


class UpstreamDriver(ABC):
    """Passes time and requests to `upstream`. Its subclasses are PortOwners: they know what carries the requests.

    An unexpected error is logged here, and the port is closed.
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
        """See PortOwner: a port that carries messages is always needed."""
        return False

    def port_down(self, error: PortError) -> None:  # noqa: ARG002 - the reconnector logs why
        """The port was lost; requests that wait fail at once until it is open again."""
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

    def _run(self, step: Callable[..., None], *arguments: Any) -> None:
        self._boundary.run(self._step, step, *arguments)

    def _tick(self) -> None:
        self._step(self.upstream.tick, self._time())

    def _step(self, step: Callable[..., None], *arguments: Any) -> None:
        """Do one step, and what follows from it."""
        step(*arguments)

    @abstractmethod
    def _down(self) -> None:
        """The port was lost: what becomes of requests."""
