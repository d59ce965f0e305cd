"""A symbolic link that leads to a pseudo-terminal. It replaces such a link, which a killed gateway may have left.

No other file of a user is ever replaced or deleted.
"""

import os
import re
from contextlib import suppress
from pathlib import Path
from typing import Final

from gateway.errors import PortError

_PSEUDO_TERMINAL: Final = re.compile(r"/dev/pts/\d+")


class LinkFile:
    """A link at `path`, from the first `lead_to` until `remove`."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._next = path.with_name(f".{path.name}.new")
        #: Where it leads; empty while there is none of ours.
        self._target = ""

    def lead_to(self, target: str) -> None:
        """Let it lead to `target`, in one step.

        Raises:
            PortError: it cannot be made, or something else is there.
        """
        try:
            self._look()
            if self._next.is_symlink():  # left by a gateway that was killed
                self._next.unlink()
            self._next.symlink_to(target)
            self._next.replace(self._path)
        except OSError as error:
            what, where = os.strerror(error.errno or 0), self._path.parent
            raise PortError(f"{self._path} cannot be made: {what}; may this user write in {where}?") from error
        self._target = target

    def remove(self) -> None:
        """Remove it, unless somebody has replaced it."""
        with suppress(OSError):
            if self._target and str(self._path.readlink()) == self._target:
                self._path.unlink()
        self._target = ""

    def _look(self) -> None:
        """Raise PortError unless the path is free, or has our link, or one that a killed gateway has left."""
        if not os.path.lexists(self._path):
            return
        is_link = self._path.is_symlink()
        target = str(self._path.readlink()) if is_link else ""
        if self._target and target != self._target:
            raise PortError(f"{self._path} was replaced by something else: do two gateways have this port?")
        is_left = not self._path.exists() or _PSEUDO_TERMINAL.fullmatch(target)
        if not (is_link and is_left):
            raise PortError(f"{self._path} is there already and is not a virtual port: move it, or use another name")
