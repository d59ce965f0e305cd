"""Joins the session of a server line to its port and to the clock: the only part of it that knows the event loop."""

import asyncio
import traceback
from collections.abc import Callable
from functools import partial
from typing import Any

from gateway.errors import PortError
from gateway.events import Emit, PartFailed
from gateway.listeners.serial_session import SerialSession, ServerSettings
from gateway.ports.clock import Alarm
from gateway.ports.port import Port
from gateway.request import Target


class SerialListener:
    """A line where we are a server. It is the owner of the line's port, as `ports.keeper` sees it.

    An error that nobody foresaw ends here: it is told, the request under way is dropped, the port is closed and
    reopened.
    """

    def __init__(self, settings: ServerSettings, router: Target, loop: asyncio.AbstractEventLoop, emit: Emit) -> None:
        self.session = SerialSession(settings, router, self._wake, emit)
        self._emit = emit
        self._time = loop.time
        self._alarm = Alarm(loop, self._wake)
        self._port: Port | None = None

    @property
    def is_busy(self) -> bool:
        """Whether a request is under way."""
        return not self.session.is_idle

    def port_up(self, port: Port) -> None:
        """The port is open."""
        self._port = port
        self._run(partial(self.session.port_up, virtual=port.virtual), port.write, port.latency, self._time())

    def received(self, data: bytes) -> None:
        """These bytes became readable."""
        self._run(self.session.received, data, self._time())

    def port_down(self, error: PortError) -> None:  # noqa: ARG002 - the keeper tells why
        """The port has gone; nobody is answered until it is back."""
        self._port = None
        self._run(self.session.port_down)

    def finish(self) -> None:
        """Take no more requests; the one that is under way is still answered."""
        self.session.finish()

    def overdue(self, now: float) -> float:
        """For how many seconds something should have been done, and was not."""
        deadline = self.session.deadline()
        return 0.0 if deadline is None else max(0.0, now - deadline)

    def close(self) -> None:
        """Wake no more."""
        self._alarm.close()

    def _wake(self) -> None:
        self._run(self.session.tick, self._time())

    def _run(self, step: Callable[..., None], *arguments: Any) -> None:
        try:
            step(*arguments)
        except Exception as error:  # noqa: BLE001 - the border of a line: a defect in it must not reach the others
            self._start_anew(error)
        self._alarm.set(self.session.deadline())

    def _start_anew(self, error: Exception) -> None:
        text = "".join(traceback.format_exception(error))
        self._emit(PartFailed(f"line {self.session.settings.name}", repr(error), text))
        port, self._port = self._port, None
        self.session.port_down()
        if port is not None:
            port.close()
