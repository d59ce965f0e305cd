"""The Pythons and the kinds of machine that a release is for."""

from pathlib import Path
from typing import Final

PYTHONS: Final = ("3.11", "3.12", "3.13", "3.14")
#: Python's name of each kind of machine, and Debian's.
MACHINES: Final = {"x86_64": "amd64", "aarch64": "arm64", "armv7l": "armhf"}


def tag_of(python: str) -> str:
    """The tag of a Python, as it stands in the name of a wheel."""
    return "cp" + python.replace(".", "")


def compiled_wheels(dist: Path, *, python: str = "3.*", machine: str = "*") -> list[Path]:
    """The compiled wheels in `dist`: all, or those for a Python or a kind of machine."""
    return sorted(dist.glob(f"mbgw-*-{tag_of(python)}-*_{machine}.whl"))


def machine_of(wheel: Path) -> str:
    """The kind of machine that a compiled wheel is for."""
    return next(machine for machine in MACHINES if wheel.stem.endswith(f"_{machine}"))


def is_pure(wheel: Path) -> bool:
    """Whether it fits every Python and every machine."""
    return wheel.stem.endswith("-none-any")
