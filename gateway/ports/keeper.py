"""One port kept open for ever: opened, watched, and opened again after every loss."""

import asyncio
from contextlib import suppress
from typing import Final, Protocol

from gateway.errors import PortClosed, PortError
from gateway.events import Emit, LineLost, LineReopened, LineUp
from gateway.ports.port import OpenPort, Port, Received

#: Pause before the port is tried again; it doubles with every failure. The longest keeps a returned adapter waiting
#: for less than 2 s and an absent one below 2 % of a processor.
FIRST_PAUSE: Final = 0.1
LONGEST_PAUSE: Final = 1.0
#: How long a driver may take to open a port before the attempt counts as failed.
OPENING_DEADLINE: Final = 5.0
#: How long a driver may take to close one before it is left to itself: the last frame at a low rate, and some more.
CLOSING_DEADLINE: Final = 3.0

#: The kind of trouble that follows every unplugging, and how `ports/reasons.py` words it.
_ABSENT: Final = "absent"
_ABSENT_WORDS: Final = ("does not exist", "has no hardware behind it")


class PortOwner(Protocol):
    """Whose port is kept open: a line, a serial listener. It starts without a port."""

    @property
    def is_renewing(self) -> bool:
        """Whether it has closed the port itself to have another one, at once."""

    def port_up(self, port: Port) -> None:
        """The port is open and may be written to at once."""

    @property
    def received(self) -> Received:
        """Takes what became readable."""

    def port_down(self, error: PortError) -> None:
        """The port that `port_up` brought is gone. Called once for each `port_up`."""


class Keeper:
    """Keeps the port of `owner` open while `run` runs.

    `name` and `port_path` are those of the line, for events. `tried` is set once the first attempt has succeeded or
    failed. `error` says why the port is not open; it is None while it is, and before the first attempt. `reopened` is
    how often it was opened after a loss.
    """

    def __init__(self, name: str, port_path: str, open_port: OpenPort, owner: PortOwner, emit: Emit) -> None:
        self.tried = asyncio.Event()
        self.error: PortError | None = None
        self.reopened = 0
        self.port_path = port_path
        self._name = name
        self._open_port = open_port
        self._owner = owner
        self._emit = emit
        self._pause = FIRST_PAUSE
        self._opened_at = 0.0
        self._lost_at: float | None = None
        self._told: set[str] = set()

    @property
    def is_open(self) -> bool:
        """Whether the port is open."""
        return self.tried.is_set() and self.error is None

    async def run(self) -> None:
        """Keep the port open until cancelled; then it is closed, and the owner knows."""
        while True:
            try:
                await self._hold()
            except PortError as error:
                self.failed(error)
            await asyncio.sleep(self._pause)
            self._pause = min(max(2 * self._pause, FIRST_PAUSE), LONGEST_PAUSE)

    def failed(self, error: PortError) -> None:
        """The port could not be opened. Each kind of trouble is told once until the port is open again."""
        self.error = error
        if _trouble(error) not in self._told:
            self._tell(error)
        self.tried.set()

    async def _hold(self) -> None:
        """Open the port and hold it until it is lost.

        Raises:
            PortError: it cannot be opened.
        """
        holding = _Holding(self._owner)
        port = await self._open(holding)
        try:
            holding.up = True
            self._is_up(port)
            self._is_lost(await holding.gone)
        finally:
            holding.lost(PortClosed())
            await _let_go(port)

    async def _open(self, holding: "_Holding") -> Port:
        try:
            async with asyncio.timeout(OPENING_DEADLINE):
                port = await self._open_port(holding)
        except TimeoutError:
            raise PortError(f"{self.port_path}: the driver did not open it within {OPENING_DEADLINE:g} s") from None
        if holding.gone.done():
            await _let_go(port)
            raise holding.gone.result()
        return port

    def _is_up(self, port: Port) -> None:
        self.error = None
        self.reopened += self._lost_at is not None
        self._opened_at = _now()
        self._owner.port_up(port)
        if self._lost_at is None:
            self._emit(LineUp(self._name, self.port_path, port.baud))
        elif self._told:
            away = round(_now() - self._lost_at, 1)
            self._emit(LineReopened(self._name, self.port_path, away, port.baud))
        self._told.clear()
        self.tried.set()

    def _is_lost(self, error: PortError) -> None:
        """The port was open and is gone: that it cannot be found from now on is not news."""
        self.error = error
        if not isinstance(error, PortClosed):  # who has closed it tells why
            self._tell(error)
            self._told.add(_ABSENT)
        self._lost_at = _now()
        # A port that opens and fails at once is as good as absent: only one that stayed renews the short pause.
        if self._owner.is_renewing:
            self._pause = 0.0
        elif self._lost_at - self._opened_at > LONGEST_PAUSE:
            self._pause = FIRST_PAUSE

    def _tell(self, error: PortError) -> None:
        self._told.add(_trouble(error))
        self._emit(LineLost(self._name, self.port_path, reason=str(error)))

    def __repr__(self) -> str:
        state = "not tried yet" if not self.tried.is_set() else "open" if self.error is None else f"down: {self.error}"
        return f"<Keeper {self._name} {self.port_path} {state}>"


class _Holding:
    """One opening of the port, as the port sees it: bytes go straight to the owner, a loss comes to the keeper too."""

    __slots__ = ("_owner", "gone", "received", "up")

    def __init__(self, owner: PortOwner) -> None:
        self.received = owner.received
        self.gone: asyncio.Future[PortError] = asyncio.get_running_loop().create_future()
        self.up = False
        self._owner = owner

    def lost(self, error: PortError) -> None:
        """The port is gone: the owner hears it now, not when the keeper's task has its turn."""
        if not self.gone.done():
            self.gone.set_result(error)
        if self.up:
            self.up = False
            self._owner.port_down(error)


def _trouble(error: PortError) -> str:
    """What kind of trouble it is: the error's own words, unless they are one of the ways to say that it is absent."""
    reason = str(error)
    return _ABSENT if any(words in reason for words in _ABSENT_WORDS) else reason


async def _let_go(port: Port) -> None:
    port.close()
    with suppress(TimeoutError):  # then the driver hangs; the port is closed when it comes back
        async with asyncio.timeout(CLOSING_DEADLINE):
            await port.wait_closed()


def _now() -> float:
    return asyncio.get_running_loop().time()
