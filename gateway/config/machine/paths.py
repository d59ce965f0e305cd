"""Finds relative paths whose files are only where earlier versions looked for them: in the working directory."""

import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path as FilePath
from typing import Any, Final

from gateway.config.problem import Path, Problem, warning

#: The keys that name a file, as text or as `{ file = ... }`.
_KEYS: Final = frozenset(
    {"certificate", "key", "clients_ca", "crl", "ca", "users", "token", "password", "credentials", "socket"}
)


def check_paths(
    document: Mapping[str, Any], folder: FilePath, exists: Callable[[str], bool] = os.path.exists
) -> Iterator[Problem]:
    """Warn of each path in a `document` whose file is not in `folder`, but in the working directory."""
    for path, written in _named(document, ()):
        there = str(folder / written)
        if not exists(there) and exists(written):
            before = FilePath(written).absolute()
            what = f"there is no {there}: paths count from the folder of the config now, and no longer to {before}"
            yield warning(path, what, f'write "{before}", or move the file')


def _named(value: Any, path: Path) -> Iterator[tuple[Path, str]]:
    """Find the files that a table and the tables in it name, each with its place."""
    if isinstance(value, list):
        for index, each in enumerate(value):
            yield from _named(each, (*path, index))
    elif isinstance(value, dict):
        for key, each in value.items():
            yield from _named(each, (*path, key))
    elif isinstance(value, str) and _KEYS.intersection(path[-2:-1] if path[-1] == "file" else path[-1:]):
        yield path, value
