"""Loads a file into a `Config`, or lists all its errors."""

import os
import tomllib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path as FilePath
from typing import Any, Final

from gateway.config.check import AddressTrouble, PortTrouble, UnitTrouble, check
from gateway.config.machine.file_text import UnreadableFile, folder_of, read_file_text
from gateway.config.machine.paths import check_paths
from gateway.config.machine.port_trouble import port_trouble
from gateway.config.plan.shared_units import without_shared_units
from gateway.config.problem import Path, Problem, error, errors_in, warning
from gateway.config.profile_files import Origin, ProfileFiles, read_profile_file, with_profiles
from gateway.config.reading.masking import MASK, find_masks
from gateway.config.reading.positions import Positions
from gateway.config.reading.profile_file import ProfileFile
from gateway.config.reading.syntax import syntax_problem
from gateway.config.reading.tables import LISTS, TableReader
from gateway.config.schema.config import PROFILE, Config

#: How many problems are listed.
_MOST_PROBLEMS: Final = 1000


@dataclass(frozen=True, slots=True)
class Loaded:
    """A loaded file: its config if it has no error, its problems in the order of the file, and its text.

    `profiles` are those of the config that are not shipped; `profile_texts` are the texts of those with a file of their
    own, by name. The text has the line ends of Unix, and no byte order mark.
    """

    config: Config | None
    problems: tuple[Problem, ...]
    text: str = ""
    profiles: tuple[Origin, ...] = ()
    profile_texts: Mapping[str, str] = field(default_factory=dict)

    @property
    def errors(self) -> tuple[str, ...]:
        """Say as text why there is no config."""
        return errors_in(self.problems)


_NO_CONFIG_YET: Final = "create it, or name another file; `modbus-gateway` alone prints one to begin with"


def load(
    path: str | FilePath,
    address_trouble: AddressTrouble = lambda _: None,
    unit_trouble: UnitTrouble = lambda _: None,
) -> Loaded:
    """Load the file at `path`. Nothing is raised: a file that cannot be read is a problem too.

    `address_trouble` checks addresses of listeners, and `unit_trouble` the classes of units made in Python; by default
    neither are checked.
    """
    file = str(path)
    try:
        text = read_file_text(FilePath(path))
    except UnreadableFile as wrong:
        remedy = wrong.remedy if FilePath(path).exists() else _NO_CONFIG_YET
        return _fail(error((), str(wrong), remedy), file, wrong.line, min(wrong.line, 1))
    return replace(parse(text, file, address_trouble=address_trouble, unit_trouble=unit_trouble), text=text)


def load_profile(path: FilePath, name: str = "") -> ProfileFile:
    """Load the file of a profile by itself, and check it as in a config; with a `name` it must have that one."""
    return _checked(read_profile_file(path, name))


def find_profile(files: ProfileFiles, name: str) -> ProfileFile | None:
    """Find the nearest file of a profile, and check it as in a config; None if there is none."""
    file = files.find(name)
    return None if file is None else _checked(file)


def _checked(file: ProfileFile) -> ProfileFile:
    """Check a profile by itself. With errors it has no table."""
    if file.table is None or file.is_shipped:
        return file
    alone = Config.model_validate({PROFILE: {file.name: file.table}})
    problems = tuple(file.located(each) for each in check(alone) if each.path[:1] == (PROFILE,))
    return replace(file, table=None if errors_in(problems) else file.table, problems=problems)


def parse(
    text: str,
    file: str = "gateway.toml",
    port_trouble: PortTrouble = port_trouble,
    real_path: Callable[[str], str] = os.path.realpath,
    address_trouble: AddressTrouble = lambda _: None,
    exists: Callable[[str], bool] = os.path.exists,
    profile_files: ProfileFiles | None = None,
    unit_trouble: UnitTrouble = lambda _: None,
) -> Loaded:
    """Parse `text`, the content of `file`. `exists` looks for the files that it names."""
    try:
        document = tomllib.loads(text)
        positions = Positions(text)
    except ValueError as wrong:  # mostly a TOMLDecodeError; a number of 5000 digits is not
        problem = syntax_problem(wrong, text, LISTS)
        return _fail(problem, file, problem.line, problem.column)
    except RecursionError:
        return _fail_nested(file)
    files = profile_files or ProfileFiles.of_config(file)
    try:
        troubles = partial(
            check,
            port_trouble=port_trouble,
            real_path=real_path,
            address_trouble=address_trouble,
            unit_trouble=unit_trouble,
        )
        return _parsed(document, positions, text, file, exists, files, troubles)
    except RecursionError:  # a key of a thousand parts
        return _fail_nested(file)


def _parsed(
    document: dict[str, Any],
    positions: Positions,
    text: str,
    file: str,
    exists: Callable[[str], bool],
    files: ProfileFiles,
    troubles: Callable[[Config, frozenset[str]], Iterator[Problem]],
) -> Loaded:
    folder = folder_of(FilePath(file))
    reader = TableReader(document, positions, FilePath(file).name, folder)
    profiled = with_profiles(reader.config(), files, is_whole=PROFILE not in reader.failed)
    config = without_shared_units(profiled.config)
    found = [
        *reader.problems,
        *profiled.problems,
        *check_paths(document, folder, exists),
        *_check_masks(document, text),
    ]
    failed = frozenset(reader.failed if profiled.is_whole else {*reader.failed, PROFILE})
    found += troubles(config, failed)
    places = _Places(positions, file, document, files)
    problems = [places.locate(one) for one in dict.fromkeys(found)]
    has_error = any(one.severity == "error" for one in problems)
    kept = tuple(_most_important(problems, file))
    own = {each.name: each.text for each in files.found.values() if not each.is_shipped}
    return Loaded(None if has_error else config, kept, profiles=profiled.origins, profile_texts=own)


def _check_masks(document: dict[str, Any], text: str) -> Iterator[Problem]:
    """Find masks, which a text has that was copied from the page."""
    for path in find_masks(document) if MASK in text else ():
        yield error(path, "this is the mask, which the page shows in place of the value", "write the value itself")


def _most_important(problems: list[Problem], file: str) -> list[Problem]:
    """Keep at most _MOST_PROBLEMS of these, errors before warnings, in the order of the file."""
    kept = sorted(problems, key=lambda one: one.severity != "error")[:_MOST_PROBLEMS]
    kept.sort(key=lambda one: (one.file != file, one.file, one.line, one.column))
    left_out = len(problems) - len(kept)
    return [*kept, warning((), f"{left_out} more problems are not listed").located(file, 0, 0)] if left_out else kept


@dataclass(frozen=True, slots=True)
class _Places:
    """Where problems are: in the config, which has `document`, or in the file of a profile."""

    positions: Positions
    file: str
    document: dict[str, Any]
    files: ProfileFiles

    def locate(self, problem: Problem) -> Problem:
        if problem.file:
            return problem
        section, name = (*problem.path, "", "")[:2]
        other = self.files.found.get(str(name)) if section == PROFILE else None
        if other is not None and name not in self.document.get(PROFILE, {}):
            return other.located(problem)
        return self.positions.locate(problem, self.file, _name(problem.path, self.document))


def _name(path: Path, document: dict[str, Any]) -> str:
    """Find the name of the table at the beginning of `path`, if it is one of several."""
    if len(path) < 2 or not isinstance(path[1], int):
        return ""
    row = document[str(path[0])][path[1]]
    name = row.get("name") if isinstance(row, dict) else None
    return name if isinstance(name, str) else ""


def _fail_nested(file: str) -> Loaded:
    return _fail(error((), "is nested too deeply"), file)


def _fail(problem: Problem, file: str, line: int = 1, column: int = 1) -> Loaded:
    return Loaded(None, (problem.located(file, line, column),))
