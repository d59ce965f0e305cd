"""Checks whether the service may read a config file that root can read."""

import stat
from pathlib import Path
from typing import Final

from gateway.config.problem import Problem, warning

#: Where the config of the service is.
SERVICE_CONFIG: Final = Path("/etc/modbus-gateway")


def file_trouble(path: str, folder: Path = SERVICE_CONFIG) -> Problem | None:
    """Warn of a file in the service's `folder` that not all users may read: the service has its own user."""
    file = Path(path).absolute()
    if file.parent != folder or file.stat().st_mode & stat.S_IROTH:
        return None
    return warning((), "the service may not be able to read this file", f"sudo chmod 644 {file}").located(path, 0, 0)
