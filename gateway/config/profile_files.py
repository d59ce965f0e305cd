"""Profiles out of files: those in `profiles` beside a config, in /etc/modbus-gateway/profiles, and the shipped ones.

The nearer one hides the other, and a table in the config hides both. Only files of profiles that are used are read.
"""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

from gateway.config.machine.file_text import UnreadableFile, read_file_text
from gateway.config.machine.profile_folders import OWN_PROFILES, file_of, folders_of, names_in
from gateway.config.problem import Problem, did_you_mean, either, error, warning
from gateway.config.reading.profile_file import SHIPPED, ProfileFile, parse_profile_file, shipped_profile
from gateway.config.schema.config import PROFILE, Config
from gateway.config.schema.device import Device
from gateway.config.schema.image import Image
from gateway.config.schema.line import Line
from gateway.config.schema.profile import ProfileTable
from gateway.config.schema.upstream import Upstream
from gateway.profiles import is_file_name, shipped_names, shipped_text

#: More names than this are no suggestion.
_MOST_SUGGESTED: Final = 3


@dataclass(frozen=True, slots=True)
class Origin:
    """Where a profile comes from, and what it hides."""

    name: str
    place: str
    hides: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.place}, hides {in_words(self.hides)}" if self.hides else self.place


class Profiled(NamedTuple):
    """A config with the profiles that it uses, and what is wrong with these. Some are missing unless it `is_whole`."""

    config: Config
    problems: tuple[Problem, ...]
    origins: tuple[Origin, ...]
    is_whole: bool


class ProfileFiles:
    """The files of profiles in `folders`, the nearest first, and the shipped ones.

    `found` are those that were read, by the name of the profile, and `problems` those of folders.
    """

    def __init__(self, folders: Iterable[Path] = (OWN_PROFILES,)) -> None:
        self.found: dict[str, ProfileFile] = {}
        self.problems: dict[Path, Problem] = {}
        self._folders = tuple(dict.fromkeys(folders))

    @classmethod
    def of_config(cls, config: str | Path, own: Path = OWN_PROFILES) -> "ProfileFiles":
        """Find those for a config file."""
        return cls(folders_of(Path(config), own))

    def find(self, name: str) -> ProfileFile | None:
        """Read the nearest file of a profile; None if there is none. It may have problems, and no table."""
        if name not in self.found:
            own = next(self._own(name), None)
            file = shipped_profile(name) if own is None else read_profile_file(own, name)
            if file is None:
                return None
            self.found[name] = file
        return self.found[name]

    def places(self, name: str) -> list[str]:
        """List the files of a profile, the nearest first."""
        return [*map(str, self._own(name)), *([SHIPPED] if shipped_text(name) is not None else [])]

    def own_names(self) -> list[str]:
        """List the profiles in the folders."""
        names = {name: None for folder in self._folders for name in self._listed(folder)}
        return sorted(names)

    def names(self) -> list[str]:
        """List all profiles."""
        return sorted({*self.own_names(), *shipped_names()})

    def advise_on(self, name: str, others: Iterable[str] = ()) -> str:
        """Say what to do about a profile that does not exist, beside `others` that are not in files."""
        misnamed = next((file for file in self._own_files() if _has_profile(file, name)), None)
        if misnamed is not None:
            return f"it is in {misnamed}, which must be called {name}.toml"
        names = [*others, *self.names()]
        similar = [each for each in names if name.lower() in each]
        meant = f"did you mean {either(similar)}?" if 0 < len(similar) <= _MOST_SUGGESTED else did_you_mean(name, names)
        return f"{meant if '?' in meant else ''} modbus-gateway profile list shows all".lstrip()

    def _own_files(self) -> Iterator[Path]:
        return (file for name in self.own_names() for file in self._own(name))

    def _own(self, name: str) -> Iterator[Path]:
        for folder in self._folders if is_file_name(name) else ():
            try:
                file = file_of(name, folder)
            except OSError as wrong:
                self._complain(folder, wrong)
                continue
            if file is not None:
                yield file

    def _listed(self, folder: Path) -> list[str]:
        try:
            return names_in(folder)
        except OSError as wrong:
            self._complain(folder, wrong)
            return []

    def _complain(self, folder: Path, wrong: OSError) -> None:
        what = f"profiles in it are not known: {wrong.strerror}"
        self.problems[folder] = warning((), what, f"sudo chmod 755 {folder}").located(str(folder), 0, 0)


def with_profiles(config: Config, files: ProfileFiles, *, is_whole: bool = True) -> Profiled:
    """Add the profiles that a config uses and does not have. Unknown ones are errors if its own profiles are whole."""
    tables = dict(config.profile)
    problems: list[Problem] = []
    for user in _users(config):
        name = user.profile
        if name is None or name in tables:
            continue
        file = files.find(name)
        if file is not None and file.table is not None:
            tables[name] = file.table
        elif file is not None:
            problems += file.problems
        elif is_whole:
            advice = files.advise_on(name, config.profile)
            problems.append(error((*user.path, "profile"), f'there is no profile "{name}"', advice))
    origins = [origin_of(name, table, files) for name, table in tables.items()]
    for each in origins:
        own = [place for place in each.hides if place != SHIPPED]
        if own:
            what = f"hides {in_words(own)}"
            problems.append(warning((PROFILE, each.name), what, "remove one of them, or give one another name"))
    problems += files.problems.values()
    foreign = tuple(each for each in origins if each.place != SHIPPED)
    is_good = all(each.severity == "warning" for each in problems)
    return Profiled(config.model_copy(update={PROFILE: tables}), tuple(problems), foreign, is_good)


def read_profile_file(file: Path, name: str = "") -> ProfileFile:
    """Read the file of a profile; with a `name`, its profile must have that one."""
    try:
        text = read_file_text(file)
    except UnreadableFile as wrong:
        return ProfileFile(name or file.stem, str(file), "", None, (wrong.problem(file),))
    return parse_profile_file(text, str(file), any_name=not name)


def _users(config: Config) -> Iterator[Line | Upstream | Device | Image]:
    for line in config.line:
        yield line
        yield from line.devices or ()
    for upstream in config.upstream:
        yield upstream
        yield from upstream.units or ()
    yield from config.image


def origin_of(name: str, table: ProfileTable, files: ProfileFiles) -> Origin:
    """Find where a profile comes from, and what it hides."""
    places = files.places(name)
    nearest = table.place.rpartition(":")[0]
    is_in_file = table.place == SHIPPED or nearest in places
    return Origin(name, table.place, tuple(places[1:] if is_in_file else places))


def in_words(places: Iterable[str]) -> str:
    """Name the places of hidden profiles."""
    return " and ".join("the shipped one" if each == SHIPPED else each for each in places)


def _has_profile(file: Path, name: str) -> bool:
    """Look for the heading of a profile in a file that is called otherwise."""
    try:
        text = read_file_text(file)
    except UnreadableFile:
        return False
    return re.search(rf"""^\s*\[profile\.["']?{re.escape(name)}["']?\]""", text, re.MULTILINE) is not None
