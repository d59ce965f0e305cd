"""The commit that a release is made of, and checked against."""

import os
import re
import subprocess
import tarfile
import tempfile
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any, Final

ROOT: Final = Path(__file__).resolve().parents[2]


def git(*words: str | Path) -> bytes:
    """What git prints."""
    return subprocess.run(["git", "-C", ROOT, *words], stdout=subprocess.PIPE, check=True).stdout


def commit_id() -> str:
    """The last commit."""
    return git("rev-parse", "HEAD").decode().strip()


def export(folder: Path) -> str:
    """Write its files, and nothing else; all that is built gets its time. Returns which commit it is."""
    commit = commit_id()
    with tempfile.TemporaryFile() as file:
        file.write(git("archive", commit))
        file.seek(0)
        with tarfile.open(fileobj=file) as archive:
            archive.extractall(folder, filter="data")
    os.environ["SOURCE_DATE_EPOCH"] = git("log", "-1", "--format=%ct", commit).decode().strip()
    return commit


def committed(*paths: str) -> dict[str, bytes]:
    """Its files, or those in some folders."""
    with tempfile.TemporaryFile() as file:
        file.write(git("archive", "HEAD", *paths))
        file.seek(0)
        return dict(files_of_tar(file))


def files_of_tar(file: IO[bytes]) -> Iterator[tuple[str, bytes]]:
    """Path and content of each file in an archive."""
    with tarfile.open(fileobj=file) as archive:
        for member in archive:
            content = archive.extractfile(member)
            if content is not None and member.isfile():
                yield member.name, content.read()


def version(commit: str = "HEAD") -> str:
    """Its version."""
    text = git("show", f"{commit}:gateway/version.py").decode()
    return re.findall(r'^__version__ = "(.*)"$', text, re.MULTILINE)[0]


def tags() -> list[str]:
    """The versions that the last commit is tagged with: `v1.2.3`."""
    return git("tag", "--points-at", "HEAD", "v*").decode().split()


def project(commit: str = "HEAD") -> dict[str, Any]:
    """What its pyproject.toml declares."""
    declared: dict[str, Any] = tomllib.loads(git("show", f"{commit}:pyproject.toml").decode())["project"]
    return declared
