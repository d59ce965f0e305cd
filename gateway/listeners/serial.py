"""Connects the session of a server line to its port and the clock: its only part that uses the event loop."""

import asyncio
from functools import partial

from gateway.errors import PortError
from gateway.events import Emit
from gateway.listeners.sessions.server_counts import ServerCounts
from gateway.listeners.sessions.server_line import LOOK_STEP, UNNOTICED, SerialSession, ServerSettings
from gateway.ports.error_boundary import ErrorBoundary
from gateway.ports.port import OpenAgain, Port, Wire, resolve_wire
from gateway.request import Target
from gateway.trace.ring import Ring


class SerialListener:
    """A server line, and the owner of its port: see `ports.reconnector`.

    A gateway that stood still reads late. So an open port is read every LOOK_STEP. If it was not read for longer than
    UNNOTICED, bytes may have arrived at any time since the last reading, and count from then.

    An unexpected error is contained here: it is logged, the request in progress is dropped, and the port is closed and
    reopened.
    """

    def __init__(
        self,
        settings: ServerSettings,
        router: Target,
        loop: asyncio.AbstractEventLoop,
        emit: Emit,
        ring: Ring | None = None,
        counts: ServerCounts | None = None,
    ) -> None:
        self.session = SerialSession(settings, router, self._wake, emit, ring, counts)
        #: The timing of bytes; `auto` until the port is open for the first time.
        self.wire: Wire = settings.wire
        self._time = loop.time
        #: When all arrived bytes were last read.
        self._looked_at = 0.0
        deadline, down = self._deadline, self.session.port_down
        self._boundary = ErrorBoundary(
            f"line {settings.name}", loop, emit, deadline=deadline, tick=self._tick, down=down
        )

    @property
    def counts(self) -> ServerCounts:
        """What has happened since it was created."""
        return self.session.counts

    @property
    def is_busy(self) -> bool:
        """Whether a request is in progress."""
        return not self.session.is_idle

    def port_up(self, port: Port) -> None:
        """Use the open port. Bytes that came before were discarded."""
        self._boundary.port = port
        self._looked_at = self._time()
        self.wire = resolve_wire(self.session.settings.wire, is_virtual=port.is_virtual)
        step = partial(self.session.port_up, virtual=self.wire == "direct")
        self._boundary.run(step, port.write, port.latency, self._time())

    def received(self, data: bytes, *, damaged: bool = False) -> None:
        """Process received bytes."""
        now = self._time()
        since = now if now - self._looked_at <= UNNOTICED else self._looked_at
        self._boundary.run(partial(self.session.received, damaged=damaged, since=since), data, now)

    def port_ended(self, open_again: OpenAgain, *, at_once: bool) -> bool:  # noqa: ARG002 - see PortOwner
        """Return False: an outside client may send requests at any time."""
        return False

    def port_down(self, error: PortError) -> None:  # noqa: ARG002 - logged by the reconnector
        """Stop answering until the port is open again."""
        self._boundary.lost()

    def adopt(self, settings: ServerSettings) -> None:
        """Answer for the units in these settings from now on; they are the same otherwise."""
        self.session.adopt(settings)

    def finish(self) -> None:
        """Accept no more requests; the one in progress is still answered."""
        self.session.finish()

    def overdue(self, now: float) -> float:
        """Return how many seconds a due action is late."""
        return self._boundary.overdue(now)

    def close(self) -> None:
        """Stop the timer."""
        self._boundary.close()

    def _wake(self) -> None:
        self._boundary.plan(self._deadline())

    def _deadline(self) -> float | None:
        """Return when to call `_tick`: for the session, or to read the port."""
        due = self.session.deadline()
        if self._boundary.port is None:
            return due
        look_at = self._looked_at + LOOK_STEP
        return look_at if due is None else min(due, look_at)

    def _tick(self) -> None:
        """Read what has arrived, and then let time pass for the session: the client may no longer wait."""
        if self._boundary.port is not None:
            looked_at = self._time()
            self._boundary.port.read_now()
            self._looked_at = looked_at
        self.session.tick(self._time())
