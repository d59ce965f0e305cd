"""The files that a config includes: which they are, and what is written in one of them."""

import os
from collections.abc import Iterator
from fnmatch import filter as matching
from glob import has_magic
from pathlib import Path

from gateway.config.machine.file_text import UnreadableFile, read_file_text
from gateway.config.problem import WrongValue


def find_included(pattern: str, config: Path) -> list[str]:
    """List the files that a pattern means, in the order of their names, as they are called from the config's folder.

    Folders, hidden files and the config itself match no pattern. A name without wildcards is there even if no file is.

    Raises:
        WrongValue: the pattern cannot be used, or its folder cannot be read.
    """
    folder, name = os.path.split(pattern)
    if not has_magic(pattern):
        return [str(Path(pattern))]
    if has_magic(folder):
        raise WrongValue("has a wildcard in the name of a folder", 'name each folder: ["east/*.toml", "west/*.toml"]')
    try:
        names = matching(sorted(each.name for each in (config.parent / folder).iterdir()), name)
    except (FileNotFoundError, NotADirectoryError):
        return []
    except OSError as wrong:
        there = config.parent / folder
        raise WrongValue(f"{there} cannot be read: {wrong.strerror}", f"sudo chmod 755 {there}") from None
    found = [str(Path(folder, each)) for each in names if each[0] != "." or name[0] == "."]
    if not all(map(str.isprintable, found)):
        raise WrongValue("means a file whose name has characters that cannot be seen")
    return [each for each in found if not (config.parent / each).is_dir() and not is_config(each, config)]


def is_config(name: str, config: Path) -> bool:
    """Tell whether a name leads to the config itself."""
    return os.path.realpath(config.parent / name) == os.path.realpath(config)


def files_of(config: Path) -> list[Path]:
    """List a config and the files that it includes, whatever is wrong with it or with them."""
    import tomllib  # noqa: PLC0415 - a gateway that runs reads no TOML

    try:
        patterns = tomllib.loads(read_file_text(config)).get("include", ())
        names = [name for pattern in patterns for name in find_included(pattern, config)]
    except (UnreadableFile, ValueError, RecursionError, TypeError, AttributeError):
        names = []
    return [config, *(config.parent / name for name in dict.fromkeys(names))]


def written_in(config: Path, section: str, key: str) -> tuple[str, Path]:
    """Look up a text in a config, whatever else is in it, with the file that it is in; empty if it is not there."""
    return next(_written_in(config, section, key), ("", config))


def _written_in(config: Path, section: str, key: str) -> Iterator[tuple[str, Path]]:
    import tomllib  # noqa: PLC0415 - see above

    for file in files_of(config):
        try:
            value = tomllib.loads(read_file_text(file))[section][key]
        except (UnreadableFile, ValueError, RecursionError, LookupError, TypeError):
            continue
        if isinstance(value, str):
            yield value, file
