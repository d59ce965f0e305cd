"""The programs and libraries that tests use beside Python, and the Debian packages that bring them.

As a command it prints the packages of those that are missing.
"""

import ctypes
import os
import shutil
import sysconfig
from contextlib import suppress
from pathlib import Path
from typing import Final

PACKAGES: Final = {
    "bash": "bash",
    "cc": "gcc",
    "chromium": "chromium-headless-shell",
    "fish": "fish",
    "groff": "groff",
    "libmodbus.so.5": "libmodbus5",
    "mbpoll": "mbpoll",
    "mmdebstrap": "mmdebstrap",
    "mosquitto": "mosquitto",
    "mosquitto_sub": "mosquitto-clients",
    "nats-server": "nats-server",
    "openssl": "openssl",
    "promtool": "prometheus",
    "Python.h": "python3-dev",
    "ser2net": "ser2net",
    "socat": "socat",
    "systemd-analyze": "systemd",
    "systemd-nspawn": "systemd-container",
    "tshark": "tshark",
    "valgrind": "valgrind",
    "zsh": "zsh",
}
#: The browser without windows is a third of the other one.
_OTHER_NAMES: Final = {"chromium": ("chromium-headless-shell",)}
#: Debian's daemons lie where only root looks.
_PATH: Final = f"{os.environ.get('PATH', os.defpath)}:/usr/sbin:/usr/local/sbin"


def find(program: str) -> str | None:
    """Return the path of one of the programs in `PACKAGES`, or the name of a library; None where it is missing."""
    if program == "Python.h":
        header = Path(sysconfig.get_path("include"), program)
        return str(header) if header.exists() else None
    if ".so." in program:
        with suppress(OSError):
            return ctypes.CDLL(program)._name
        return None
    names = (*_OTHER_NAMES.get(program, ()), program)
    return next((path for name in names if (path := shutil.which(name, path=_PATH))), None)


def missing() -> list[str]:
    """Return the packages of all programs that are missing."""
    return [package for program, package in PACKAGES.items() if find(program) is None]


if __name__ == "__main__":
    print(*missing())
