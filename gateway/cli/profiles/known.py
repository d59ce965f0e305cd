"""The profiles that there are, for a config or without one, and their list."""

import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

from gateway.cli.kit.columns import align
from gateway.cli.kit.usage import WrongUsageError
from gateway.config.load import find_profile, load
from gateway.config.machine.profile_folders import OWN_PROFILES, folders_of
from gateway.config.problem import Problem
from gateway.config.profile_files import Origin, ProfileFiles, origin_of
from gateway.config.schema.profile import ProfileTable


class BrokenFileError(Exception):
    """A config, or the file of a profile, has errors."""

    def __init__(self, problems: tuple[Problem, ...]) -> None:
        super().__init__(*problems)
        self.problems = problems


class Known(NamedTuple):
    """A profile, and where it comes from."""

    table: ProfileTable
    origin: Origin


class Profiles:
    """The profiles of a config file, and those of all configs without one.

    Raises:
        BrokenFileError: the config has errors.
    """

    def __init__(self, config: str | Path | None = None) -> None:
        folders = (OWN_PROFILES,) if config is None else folders_of(Path(config), OWN_PROFILES)
        self.files = ProfileFiles(folders)
        self._tables: dict[str, ProfileTable] = {}
        if config is not None:
            loaded = load(config)
            if loaded.config is None:
                raise BrokenFileError(loaded.problems)
            self._tables = dict(loaded.config.profile)

    def find(self, name: str) -> Known | tuple[Problem, ...]:
        """Find a profile; what is wrong with its file if that is broken, and nothing if there is none."""
        table = self._tables.get(name)
        if table is None:
            file = find_profile(self.files, name)
            if file is None or file.table is None:
                return () if file is None else file.problems
            table = file.table
        return Known(table, origin_of(name, table, self.files))

    def get(self, name: str) -> Known:
        """Find a profile.

        Raises:
            WrongUsageError: there is none.
            BrokenFileError: its file has errors.
        """
        found = self.find(name)
        if not isinstance(found, Known) and not found:
            raise WrongUsageError(f'there is no profile "{name}"', self.files.advise_on(name, self._tables))
        if not isinstance(found, Known):
            raise BrokenFileError(found)
        return found

    def names(self) -> list[str]:
        """List all names."""
        return sorted({*self._tables, *self.files.names()})


def find_matching(profiles: Profiles, word: str) -> tuple[list[Known], list[Problem]]:
    """Find the profiles with a word in their name, title or maker, and what is wrong with broken files."""
    known: list[Known] = []
    problems: list[Problem] = []
    for name in profiles.names():
        found = profiles.find(name)
        if not isinstance(found, Known):
            problems += found
        elif word.lower() in f"{name}\n{found.table.title}\n{found.table.maker}".lower():
            known.append(found)
    return known, [*problems, *profiles.files.problems.values()]


def list_as_text(known: Iterable[Known]) -> str:
    """Show a list for people."""
    return align([("NAME", "TITLE", "MAKER", "SEEN", "FROM"), *_rows(known)])


def list_as_json(known: Iterable[Known]) -> str:
    """Make a list for programs."""
    rows = [
        {
            "name": each.origin.name,
            "title": each.table.title,
            "maker": each.table.maker,
            "seen": each.table.seen,
            "from": each.origin.place,
            "hides": each.origin.hides,
        }
        for each in known
    ]
    return json.dumps(rows, indent=2, ensure_ascii=False)


def _rows(known: Iterable[Known]) -> Iterator[tuple[str, ...]]:
    for table, origin in known:
        yield origin.name, table.title, table.maker or "-", table.seen or "-", str(origin)
