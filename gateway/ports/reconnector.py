"""Keeps one port open: opens it, and opens it again after every loss.

An orderly end of a connection that its owner does not need is no loss. It is opened again when the owner needs it.
"""

import asyncio
from collections.abc import Callable
from contextlib import suppress
from typing import Final, Protocol

from gateway.errors import ConnectionEnded, PortClosed, PortError
from gateway.events import Emit, LineLost, LineReopened, LineUp
from gateway.ports.port import OpenAgain, OpenPort, Port, Received

#: The back-off before the next attempt, in seconds; it doubles with every failure. At the longest, an adapter is used
#: within 2 s of being plugged in again, and an absent one takes less than 2 % of a processor.
FIRST_PAUSE: Final = 0.1
LONGEST_PAUSE: Final = 1.0
#: How long a driver may take to open a port, in seconds.
OPENING_DEADLINE: Final = 5.0
#: How long a driver may take to close a port, in seconds: the last frame at a low rate, and a margin.
CLOSING_DEADLINE: Final = 3.0

#: The common reason after an unplugging, and its words in `ports/opening.py`.
_ABSENT: Final = "absent"
_ABSENT_WORDS: Final = ("does not exist", "has no hardware behind it")


class PortOwner(Protocol):
    """The user of a port that is kept open: a line, an upstream, a serial listener. At first it has no port."""

    def port_up(self, port: Port) -> None:
        """Use `port`: it is open and can be written to."""

    @property
    def received(self) -> Received:
        """The function that takes received bytes."""

    def port_ended(self, open_again: OpenAgain, *, at_once: bool) -> bool:
        """Return whether the port, which was closed in order by the server or the owner, may stay closed.

        `at_once`: see ConnectionEnded. True: nothing was under way, and the port is opened when the owner calls
        `open_again`, perhaps at once; then `port_up` follows, or `port_down`. False: it is a loss, and `port_down`
        follows now.
        """

    def port_down(self, error: PortError) -> None:
        """Stop using the port, which was lost. Called once for each `port_up`, unless `port_ended` was True."""


class Reconnector:
    """Keeps the port of `owner` open while `run` runs.

    `name` and `port_path` are those of the line, for events. `tried` is set after the first attempt. `error` is why the
    port is not open; None while it is open or not needed, and before the first attempt. `reopened` counts how often it
    was opened after a loss. Each attempt takes at most `deadline` seconds.
    """

    def __init__(
        self,
        name: str,
        port_path: str,
        open_port: OpenPort,
        owner: PortOwner,
        emit: Emit,
        deadline: float = OPENING_DEADLINE,
    ) -> None:
        self.tried = asyncio.Event()
        self.error: PortError | None = None
        self.reopened = 0
        self.port_path = port_path
        self._name = name
        self._open_port = open_port
        self._owner = owner
        self._emit = emit
        self._deadline = deadline
        self._pause = FIRST_PAUSE
        self._opened_at = 0.0
        #: Whether the path is another one than that of the last LineUp or LineReopened.
        self._has_moved = False
        self._lost_at: float | None = None
        #: Whether the port is closed because the owner does not need it; set when it does.
        self._is_idle = False
        self._needed = asyncio.Event()
        #: Reasons logged since the port was last open.
        self._logged: set[str] = set()

    @property
    def is_open(self) -> bool:
        """Whether the port is open, or will be when it is needed."""
        return self.tried.is_set() and self.error is None

    def use_path(self, port_path: str) -> None:
        """Name the port `port_path` from now on: another address of the same server. It is told when it is open."""
        self.port_path = port_path
        self._has_moved = True

    async def run(self) -> None:
        """Keep the port open until cancelled; then close it, and call the owner's `port_down`."""
        try:
            while True:
                try:
                    await self._open_and_wait()
                except PortError as error:
                    self.report_failure(error)
                    self._stay_closed(error)
                if self._is_idle:
                    await self._needed.wait()
                else:
                    await asyncio.sleep(self._pause)
                    self._pause = min(2 * self._pause, LONGEST_PAUSE)
        finally:
            self._stay_closed(PortClosed())

    def begin_anew(self) -> None:
        """Forget earlier attempts, before `run` is called again."""
        self.error = None
        self.tried.clear()

    def withhold(self, error: PortError) -> None:
        """Set the reason why the port is closed on purpose while `run` does not run. Nothing is logged."""
        self.error = error
        self.tried.set()

    def report_failure(self, error: PortError) -> None:
        """Log why the port could not be opened, once per reason until it is open again."""
        self.error = error
        if _reason(error) not in self._logged:
            self._log(error)
        self.tried.set()

    async def _open_and_wait(self) -> None:
        """Open the port and wait until it is lost.

        Raises:
            PortError: it cannot be opened.
        """
        session = _PortSession(self._owner.received, self._tell_owner)
        port = await self._open(session)
        try:
            session.is_up = True
            self._report_up(port)
            self._report_loss(await session.loss)
        finally:
            if session.is_up:
                session.is_up = False
                self._owner.port_down(PortClosed())
            await _close(port)

    def _tell_owner(self, error: PortError) -> None:
        """Tell the owner that the port is closed or lost; note whether it stays closed until it is needed."""
        self._needed.clear()
        if isinstance(error, PortClosed | ConnectionEnded):
            at_once = isinstance(error, ConnectionEnded) and error.at_once
            self._is_idle = self._owner.port_ended(self._needed.set, at_once=at_once)
        if not self._is_idle:
            self._owner.port_down(error)

    def _stay_closed(self, error: PortError) -> None:
        """Count an idle port as lost: it could not be opened when needed, or is not kept open any more."""
        if self._is_idle:
            self._is_idle = False
            self._lost_at = _now()
            self._owner.port_down(error)

    async def _open(self, session: "_PortSession") -> Port:
        try:
            async with asyncio.timeout(self._deadline):
                port = await self._open_port(session)
        except TimeoutError:
            raise PortError(f"{self.port_path}: the driver did not open it within {self._deadline:g} s") from None
        if session.loss.done():
            await _close(port)
            raise session.loss.result()
        return port

    def _report_up(self, port: Port) -> None:
        self.error = None
        was_idle, self._is_idle = self._is_idle, False
        self._opened_at = _now()
        has_moved, self._has_moved = self._has_moved, False
        self._owner.port_up(port)
        if was_idle and not has_moved:
            return
        self.reopened += self._lost_at is not None and not was_idle
        if self._lost_at is None or was_idle:
            self._emit(LineUp(self._name, self.port_path, port.baud))
        elif self._logged:
            away = round(_now() - self._lost_at, 1)
            self._emit(LineReopened(self._name, self.port_path, away, port.baud))
        self._logged.clear()
        self.tried.set()

    def _report_loss(self, error: PortError) -> None:
        """Log the loss of an open port. That the port is absent afterwards is not logged again."""
        if _now() - self._opened_at > LONGEST_PAUSE:  # a port that stayed open ends the back-off
            self._pause = FIRST_PAUSE
        if self._is_idle:
            return
        self.error = error
        if not isinstance(error, PortClosed):  # a PortClosed has its reason logged already
            self._log(error)
            self._logged.add(_ABSENT)
        self._lost_at = _now()

    def _log(self, error: PortError) -> None:
        self._logged.add(_reason(error))
        self._emit(LineLost(self._name, self.port_path, reason=str(error)))

    def __repr__(self) -> str:
        state = "not tried yet" if not self.tried.is_set() else "open" if self.error is None else f"down: {self.error}"
        return f"<Reconnector {self._name} {self.port_path} {state}>"


class _PortSession:
    """The PortUser of one open port: passes bytes to the owner, and a loss to the reconnector."""

    __slots__ = ("_tell_owner", "is_up", "loss", "received")

    def __init__(self, received: Received, tell_owner: Callable[[PortError], None]) -> None:
        self.received = received
        self.loss: asyncio.Future[PortError] = asyncio.get_running_loop().create_future()
        self.is_up = False
        self._tell_owner = tell_owner

    def lost(self, error: PortError) -> None:
        """Tell the owner at once, before the reconnector's task runs."""
        if not self.loss.done():
            self.loss.set_result(error)
        if self.is_up:
            self.is_up = False
            self._tell_owner(error)


def _reason(error: PortError) -> str:
    """Return the error's message, or `_ABSENT` for all messages with that meaning."""
    reason = str(error)
    return _ABSENT if any(words in reason for words in _ABSENT_WORDS) else reason


async def _close(port: Port) -> None:
    port.close()
    with suppress(TimeoutError):  # a driver that hangs closes it when it returns
        async with asyncio.timeout(CLOSING_DEADLINE):
            await port.wait_closed()


def _now() -> float:
    return asyncio.get_running_loop().time()
