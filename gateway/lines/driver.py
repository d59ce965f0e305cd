"""Connects a line to its port and to the clock: the only part of a line that uses the event loop."""

import asyncio
from collections.abc import Callable
from functools import partial
from math import inf
from typing import Protocol

from gateway.errors import LineDown, PortError
from gateway.events import ConnectionRenewed, Emit
from gateway.lines.line import Line
from gateway.lines.scheduler import earliest
from gateway.lines.transaction import TakesTransactions, Transaction
from gateway.ports.error_boundary import ErrorBoundary
from gateway.ports.port import CharacterErrors, OpenAgain, Port, Wire, resolve_wire


class Permission(Protocol):
    """Permission to write to a line that several gateways use in turn."""

    def may_send(self) -> bool:
        """Tell whether a request may be written now."""

    def silence(self) -> float:
        """Return for how many seconds nothing may be written: late answers to others may come."""

    def heard_other(self) -> None:
        """Note that another client has sent a request on the line."""


class LineDriver(TakesTransactions):
    """Passes bytes, time and requests to `line`; the PortOwner of the line's port.

    `rate_changed` is called with a new rate of the line, at which the port is opened from then on. `wire` is `auto`
    until the port has been open. With a `permission` nothing is written unless it allows that. From a port that
    `reads_at_once`, `read_now` gets all that has arrived.

    An unexpected error is contained here: it is logged, all requests of the line fail, and the port is closed and
    reopened.
    """

    def __init__(
        self,
        line: Line,
        loop: asyncio.AbstractEventLoop,
        emit: Emit,
        rate_changed: Callable[[int], None],
        permission: Permission | None = None,
        *,
        reads_at_once: bool = False,
    ) -> None:
        self.line = line
        self.wire: Wire = line.settings.wire
        self._rate_changed = rate_changed
        self._emit = emit
        self._time = loop.time
        #: When the port is read again, None for as bytes come; whether it is being read. When to wake the line.
        self._read_at: float | None = None
        self._is_reading = False
        self._line_at = 0.0
        name = f"line {line.settings.name}"
        self._permission = permission
        if permission is not None:
            line.share(permission.may_send, permission.heard_other)
        self._boundary = ErrorBoundary(
            name, loop, emit, deadline=self._deadline, tick=self._tick, down=self._down, reads_first=reads_at_once
        )

    def submit(self, transaction: Transaction, now: float) -> None:
        """Take over a transaction. Bytes that wait in the port came before it, and are read first."""
        line = self.line
        if line.can_send(now):
            self._read_port()
        was_busy = line.is_busy
        is_planned = was_busy and line.queue.has_expiry  # then its deadline cannot become earlier
        try:
            line.submit(transaction, now)
            if not was_busy:
                self._look_away(now)
        except Exception as error:  # noqa: BLE001 - the error boundary of a line, see `run` of ErrorBoundary
            self._boundary.fail(error)
            transaction.fail_open(LineDown())  # the line may not have taken it over
            is_planned = False
        if not is_planned:
            self._boundary.plan(self._deadline())

    def port_up(self, port: Port) -> None:
        """Use this open port."""
        self._boundary.port = port
        self.wire = resolve_wire(self.line.settings.wire, is_virtual=port.is_virtual)
        port_up = partial(self.line.port_up, virtual=self.wire == "direct", has_arrived=port.has_arrived)
        permission = self._permission
        if permission is None:
            self._boundary.run(port_up, port.write, port.latency, self._time())
        else:
            self._boundary.run(port_up, partial(_write_with, permission, port), port.latency, self._time())
            self._boundary.run(self.line.be_silent, self._time() + permission.silence())

    def received(self, data: bytes, *, damaged: bool = False) -> None:
        """Take received bytes."""
        try:
            self._receive(data, self._time(), damaged)
        except Exception as error:  # noqa: BLE001 - the error boundary of a line, see `run` of ErrorBoundary
            self._boundary.fail(error)
        if not self._is_reading:
            self._boundary.plan(self._deadline())

    def port_ended(self, open_again: OpenAgain, *, at_once: bool) -> bool:
        """End the connection. Return whether it may stay closed until it is needed."""
        self._read_at = None
        self._boundary.port = None
        self._boundary.run(partial(self.line.port_ended, at_once=at_once), open_again, self._time())
        return self.line.is_closed

    def port_down(self, error: PortError) -> None:  # noqa: ARG002 - the reconnector logs why
        """Stop using the port, which was lost; requests fail at once until it is open again."""
        self._boundary.lost()

    def change_rate(self, baud: int) -> None:
        """Change line and port to `baud`: the only device has changed its rate."""
        self.line.change_rate(baud, self._time())
        self._rate_changed(baud)
        if self._boundary.port is not None:
            self._boundary.port.change_baud(baud)

    @property
    def is_virtual(self) -> bool:
        """Whether the port is open, and a virtual one."""
        return self._boundary.port is not None and self._boundary.port.is_virtual

    @property
    def errors(self) -> CharacterErrors | None:
        """Counts of faulty characters since the port was opened; None if the driver has none."""
        return None if self._boundary.port is None else self._boundary.port.errors

    @property
    def is_busy(self) -> bool:
        """Whether a request is on the line."""
        return self.line.is_busy

    def finish(self) -> None:
        """Accept no more requests; the one on the line may still be answered."""
        self._boundary.run(self.line.finish, self._time())

    def overdue(self, now: float) -> float:
        """Return how many seconds the line is behind its deadline."""
        return self._boundary.overdue(now)

    def close(self) -> None:
        """Stop the timer."""
        self._boundary.close()

    def _deadline(self) -> float | None:
        deadline = self.line.deadline()
        self._line_at = inf if deadline is None else deadline
        return deadline if self._read_at is None else earliest(deadline, self._read_at)

    def _tick(self) -> None:
        """Read the port, and wake the line if it is time."""
        self._read_port()
        line, now = self.line, self._time()
        if now >= self._line_at:
            line.tick(now)
            is_stuck = line.must_renew(now)
            if is_stuck or line.may_leave(now):
                self._close_port(is_stuck=is_stuck)
        self._look_away(now)

    def _close_port(self, *, is_stuck: bool) -> None:
        """Close the connection. A new one is opened at once, or when it is needed."""
        port, self._boundary.port = self._boundary.port, None
        if port is not None:
            if is_stuck:
                self._emit(ConnectionRenewed(self.line.settings.name, self.line.settings.source))
            self.line.renew(self._time())
            port.close()

    def _read_port(self) -> None:
        """Read what the port has received, before anything is sent or times out."""
        self._read_at = None
        if self._boundary.port is not None:
            self._is_reading = True
            try:
                self._boundary.port.read_now()
            finally:
                self._is_reading = False

    def _receive(self, data: bytes, now: float, damaged: bool) -> None:  # noqa: FBT001 - a step of the boundary
        self.line.received(data, now, damaged=damaged)
        if not self._is_reading:
            self._look_away(now)

    def _look_away(self, now: float) -> None:
        """Pause the port if possible. The rest of one read may still come while it is paused."""
        read_at, port = self.line.read_at(now), self._boundary.port
        if read_at is not None and port is not None and port.pause():
            self._read_at = read_at
        elif self._read_at is not None:
            self._read_at = now

    def _down(self) -> None:
        self._read_at = None
        self.line.port_down(self._time())


def _write_with(permission: Permission, port: Port, data: bytes) -> None:
    """Write if that is still permitted; nothing happens between this check and the system call."""
    if permission.may_send():
        port.write(data)
    else:
        port.close()
