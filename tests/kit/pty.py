"""A virtual serial port for tests: a pseudo-terminal behind a symlink, as udev makes one for an adapter."""

import fcntl
import os
import select
import sys
import termios
import tty
from pathlib import Path
from typing import Self

from gateway.hardware.ioctls import read_baud
from kit.process import PATIENCE


class VirtualPort:
    """The devices' end of a virtual serial port; `path` is what the gateway opens. Plugged in when it is made."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.far_end = -1
        self._near_end = -1
        self.plug()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.unplug()

    @property
    def is_plugged(self) -> bool:
        """Whether `path` leads anywhere."""
        return self.far_end >= 0

    @property
    def device(self) -> str:
        """The device that `path` leads to."""
        return os.ttyname(self._near_end)

    @property
    def baud(self) -> int | None:
        """The rate that the gateway has set."""
        return read_baud(self.far_end)

    def plug(self) -> None:
        """Come back as a new device behind the same path, as an adapter does."""
        self.far_end, self._near_end = os.openpty()  # kept open: closed, the far end would read EIO
        tty.setraw(self._near_end)
        os.set_blocking(self.far_end, False)
        fresh = self.path.with_name(self.path.name + ".new")
        fresh.symlink_to(os.ttyname(self._near_end))
        fresh.replace(self.path)

    def unplug(self) -> None:
        """Vanish: an open port hangs up, the path leads nowhere."""
        if self.is_plugged:
            self.path.unlink()
            os.close(self._near_end)
            os.close(self.far_end)
            self.far_end = self._near_end = -1

    def write(self, data: bytes) -> None:
        """Devices say `data`."""
        assert os.write(self.far_end, data) == len(data)

    @property
    def unread(self) -> int:
        """How many bytes of theirs the system has for the gateway, which has not read them."""
        count = fcntl.ioctl(self._near_end, termios.FIONREAD, bytes(4))
        return int.from_bytes(count, sys.byteorder)

    def read(self, size: int, timeout: float = PATIENCE) -> bytes:
        """What the gateway wrote: `size` bytes, or fewer once `timeout` seconds have passed without any."""
        data = b""
        while len(data) < size and select.select([self.far_end], [], [], timeout)[0]:
            data += os.read(self.far_end, size - len(data))
        return data
