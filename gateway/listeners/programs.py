"""A server line on a virtual port: each program of this machine that opens it has a session of its own."""

import asyncio
from collections.abc import Callable
from functools import partial
from pathlib import Path

from gateway.errors import PortClosed, PortError
from gateway.events import Emit
from gateway.listeners.serial import SerialListener
from gateway.listeners.sessions.server_counts import ServerCounts
from gateway.listeners.sessions.server_line import ServerSettings
from gateway.ports.port import OpenAgain, Port, Received, Wire, resolve_wire
from gateway.ports.pty_link import PtyLink
from gateway.ports.pty_port import PtyPort
from gateway.request import Target
from gateway.trace.ring import Ring


class ProgramListener:
    """The programs of a virtual port, and the owner of its link: see `ports.reconnector`.

    The one that will come next has a session already. All have the same `counts`.
    """

    def __init__(
        self,
        settings: ServerSettings,
        router: Target,
        loop: asyncio.AbstractEventLoop,
        emit: Emit,
        ring: Ring | None = None,
    ) -> None:
        self.wire: Wire = resolve_wire(settings.wire, is_virtual=True)
        self.counts = ServerCounts()
        #: Where the link is; None until it was there.
        self.path: Path | None = None
        self._settings = settings
        self._new_session = partial(SerialListener, router=router, loop=loop, emit=emit, ring=ring, counts=self.counts)
        self._sessions: dict[PtyPort, SerialListener] = {}
        self._is_ending = False

    @property
    def programs(self) -> int:
        """How many programs have asked and are still there."""
        return sum(port.is_in_use for port in self._sessions)

    @property
    def is_busy(self) -> bool:
        """Whether a request is in progress."""
        return any(session.is_busy for session in self._sessions.values())

    def port_up(self, port: Port) -> None:
        """Answer the programs that open the link."""
        assert isinstance(port, PtyLink)  # noqa: S101 - the plan has a virtual port for this listener
        self.path = port.path
        port.serve(self._came)

    def received(self, data: bytes, *, damaged: bool = False) -> None:
        """Do nothing: programs have ports of their own."""

    def port_ended(self, open_again: OpenAgain, *, at_once: bool) -> bool:  # noqa: ARG002 - see PortOwner
        """Return False: programs may ask at any time."""
        return False

    def port_down(self, error: PortError) -> None:
        """Do nothing: the ports of programs have ended before their link."""

    def adopt(self, settings: ServerSettings) -> None:
        """Answer with these settings from now on."""
        self._settings = settings
        for session in self._sessions.values():
            session.adopt(settings)

    def finish(self) -> None:
        """Accept no more requests; those in progress are still answered."""
        self._is_ending = True
        for session in self._sessions.values():
            session.finish()

    def overdue(self, now: float) -> float:
        """Return how many seconds a due action is late."""
        return max((session.overdue(now) for session in self._sessions.values()), default=0.0)

    def close(self) -> None:
        """Stop the timers."""
        for session in self._sessions.values():
            session.close()

    def _came(self, port: PtyPort) -> "_Program":
        session = self._new_session(self._settings)
        self._sessions[port] = session
        session.port_up(port)
        if self._is_ending:
            session.finish()
        return _Program(session, port, partial(self._left, port))

    def _left(self, port: PtyPort) -> None:
        self._sessions.pop(port).close()


class _Program:
    """The user of the port of one program."""

    __slots__ = ("_left", "_port", "_session", "received")

    def __init__(self, session: SerialListener, port: PtyPort, left: Callable[[], None]) -> None:
        self.received: Received = session.received
        self._session = session
        self._port = port
        self._left = left

    def give_up(self) -> None:
        """Start anew, as on a port that was lost and opened again."""
        self._session.port_down(PortClosed())
        self._session.port_up(self._port)

    def lost(self, error: PortError) -> None:
        """Give up its request, and forget it."""
        self._session.port_down(error)
        self._left()
