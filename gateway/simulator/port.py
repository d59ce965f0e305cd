"""A virtual serial port: a pseudo-terminal behind a symbolic link. This is the devices' end."""

import os
import tty
from contextlib import suppress
from pathlib import Path
from typing import Final

from gateway.errors import PortError
from gateway.hardware.ioctls import read_baud

#: The rate to use if the kernel does not report one.
ASSUMED_BAUD: Final = 9600

_READ_SIZE: Final = 4096
_VIRTUAL_PORTS: Final = Path("/dev/pts")


class VirtualPort:
    """A pseudo-terminal with a link at `path`; both exist until `close`.

    The link of a killed simulator is replaced: it points nowhere, or to a newer terminal of another program with the
    same number.

    Raises:
        PortError: the link cannot be created at `path`.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        # The near end stays open too: otherwise the far end would read EIO while no program has the port open.
        self._far_end, self._near_end = os.openpty()
        tty.setraw(self._near_end)
        os.set_blocking(self._far_end, False)
        self._device = os.ttyname(self._near_end)
        try:
            _link(path, self._device)
        except PortError:
            self._close_both_ends()
            raise

    def fileno(self) -> int:
        """Return the descriptor of the devices' end."""
        return self._far_end

    @property
    def baud(self) -> int:
        """The rate that the port is set to."""
        return read_baud(self._far_end) or ASSUMED_BAUD

    def read(self) -> bytes:
        """Return what was written to the port, at most 4096 bytes; empty if nothing was."""
        with suppress(BlockingIOError):
            return os.read(self._far_end, _READ_SIZE)
        return b""

    def write(self, data: bytes) -> None:
        """Have the port receive `data`, which is lost if the kernel's buffer is full."""
        with suppress(BlockingIOError):
            os.write(self._far_end, data)

    def close(self) -> None:
        """Remove the link, if it is still this port's, and close the terminal."""
        with suppress(OSError):
            if str(self.path.readlink()) == self._device:
                self.path.unlink()
        self._close_both_ends()

    def _close_both_ends(self) -> None:
        os.close(self._near_end)
        os.close(self._far_end)


def _link(path: Path, device: str) -> None:
    try:
        path.symlink_to(device)
    except FileExistsError:
        _replace_left_over(path, device)
    except OSError as error:
        raise PortError(f"{path} cannot be created: {error.strerror}") from error


def _replace_left_over(path: Path, device: str) -> None:
    if path.is_char_device() and not path.resolve().is_relative_to(_VIRTUAL_PORTS):
        raise PortError(f"{path} is a real port; devices can only be simulated on a virtual one; use a free path")
    if path.exists() and not _points_elsewhere(path):
        is_ours = path.is_symlink() and path.resolve().is_relative_to(_VIRTUAL_PORTS)
        advice = ", or remove this link if no simulator uses it" if is_ours else ""
        raise PortError(f"{path} already exists; use a free path{advice}")
    fresh = path.with_name(f"{path.name}.{os.getpid()}")
    try:
        fresh.symlink_to(device)
        fresh.replace(path)
    except OSError as error:
        raise PortError(f"{path} cannot be replaced: {error.strerror}") from error


def _points_elsewhere(path: Path) -> bool:
    """Tell whether `path` is a link to a virtual terminal that is newer than the link."""
    is_virtual = path.is_symlink() and path.resolve().is_relative_to(_VIRTUAL_PORTS)
    return is_virtual and path.stat().st_ctime_ns > path.lstat().st_mtime_ns
