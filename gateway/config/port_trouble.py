"""What can be seen of a port without opening it."""

import os
import stat
from pathlib import Path

from gateway.ports.reasons import permission_remedy


def port_trouble(path: str) -> str | None:
    """What keeps this user from using the serial port at `path` at the moment, or None."""
    try:
        mode = Path(path).stat().st_mode
    except (FileNotFoundError, NotADirectoryError):
        return "there is no such port at the moment"
    except OSError as error:
        return f"cannot be looked at: {error.strerror}"
    if not stat.S_ISCHR(mode):
        return "is no serial port"
    if not os.access(path, os.R_OK | os.W_OK):
        return f"this user may not open it: {permission_remedy(path)}"
    return None
