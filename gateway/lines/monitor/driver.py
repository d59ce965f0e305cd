"""Connects a monitor line to its port and to the clock. It reads, and never writes."""

import asyncio
from functools import partial

from gateway.errors import PortError
from gateway.events import Emit
from gateway.lines.monitor.monitor import Monitor
from gateway.ports.error_boundary import ErrorBoundary
from gateway.ports.port import CharacterErrors, OpenAgain, Port, Wire, resolve_wire


class MonitorDriver:
    """Passes bytes and time to `monitor`; the PortOwner of the line's port.

    `wire` is `auto` until the port has been open. An unexpected error is contained here: it is logged, and the port is
    closed and reopened.
    """

    #: It has no requests to wait for.
    is_busy = False

    def __init__(self, monitor: Monitor, loop: asyncio.AbstractEventLoop, emit: Emit) -> None:
        self.monitor = monitor
        self.wire: Wire = monitor.settings.wire
        self._time = loop.time
        self._boundary = ErrorBoundary(
            f"line {monitor.settings.name}", loop, emit, deadline=monitor.deadline, tick=self._tick, down=self._down
        )

    @property
    def errors(self) -> CharacterErrors | None:
        """Counts of faulty characters since the port was opened; None if the driver has none."""
        return None if self._boundary.port is None else self._boundary.port.errors

    def port_up(self, port: Port) -> None:
        """Listen at this open port."""
        self._boundary.port = port
        self.wire = resolve_wire(self.monitor.settings.wire, is_virtual=port.is_virtual)
        self._boundary.run(self.monitor.port_up, self._time())

    def received(self, data: bytes, *, damaged: bool = False) -> None:
        """Take received bytes."""
        self._boundary.run(partial(self.monitor.received, damaged=damaged), data, self._time())

    def port_ended(self, open_again: OpenAgain, *, at_once: bool) -> bool:  # noqa: ARG002 - see PortOwner
        """Return False: others may ask at any time."""
        return False

    def port_down(self, error: PortError) -> None:  # noqa: ARG002 - the reconnector logs why
        """Stop listening until the port is open again."""
        self._boundary.lost()

    def finish(self) -> None:
        """Do nothing: there are no requests to finish."""

    def overdue(self, now: float) -> float:
        """Return how many seconds the line is behind its deadline."""
        return self._boundary.overdue(now)

    def close(self) -> None:
        """Stop the timer."""
        self._boundary.close()

    def _tick(self) -> None:
        """Read what has arrived before time passes."""
        if self._boundary.port is not None:
            self._boundary.port.read_now()
        self.monitor.tick(self._time())

    def _down(self) -> None:
        self.monitor.port_down(self._time())
