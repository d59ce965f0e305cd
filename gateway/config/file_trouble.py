"""What keeps the service from reading a config file that root can read."""

import stat
from pathlib import Path
from typing import Final

from gateway.config.problem import Problem, warning

#: Where the config of the service is.
SERVICE_CONFIG: Final = Path("/etc/modbus-gateway")


def file_trouble(path: str, folder: Path = SERVICE_CONFIG) -> Problem | None:
    """A file in the service's `folder` that not everybody may read: the service has a user of its own."""
    file = Path(path).absolute()
    if file.parent != folder or file.stat().st_mode & stat.S_IROTH:
        return None
    return warning((), "the service may not be able to read this file", f"sudo chmod 644 {file}").located(path, 0, 0)
