"""A file of a profile: one kind of device, in a table `[profile.NAME]` as in a config."""

import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path as FilePath
from typing import Any, Final

from gateway.config.problem import Problem, error
from gateway.config.reading.positions import Positions
from gateway.config.reading.syntax import read_document
from gateway.config.reading.tables import LISTS, TableReader
from gateway.config.schema.config import PROFILE
from gateway.config.schema.profile import ProfileTable
from gateway.profiles import shipped_text

#: The place of a shipped profile.
SHIPPED: Final = "shipped"


@dataclass(frozen=True, slots=True)
class ProfileFile:
    """A file that was read: its table if it has no error, and its problems. `name` is that of the profile."""

    name: str
    file: str
    text: str
    table: ProfileTable | None = None
    problems: tuple[Problem, ...] = ()

    @property
    def is_shipped(self) -> bool:
        """Whether it is one of the gateway's own."""
        return self.file == SHIPPED

    def located(self, problem: Problem) -> Problem:
        """Find the place in the file for a problem of its table."""
        file = f"{self.name}.toml ({SHIPPED})" if self.is_shipped else self.file
        return Positions(self.text).locate(problem, file)


def parse_profile_file(text: str, file: str, *, any_name: bool = False) -> ProfileFile:
    """Parse `text`, the content of `file`. The name of its profile must be that of the file, unless `any_name`."""
    stem = FilePath(file).stem
    read = read_document(text, file, LISTS)
    if isinstance(read, Problem):
        return ProfileFile(stem, file, text, None, (read,))
    document, positions = read
    reader = TableReader(document, positions, file, FilePath(file).parent)
    problems = [*_other_tables(document, stem, any_name=any_name)]
    tables = {} if problems else reader.profiles()
    located = tuple(positions.locate(each, file) for each in problems or reader.problems)
    for name, table in tables.items():
        return ProfileFile(name, file, text, None if located else table, located)
    return ProfileFile(stem, file, text, None, located)


@cache  # the files of this version, of which a config uses some
def shipped_profile(name: str) -> ProfileFile | None:
    """Read a shipped profile; None if there is none of this name."""
    text = shipped_text(name)
    if text is None:
        return None
    table = ProfileTable.model_validate(tomllib.loads(text)[PROFILE][name]).placed((PROFILE, name), SHIPPED)
    for index, point in enumerate(table.points):
        point.placed((PROFILE, name, "points", index), f"the {SHIPPED} profile {name}")
    return ProfileFile(name, SHIPPED, text, table)


def _other_tables(document: Mapping[str, Any], stem: str, *, any_name: bool) -> Iterator[Problem]:
    """Find what is not one profile with the name of the file."""
    profiles = document.get(PROFILE)
    if not isinstance(profiles, dict) or not profiles:
        yield error((), "has no profile", f"write [profile.{stem}] above the keys of this kind of device")
        return
    name, *others = profiles
    for key in document:
        if key != PROFILE:
            yield error((key,), "a file of a profile has nothing but [profile.NAME]", "write it into the config")
    for other in others:
        what = f"is a second profile, beside [profile.{name}]"
        yield error((PROFILE, other), what, f"move it to {other}.toml: a file has one kind of device")
    if not others and name != stem and not any_name:
        what = f'the file is {stem}.toml, and its profile is "{name}"'
        yield error((PROFILE, name), what, f"rename it to {name}.toml, or write [profile.{stem}]")
