"""The gateway's wheel, and environments that have it without the checkout."""

import os
import subprocess
import sys
import venv
from importlib import metadata
from pathlib import Path
from zipfile import ZipFile

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

_CHECKOUT = Path(__file__).resolve().parents[2]


def build(folder: Path, *more: str) -> None:
    """Build the pure wheel into `folder`, as a release has it; `more` are options, such as `-t sdist`."""
    pure = os.environ | {"HATCH_BUILD_NO_HOOKS": "true"}
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", *more, "-d", folder]
    subprocess.run(command, capture_output=True, check=True, cwd=_CHECKOUT, env=pure)


def asked_for(library: str) -> set[str]:
    """Return this library, those that it asks for, and those that they ask for."""
    return {canonicalize_name(library)} | _all_of(metadata.requires(library))


def environment(folder: Path, wheel: Path, *libraries: str) -> Path:
    """Make an environment with a wheel, all that it asks for, and other libraries with all that they ask for.

    Nothing is fetched: the libraries are those of this Python, and nothing else of it is there. Returns its Python.
    """
    venv.create(folder, symlinks=True)
    (site,) = folder.glob("lib/python3*/site-packages")
    with ZipFile(wheel) as archive:
        archive.extractall(site)
    (described,) = site.glob("*.dist-info")
    for library in _all_of(metadata.Distribution.at(described).requires).union(*map(asked_for, libraries)):
        for top in {file.parts[0] for file in metadata.files(library) or ()} - {"..", "__pycache__"}:
            (site / top).symlink_to(Path(str(metadata.distribution(library).locate_file(top))))
    return folder / "bin/python"


def _all_of(asked: list[str] | None) -> set[str]:
    needed = (one for one in map(Requirement, asked or ()) if one.marker is None or one.marker.evaluate({"extra": ""}))
    return set().union(*(asked_for(one.name) for one in needed))
