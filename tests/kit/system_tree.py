"""A Debian with systemd in a folder, for tests that boot it; kept outside the checkout.

`python3 tests/kit/system_tree.py` makes it, once. That needs root, mmdebstrap, a Debian mirror, and half a minute.
"""

import hashlib
import os
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory

_MAKE = ("mmdebstrap", "--quiet", "--variant=minbase", "--include=systemd,systemd-sysv,python3")

#: The release of Debian that is booted, unless another one is asked for.
RELEASE = "bookworm"

#: The Python in it.
PYTHON = (3, 11)


def system_tree(release: str = RELEASE, command: tuple[str, ...] = _MAKE) -> Path:
    """Where it is, or would be. One that is made by another command has another name."""
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    key = hashlib.sha256(" ".join([*command, release]).encode()).hexdigest()[:12]
    return cache / "modbus-gateway-tests" / f"{release}-{key}"


def make(release: str = RELEASE, command: tuple[str, ...] = _MAKE) -> None:
    """Make it, unless it is there."""
    tree = system_tree(release, command)
    if tree.exists():
        return
    tree.parent.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=tree.parent) as folder:
        fresh = Path(folder, "root")
        subprocess.run([*command, release, str(fresh)], check=True)
        fresh.rename(tree)


if __name__ == "__main__":
    make()
