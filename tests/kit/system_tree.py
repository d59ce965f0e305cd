"""A Debian with systemd in a folder, for tests that boot it; kept outside the checkout.

`python3 tests/kit/system_tree.py` makes it, once. That needs root, mmdebstrap, a Debian mirror, and half a minute.
"""

import hashlib
import os
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory

_SUITE = "bookworm"
_MAKE = ("mmdebstrap", "--quiet", "--variant=minbase", "--include=systemd,systemd-sysv,python3", _SUITE)

#: The Python in it.
PYTHON = (3, 11)


def system_tree() -> Path:
    """Where it is, or would be. One that is made differently has another name."""
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    key = hashlib.sha256(" ".join(_MAKE).encode()).hexdigest()[:12]
    return cache / "modbus-gateway-tests" / f"{_SUITE}-{key}"


def make() -> None:
    """Make it, unless it is there."""
    tree = system_tree()
    if tree.exists():
        return
    tree.parent.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=tree.parent) as folder:
        fresh = Path(folder, "root")
        subprocess.run([*_MAKE, str(fresh)], check=True)
        fresh.rename(tree)


if __name__ == "__main__":
    make()
