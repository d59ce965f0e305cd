"""Joins an upstream's machine to its connection and to the clock: the only part of it that knows the event loop."""

import asyncio
import traceback
from collections.abc import Callable
from typing import Any

from gateway.errors import NotModbus, PortError
from gateway.events import Emit, PartFailed, UpstreamClosed
from gateway.lines.transaction import Transaction
from gateway.lines.upstream import Upstream
from gateway.ports.clock import Alarm
from gateway.ports.port import Port


class UpstreamDriver:
    """Hands bytes, time and requests to `upstream`. It owns the connection, as `ports.keeper` sees it.

    A connection that cannot be used any more is closed here, and the keeper opens the next one. An error that nobody
    foresaw ends here: it is told, all requests of the upstream fail, and the connection is closed too.
    """

    def __init__(self, upstream: Upstream, loop: asyncio.AbstractEventLoop, emit: Emit) -> None:
        self.upstream = upstream
        self._emit = emit
        self._time = loop.time
        self._alarm = Alarm(loop, self._wake)
        self._port: Port | None = None

    def submit(self, transaction: Transaction, now: float) -> None:
        """Take over a transaction."""
        self._run(self.upstream.submit, transaction, now)

    def port_up(self, port: Port) -> None:
        """There is a connection."""
        self._port = port
        self._run(self.upstream.port_up, port.write)

    def received(self, data: bytes) -> None:
        """These bytes have come."""
        self._run(self.upstream.received, data, self._time())

    def port_down(self, error: PortError) -> None:  # noqa: ARG002 - the keeper tells why
        """The connection has gone; requests fail at once until there is another one."""
        self._port = None
        self._run(self.upstream.port_down)

    @property
    def is_busy(self) -> bool:
        """Whether a request is under way."""
        return self.upstream.under_way > 0

    def finish(self) -> None:
        """Take no more requests; those under way may still be answered."""
        self._run(self.upstream.finish)

    def overdue(self, now: float) -> float:
        """For how many seconds something should have been done, and was not."""
        deadline = self.upstream.deadline()
        return 0.0 if deadline is None else max(0.0, now - deadline)

    def close(self) -> None:
        """Wake no more."""
        self._alarm.close()

    def _wake(self) -> None:
        self._run(self.upstream.tick, self._time())

    def _run(self, step: Callable[..., None], *arguments: Any) -> None:
        try:
            step(*arguments)
        except NotModbus as error:
            self._hang_up(UpstreamClosed(self.upstream.settings.name, f"what came is no Modbus TCP: {error}"))
        except Exception as error:  # noqa: BLE001 - the border of an upstream: a defect in it must not reach the others
            text = "".join(traceback.format_exception(error))
            self._hang_up(PartFailed(f"upstream {self.upstream.settings.name}", repr(error), text))
        if self.upstream.is_spent:
            self._hang_up(UpstreamClosed(self.upstream.settings.name, "too many answers are overdue on it"))
        self._alarm.set(self.upstream.deadline())

    def _hang_up(self, event: UpstreamClosed | PartFailed) -> None:
        self._emit(event)
        port, self._port = self._port, None
        self.upstream.port_down()
        if port is not None:
            port.close()
