"""Makes pseudo-terminals whose other end programs open like a serial port (pty(7))."""

import array
import fcntl
import grp
import os
import tty
from contextlib import suppress
from pathlib import Path
from typing import Final, NamedTuple

_PTMX: Final = "/dev/ptmx"
#: Requests to a master (asm-generic/ioctls.h: x86, ARM, RISC-V).
_TIOCGPTN: Final = 0x80045430
_TIOCSPTLCK: Final = 0x40045431
#: Owner and group may read and write.
_MODE: Final = 0o660


class PseudoTerminal(NamedTuple):
    """A pseudo-terminal: the descriptor of its master, non-blocking, and the path of its other end."""

    master: int
    path: str


def make_pseudo_terminal(group: int | None) -> PseudoTerminal:
    """Make a pseudo-terminal that programs of a `group` may open; None: of the group of this process.

    A new one echoes, and keeps bytes until the end of a line. This one is raw before anybody can open it, and was never
    opened. It is not opened here either: as long as somebody has it open, nobody is told that others have closed it.

    Raises:
        OSError: there are no more, or this process may not have one.
    """
    master = os.open(_PTMX, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        number = array.array("i", [0])
        fcntl.ioctl(master, _TIOCGPTN, number)
        path = f"/dev/pts/{number[0]}"
        tty.setraw(master)
        _give(path, group)
        Path(path).chmod(_MODE)
        fcntl.ioctl(master, _TIOCSPTLCK, array.array("i", [0]))
    except BaseException:
        os.close(master)
        raise
    return PseudoTerminal(master, path)


def find_group_to_give(name: str) -> int | None:
    """Find the group `name`, if this process may give files to it. May block, as look-ups of groups may."""
    try:
        group = grp.getgrnam(name).gr_gid
    except KeyError:
        return None
    return group if os.geteuid() == 0 or group in {os.getegid(), *os.getgroups()} else None


def has_group(name: str) -> bool:
    """Say whether there is a group `name`. May block, as look-ups of groups may."""
    try:
        grp.getgrnam(name)
    except KeyError:
        return False
    return True


def _give(path: str, group: int | None) -> None:
    """Give the file to the group, or else to that of this process: a new one belongs to the group tty."""
    for wanted in (group, os.getegid()):
        if wanted is not None:
            with suppress(PermissionError):  # a service may be kept from it
                os.chown(path, -1, wanted)
                return
