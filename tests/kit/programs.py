"""The programs and libraries that tests use beside Python, and the Debian packages that bring them.

As a command it prints the packages of those that are missing. With --install it installs them, as root and where there
is apt, and makes the Debian that tests boot.
"""

import ctypes
import os
import shutil
import subprocess
import sys
import sysconfig
from contextlib import suppress
from pathlib import Path
from typing import Final

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[1]))

from kit.system_tree import make, system_tree

PACKAGES: Final = {
    "/usr/share/keyrings/debian-archive-keyring.gpg": "debian-archive-keyring",  # of the Debian that is booted
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
    if program.startswith("/"):
        return program if Path(program).exists() else None
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


def install() -> None:
    """Install what is missing, if we may; what cannot be had leaves tests out."""
    if os.geteuid() != 0 or not shutil.which("apt-get"):
        return
    apt = ("apt-get", "--quiet=2")
    if packages := missing():
        print("installing what tests use (once):", *packages, flush=True)
        own = os.environ | {"DEBIAN_FRONTEND": "noninteractive"}
        subprocess.run([*apt, "update"], check=False)
        command = [*apt, "install", "--yes", "--no-install-recommends"]

        def is_installed(*names: str) -> bool:
            return not subprocess.run([*command, *names], env=own, stdout=subprocess.DEVNULL, check=False).returncode

        # One that this system does not have, as Ubuntu the browser, would keep out all others.
        if not is_installed(*packages) and (failed := [each for each in packages if not is_installed(each)]):
            print("not installed, so some tests will be left out:", *failed)
    if not system_tree().exists():
        print("making the Debian that tests boot (once)", flush=True)
        try:
            make()
        except (OSError, subprocess.CalledProcessError) as error:
            print(f"not made, so tests that boot it will be left out: {error}")


if __name__ == "__main__":
    if sys.argv[1:] == ["--install"]:
        install()
    else:
        print(*missing())
