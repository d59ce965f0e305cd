"""One pseudo-terminal as the serial port of one program of this machine.

From the moment a program has opened it, until it has closed it, it is the program's: the link leads to another one by
then, and nobody opens this one any more. What the program had asked, or had not read, when it ended goes with it. So
nobody reads what was for another, whatever happens between two looks of the gateway.

Programs that open it at the same moment share it, as one client. When one of them closes it, what is under way is given
up: it may have been his.
"""

import asyncio
import os
import select
import termios
from collections.abc import Callable
from contextlib import suppress
from typing import ClassVar, Final, Protocol

from gateway.errors import PortClosed, PortError
from gateway.hardware.closings import Closings
from gateway.hardware.pseudo_terminals import PseudoTerminal
from gateway.ports.port import PortUser

#: More than the longest frame.
READ_SIZE: Final = 1024
#: All that can have arrived before a read (N_TTY_BUF_SIZE).
PIECES: Final = 4

_LEFT: Final = "the program has closed the port"
_TAKES_NO_MORE: Final = "the program does not read its responses"


class PtyUser(PortUser, Protocol):
    """The user of a program's port."""

    def give_up(self) -> None:
        """Forget the request in progress, and incomplete ones: the program that has sent them may have left."""


class PtyPort:
    """The port of a program: see Port. `latency` in seconds.

    `taken` is called when a program has opened it: others have to get another one from then on. It returns False if
    this one is not wanted. `ended` is called before its user is told of the end.
    """

    has_arrived: ClassVar[None] = None
    errors: ClassVar[None] = None

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        terminal: PseudoTerminal,
        latency: float,
        taken: Callable[["PtyPort"], bool],
        ended: Callable[["PtyPort"], None],
    ) -> None:
        self.latency = latency
        self.is_virtual = True
        self.baud: int | None = None
        self.path = terminal.path
        #: Whether a program has asked, and is there.
        self.is_in_use = False
        self._loop = loop
        self._master = terminal.master
        try:
            self._closings = Closings(terminal.path)
        except OSError:
            os.close(terminal.master)
            raise
        self._taken = taken
        self._ended = ended
        self._user: PtyUser | None = None
        self._is_open = True
        #: Whether others get another one.
        self._is_taken = False
        self._poll = select.poll()
        self._poll.register(self._master, select.POLLIN)

    def begin(self, user: PtyUser) -> None:
        """Deliver bytes to `user` from now on."""
        self._user = user
        for descriptor in (self._master, self._closings.descriptor):
            self._loop.add_reader(descriptor, self.read_now)

    def write(self, data: bytes) -> None:
        """Send `data`, unless the program that has asked may have left. One that reads nothing loses its port."""
        if not self._is_open or self._has_given_up():
            return
        if not self._look()[0]:  # with this response, all that was written is done with
            self._closings.forget()
        self._stop_echo()
        try:
            is_sent = os.write(self._master, data) == len(data)
        except OSError:
            is_sent = False
        if not is_sent:
            self._end(PortError(_TAKES_NO_MORE))

    def pause(self) -> bool:
        """Return False: it is read at once."""
        return False

    def change_baud(self, baud: int) -> None:
        """Do nothing: bytes take no time here."""

    def read_now(self) -> None:
        """Deliver what the program has written, or find that it has left."""
        has_given_up = self._is_open and self._has_given_up()
        if self._closings.was_opened and not self._is_taken:
            self._is_taken = True
            if not self._taken(self):
                self._end(PortClosed())
        has_bytes, has_left = self._look()
        if has_left:
            self._end(PortError(_LEFT))
        elif has_bytes and not has_given_up and not self._has_given_up():
            self.is_in_use = True
            self._deliver()

    def close(self) -> None:
        """Close the port; the program reads an error."""
        self._end(PortClosed())

    async def wait_closed(self) -> None:
        """Return at once."""

    def __repr__(self) -> str:
        return f"<PtyPort {self.path} {'taken' if self._is_taken else 'free'}>"

    def _look(self) -> tuple[bool, bool]:
        """Return whether there is something to read, and whether everybody who had it open has left."""
        events = dict(self._poll.poll(0)).get(self._master, 0) if self._is_open else 0
        return bool(events & select.POLLIN), bool(events & select.POLLHUP)

    def _has_given_up(self) -> bool:
        """Forget all that is of one who has closed it, in both directions. Return whether he may have asked."""
        closing = self._closings.look()
        if closing is None:
            return False
        with suppress(OSError, termios.error):  # the last one has left
            termios.tcflush(self._master, termios.TCOFLUSH)  # what is on its way, and then what has arrived there
            termios.tcsetattr(self._master, termios.TCSAFLUSH, termios.tcgetattr(self._master))
        if closing == "unwritten":
            return False
        with suppress(OSError):
            while os.read(self._master, READ_SIZE):
                pass
        if self._user is not None:
            self._user.give_up()
        return True

    def _stop_echo(self) -> None:
        """End the echo that a program may have set: the response to a write would come back as the same write again."""
        with suppress(OSError, termios.error):  # the last one has left
            attributes = termios.tcgetattr(self._master)
            if attributes[3] & termios.ECHO:
                attributes[3] &= ~termios.ECHO
                termios.tcsetattr(self._master, termios.TCSANOW, attributes)

    def _deliver(self) -> None:
        """Deliver what has arrived."""
        for _ in range(PIECES):
            try:
                data = os.read(self._master, READ_SIZE)
            except OSError:  # nothing more, or the last one has left
                return
            if self._user is None:
                return
            self._user.received(data)

    def _end(self, error: PortError) -> None:
        """Close the port, and tell its user."""
        if not self._is_open:
            return
        self._is_open = self.is_in_use = False
        if self._user is not None:
            for descriptor in (self._master, self._closings.descriptor):
                self._loop.remove_reader(descriptor)
        self._closings.close()
        os.close(self._master)
        user, self._user = self._user, None
        if user is not None:
            self._ended(self)
            user.lost(error)
