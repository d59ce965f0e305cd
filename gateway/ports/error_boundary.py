"""The error boundary of a part with a port: it contains unexpected errors of that part."""

import asyncio
from collections.abc import Callable
from typing import Any

from gateway.clock.lazy_timer import LazyTimer
from gateway.events import Emit, PartFailed
from gateway.ports.port import Port


class ErrorBoundary:
    """Runs the steps of one part, and its `tick` at its `deadline`, in seconds of the loop's clock.

    An unexpected error is logged with the name `part`. Then `down` fails all requests of the part, and the port is
    closed; its reconnector opens it again.
    """

    def __init__(
        self,
        part: str,
        loop: asyncio.AbstractEventLoop,
        emit: Emit,
        *,
        deadline: Callable[[], float | None],
        tick: Callable[[], None],
        down: Callable[[], None],
        reads_first: bool = False,
    ) -> None:
        """A `tick` that reads the port before all else need not wait until what is ready has been read."""
        self.port: Port | None = None
        self._part = part
        self._emit = emit
        self._deadline = deadline
        self._tick = tick
        self._down = down
        self._timer = LazyTimer(loop, self.wake, first=reads_first)

    def run(self, step: Callable[..., None], *arguments: Any) -> None:
        """Run one step. After an unexpected error of it, fail all requests and close the port."""
        try:
            step(*arguments)
        except Exception as error:  # noqa: BLE001 - a defect in one part must not reach the others
            self.fail(error)
        self.plan(self._deadline())

    def fail(self, error: Exception) -> None:
        """Log the unexpected error of a step, fail all requests, and close the port."""
        self._log(error)
        self.close_port()

    def plan(self, deadline: float | None) -> None:
        """Set the timer to the part's deadline, which may have changed. No step runs before this returns."""
        self._timer.set(deadline)

    def wake(self) -> None:
        """Run `tick`: the deadline has passed."""
        self.run(self._tick)

    def lost(self) -> None:
        """Forget the port, which was lost, and fail what depends on it."""
        self.port = None
        self.run(self._down)

    def close_port(self) -> None:
        """Close the port, and fail what depends on it."""
        port, self.port = self.port, None
        try:
            self._down()
        except Exception as error:  # noqa: BLE001 - see run
            self._log(error)
        finally:
            if port is not None:
                port.close()

    def overdue(self, now: float) -> float:
        """Return how many seconds the part is behind its deadline."""
        deadline = self._deadline()
        return 0.0 if deadline is None else max(0.0, now - deadline)

    def close(self) -> None:
        """Stop the timer."""
        self._timer.close()

    def _log(self, error: Exception) -> None:
        self._emit(PartFailed.of(self._part, error))
