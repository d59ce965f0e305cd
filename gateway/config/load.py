"""Loads a file into a `Config`, or lists all its errors."""

import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path as FilePath
from typing import Any, Final, TypedDict, Unpack

from gateway.config.check import AddressTrouble, PortTrouble, UnitTrouble, check
from gateway.config.checks.embedding import Embedding, is_about_units
from gateway.config.included import Document, with_included
from gateway.config.machine.file_text import UnreadableFile, find_wrong_text, folder_of, plain_text, read_file_text
from gateway.config.machine.troubles import port_trouble
from gateway.config.plan.reach import without_shared_units
from gateway.config.plan.settings import Plan
from gateway.config.problem import Path, Problem, error, errors_in, warning
from gateway.config.profile_files import Origin, ProfileFiles, read_profile_file, with_profiles
from gateway.config.reading.given_table import TableCopy, Unplaced
from gateway.config.reading.masking import find_masks
from gateway.config.reading.positions import Positions
from gateway.config.reading.profile_file import ProfileFile
from gateway.config.reading.syntax import NESTED, read_document
from gateway.config.reading.tables import LISTS, TableReader
from gateway.config.reading.whole_text import unmarked
from gateway.config.resolve import Planning
from gateway.config.schema.config import INCLUDE, PROFILE, Config

#: How many problems are listed.
_MOST_PROBLEMS: Final = 1000


@dataclass(frozen=True, slots=True)
class Loaded:
    """A loaded file: its config if it has no error, its problems in the order of the file, and its text.

    `profiles` are those of the config that are not shipped; `profile_texts` are the texts of those with a file of their
    own, by name. The text is that of the file, with those that it includes (reading.whole_text), with the line ends of
    Unix, and no byte order mark; `positions` are those in it.
    """

    config: Config | None
    problems: tuple[Problem, ...]
    text: str = ""
    profiles: tuple[Origin, ...] = ()
    profile_texts: Mapping[str, str] = field(default_factory=dict)
    planning: Planning | None = None
    positions: Positions | None = None

    @property
    def plan(self) -> Plan | None:
        """The settings of all parts; None if there is an error."""
        return None if self.config is None or self.planning is None else self.planning.plan

    @property
    def errors(self) -> tuple[str, ...]:
        """Say as text why there is no config."""
        return errors_in(self.problems)


_NO_CONFIG_YET: Final = "create it, or name another file; `modbus-gateway` alone prints one to begin with"


class Troubles(TypedDict, total=False):
    """How `check` looks at what a config names, if not as usual: at ports of this machine, and at nothing else."""

    port_trouble: PortTrouble
    real_path: Callable[[str], str]
    address_trouble: AddressTrouble
    unit_trouble: UnitTrouble


def load(path: str | FilePath, embedding: Embedding | None = None, **troubles: Unpack[Troubles]) -> Loaded:
    """Load the file at `path`. Nothing is raised: a file that cannot be read is a problem too."""
    file = str(path)
    try:
        text = unmarked(read_file_text(FilePath(path)))
    except UnreadableFile as wrong:
        remedy = wrong.remedy if FilePath(path).exists() else _NO_CONFIG_YET
        return Loaded(None, (wrong.problem(file, remedy),))
    loaded = parse(text, file, follow=True, embedding=embedding, **troubles)
    return loaded if loaded.text else replace(loaded, text=text)


def load_text(text: str, at: FilePath, embedding: Embedding, **troubles: Unpack[Troubles]) -> Loaded:
    """Load a text as a file there would be; the name stands for it in messages. Nothing is raised."""
    text = unmarked(plain_text(text))
    wrong = find_wrong_text(text)
    if wrong:
        return Loaded(None, (error((), wrong).located(at.name, 0, 0),))
    return replace(parse(text, at.name, at=at, embedding=embedding, **troubles), text=text)


def load_table(table: Mapping[str, Any], at: FilePath, embedding: Embedding, **troubles: Unpack[Troubles]) -> Loaded:
    """Load a table that a program has made; otherwise as `load_text`. It has no text."""
    try:
        copy = TableCopy(table)
        if copy.problems:
            return Loaded(None, tuple(each.located(at.name, 0, 0) for each in copy.problems[:_MOST_PROBLEMS]))
        places = _Places(Unplaced(copy.table), at.name, copy.table, ProfileFiles.of_config(at))
        return _parsed(places, at, embedding, troubles)
    except RecursionError:
        return Loaded(None, (NESTED.located(at.name, 0, 0),))


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
    problems = tuple(file.located(each) for each in check(Planning(alone)) if each.path[:1] == (PROFILE,))
    return replace(file, table=None if errors_in(problems) else file.table, problems=problems)


def parse(
    text: str,
    file: str = "gateway.toml",
    *,
    follow: bool = False,
    profile_files: ProfileFiles | None = None,
    at: FilePath | None = None,
    embedding: Embedding | None = None,
    **troubles: Unpack[Troubles],
) -> Loaded:
    """Parse `text`, the content of `file`.

    With `follow`, the files that it includes are read too. `at` is the path that says what relative ones mean, if it
    is another than `file`.
    """
    read = read_document(text, file, LISTS)
    if isinstance(read, Problem):
        return Loaded(None, (read,))
    whole, at = Document(text, *read), at or FilePath(file)
    notes: tuple[Problem, ...] = ()
    if follow and INCLUDE in whole.tables:
        whole, notes = with_included(whole, file)
        if errors_in(notes):
            return Loaded(None, notes, text)
    places = _Places(whole.positions, file, whole.tables, profile_files or ProfileFiles.of_config(at))
    try:
        loaded = _parsed(places, at, embedding or Embedding(), troubles)
        problems = tuple(_most_important([*notes, *loaded.problems], file)) if notes else loaded.problems
        return replace(loaded, problems=problems, text=whole.text)
    except RecursionError:  # a key of a thousand parts
        return Loaded(None, (NESTED.located(file, 1, 1),))


def _parsed(places: "_Places", at: FilePath, embedding: Embedding, troubles: Troubles) -> Loaded:
    document, files, folder = places.document, places.files, folder_of(at)
    reader = TableReader(document, places.positions, at.name, folder)
    own = embedding.added_to(reader.config())
    profiled = with_profiles(own.config, files, is_whole=PROFILE not in reader.failed)
    config = without_shared_units(profiled.config)
    found = [*reader.problems, *own.problems, *profiled.problems, *_check_masks(document)]
    failed = frozenset(reader.failed if profiled.is_whole else {*reader.failed, PROFILE})
    planning = Planning(config)
    looked_at: Troubles = {"port_trouble": port_trouble, "real_path": os.path.realpath, **troubles}
    found += check(planning, failed, **looked_at)
    found += embedding.check(config)
    problems = [places.locate(one) for one in dict.fromkeys(found)]
    has_error = any(one.severity == "error" for one in problems)
    kept = tuple(_most_important(problems, places.file))
    texts = {each.name: each.text for each in files.found.values() if not each.is_shipped}
    return Loaded(
        None if has_error else config,
        kept,
        profiles=profiled.origins,
        profile_texts=texts,
        planning=planning,
        positions=places.positions if isinstance(places.positions, Positions) else None,
    )


def _check_masks(document: dict[str, Any]) -> Iterator[Problem]:
    """Find masks, which a text has that was copied from the page."""
    for path in find_masks(document):
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

    positions: Positions | Unplaced
    file: str
    document: dict[str, Any]
    files: ProfileFiles

    def locate(self, problem: Problem) -> Problem:
        if problem.file:
            return problem
        if is_about_units(problem.path):
            return replace(problem, path=problem.path[:2]).located(self.file, 0, 0)
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
