"""A virtual serial port: a link by which each program of this machine gets a pseudo-terminal of its own."""

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import ClassVar, Final

from gateway.clock.threads import ThreadPerCall
from gateway.errors import PortClosed, PortError
from gateway.hardware.pseudo_terminals import find_group_to_give, make_pseudo_terminal
from gateway.ports.link_file import LinkFile
from gateway.ports.port import PortUser, PtySettings
from gateway.ports.pty_port import PtyPort, PtyUser

#: So many programs may use one virtual port at the same time; the next one loses its port when it asks.
MOST_PROGRAMS: Final = 16

#: Returns the user of the port of a program.
Came = Callable[[PtyPort], PtyUser]


async def open_pty(settings: PtySettings, folder: Path, user: PortUser) -> "PtyLink":
    """Make the link, in `folder` unless its path is absolute.

    Raises:
        PortError: it cannot be made; the message says why and what to do.
    """
    loop = asyncio.get_running_loop()
    threads = ThreadPerCall(f"group {settings.group}")
    group = await loop.run_in_executor(threads, find_group_to_give, settings.group)
    return PtyLink(loop, folder / settings.name, group, settings.latency, user)


class PtyLink:
    """The link at `path`; see Port. It carries no bytes: the ports of programs do, from `serve` on.

    `group` is the group whose programs may open it; None for that of this process.
    """

    has_arrived: ClassVar[None] = None
    errors: ClassVar[None] = None

    def __init__(
        self, loop: asyncio.AbstractEventLoop, path: Path, group: int | None, latency: float, user: PortUser
    ) -> None:
        self.path = path
        self.latency = latency
        self.is_virtual = True
        self.baud: int | None = None
        self._loop = loop
        self._group = group
        self._user: PortUser | None = user
        self._came: Came | None = None
        self._link = LinkFile(path)
        #: The port that the link leads to, and those that programs use.
        self._free = self._lead_to_another()
        self._used: set[PtyPort] = set()

    def serve(self, came: Came) -> None:
        """Let programs ask: `came` gets the port of each."""
        self._came = came
        self._free.begin(came(self._free))

    def write(self, data: bytes) -> None:
        """Do nothing: no program has this port."""

    def pause(self) -> bool:
        """Return False: there is nothing to hold back."""
        return False

    def read_now(self) -> None:
        """Do nothing: the ports of programs are read."""

    def change_baud(self, baud: int) -> None:
        """Do nothing: bytes take no time here."""

    def close(self) -> None:
        """Remove the link, and close the ports of all programs."""
        self._lose(PortClosed())

    async def wait_closed(self) -> None:
        """Return at once."""

    def _lead_to_another(self) -> PtyPort:
        """Make a new port, and let the link lead to it. Raises PortError."""
        try:
            port = PtyPort(self._loop, make_pseudo_terminal(self._group), self.latency, self._taken, self._ended)
        except OSError as error:
            raise PortError(f"there is no pseudo-terminal for a virtual port: {error.strerror}") from error
        try:
            self._link.lead_to(port.path)
        except PortError:
            port.close()
            raise
        return port

    def _taken(self, port: PtyPort) -> bool:
        """Give others another port than this one. Return whether its program may ask."""
        try:
            self._free = self._lead_to_another()
        except PortError as error:
            self._lose(error)
            return False
        self._used.add(port)
        if self._came is not None:
            self.serve(self._came)
        return len(self._used) <= MOST_PROGRAMS

    def _ended(self, port: PtyPort) -> None:
        """Forget the port of a program that has closed it. If it was not taken yet, others need another one."""
        self._used.discard(port)
        if port is self._free and self._user is not None:
            self._taken(port)
            self._used.discard(port)

    def _lose(self, error: PortError) -> None:
        user, self._user = self._user, None
        if user is None:
            return
        self._link.remove()
        for port in (self._free, *self._used):
            port.close()
        user.lost(error)
