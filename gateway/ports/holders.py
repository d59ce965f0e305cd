"""Which program uses a serial port, as far as this user may see."""

import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Final

PROC: Final = Path("/proc")


def holder(device: str) -> str | None:
    """A program that uses the device, as `mbusd (pid 412)`; None if there is none, or none that may be seen.

    Only root may see other users' descriptors. Everybody may see locks, and most serial programs set one.
    """
    for pid in (*_by_lock(Path(device)), *_by_descriptor(device)):
        if pid != os.getpid():
            return f"{_name(pid)} (pid {pid})"
    return None


def _by_lock(device: Path) -> Iterator[int]:
    with suppress(OSError):
        node = device.stat()
        place = f"{os.major(node.st_dev):02x}:{os.minor(node.st_dev):02x}:{node.st_ino}"
        for line in (PROC / "locks").read_text().splitlines():
            match line.split():
                case [_, "FLOCK", _, _, pid, lock, *_] if lock == place:
                    yield int(pid)


def _by_descriptor(device: str) -> Iterator[int]:
    for process in PROC.glob("[1-9]*"):
        with suppress(OSError):  # another user's process, or one that has just ended
            if any(descriptor.readlink() == Path(device) for descriptor in (process / "fd").iterdir()):
                yield int(process.name)


def _name(pid: int) -> str:
    try:
        return (PROC / str(pid) / "comm").read_text().strip()
    except OSError:
        return "a program"
