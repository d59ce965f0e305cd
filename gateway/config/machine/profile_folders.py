"""The folders in which users keep their own profiles."""

from os import lstat
from pathlib import Path
from typing import Final

from gateway.config.machine.file_text import SERVICE_CONFIG, folder_of
from gateway.profiles import is_file_name

#: The folder beside a config.
BESIDE: Final = "profiles"
#: Where every config of this machine finds them.
OWN_PROFILES: Final = SERVICE_CONFIG / BESIDE


def folders_of(config: Path, own: Path = OWN_PROFILES) -> tuple[Path, ...]:
    """List the folders with profiles for a config, the nearest first."""
    beside = config.parent / BESIDE
    return (own,) if folder_of(config) == own.parent.resolve() else (beside, own)


def file_of(name: str, folder: Path) -> Path | None:
    """Find the file of a profile in a folder; None if there is none.

    Raises:
        OSError: the folder cannot be looked into.
    """
    file = folder / f"{name}.toml"
    try:
        lstat(file)
    except (FileNotFoundError, NotADirectoryError):
        return None
    return file


def names_in(folder: Path) -> list[str]:
    """List the profiles that have a file in a folder.

    Raises:
        OSError: the folder cannot be looked into.
    """
    try:
        return sorted(file.stem for file in folder.iterdir() if file.suffix == ".toml" and is_file_name(file.stem))
    except (FileNotFoundError, NotADirectoryError):
        return []
