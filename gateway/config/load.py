"""Loads a file into a `Config`, or lists all its errors."""

import os
import tomllib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path as FilePath
from typing import Any, Final

from gateway.config.check import AddressTrouble, PortTrouble, check
from gateway.config.machine.file_text import UnreadableFile, folder_of, read_file_text
from gateway.config.machine.paths import check_paths
from gateway.config.machine.port_trouble import port_trouble
from gateway.config.plan.shared_units import without_shared_units
from gateway.config.problem import Path, Problem, error, errors_in, warning
from gateway.config.reading.positions import Positions
from gateway.config.reading.syntax import syntax_problem
from gateway.config.reading.tables import LISTS, TableReader
from gateway.config.schema.config import Config

#: How many problems are listed.
_MOST_PROBLEMS: Final = 1000


@dataclass(frozen=True, slots=True)
class Loaded:
    """A loaded file: its config if it has no error, its problems in the order of the file, and its text.

    The text has the line ends of Unix, and no byte order mark.
    """

    config: Config | None
    problems: tuple[Problem, ...]
    text: str = ""

    @property
    def errors(self) -> tuple[str, ...]:
        """Say as text why there is no config."""
        return errors_in(self.problems)


def load(path: str | FilePath, address_trouble: AddressTrouble = lambda _: None) -> Loaded:
    """Load the file at `path`. Nothing is raised: a file that cannot be read is a problem too.

    `address_trouble` checks addresses of listeners; by default they are not checked.
    """
    file = str(path)
    try:
        text = read_file_text(FilePath(path))
    except UnreadableFile as wrong:
        return _fail(error((), str(wrong), wrong.remedy), file, wrong.line, min(wrong.line, 1))
    return replace(parse(text, file, address_trouble=address_trouble), text=text)


def parse(
    text: str,
    file: str = "gateway.toml",
    port_trouble: PortTrouble = port_trouble,
    real_path: Callable[[str], str] = os.path.realpath,
    address_trouble: AddressTrouble = lambda _: None,
    exists: Callable[[str], bool] = os.path.exists,
) -> Loaded:
    """Parse `text`, the content of `file`. `exists` looks for the files that it names."""
    try:
        document = tomllib.loads(text)
        positions = Positions(text)
    except ValueError as wrong:  # mostly a TOMLDecodeError; a number of 5000 digits is not
        problem = syntax_problem(wrong, text, LISTS)
        return _fail(problem, file, problem.line, problem.column)
    except RecursionError:
        return _fail(error((), "is nested too deeply"), file)
    folder = folder_of(FilePath(file))
    reader = TableReader(document, positions, FilePath(file).name, folder)
    config = without_shared_units(reader.config())
    found = [*reader.problems, *check_paths(document, folder, exists)]
    found += check(config, frozenset(reader.failed), port_trouble, real_path, address_trouble)
    problems = [_locate(one, positions, file, document) for one in dict.fromkeys(found)]
    has_error = any(one.severity == "error" for one in problems)
    return Loaded(None if has_error else config, tuple(_most_important(problems, file)))


def _most_important(problems: list[Problem], file: str) -> list[Problem]:
    """Keep at most _MOST_PROBLEMS of these, errors before warnings, in the order of the file."""
    kept = sorted(problems, key=lambda one: one.severity != "error")[:_MOST_PROBLEMS]
    kept.sort(key=lambda one: (one.line, one.column))
    left_out = len(problems) - len(kept)
    return [*kept, warning((), f"{left_out} more problems are not listed").located(file, 0, 0)] if left_out else kept


def _locate(problem: Problem, positions: Positions, file: str, document: dict[str, Any]) -> Problem:
    place = positions.key(problem.path) if problem.on_key else positions.value(problem.path)
    return problem.located(file, *place, _name(problem.path, document))


def _name(path: Path, document: dict[str, Any]) -> str:
    """Find the name of the table at the beginning of `path`, if it is one of several."""
    if len(path) < 2 or not isinstance(path[1], int):
        return ""
    row = document[str(path[0])][path[1]]
    name = row.get("name") if isinstance(row, dict) else None
    return name if isinstance(name, str) else ""


def _fail(problem: Problem, file: str, line: int = 1, column: int = 1) -> Loaded:
    return Loaded(None, (problem.located(file, line, column),))
