"""Loads a file into a `Config`, or lists all its errors."""

import os
import tomllib
from collections.abc import Callable, Iterator, Mapping
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path as FilePath
from typing import Any, Final

from pydantic import ValidationError

from gateway.config.checks.everything import AddressTrouble, PortTrouble, check
from gateway.config.checks.paths import check_paths
from gateway.config.checks.port_trouble import port_trouble
from gateway.config.problem import Path, Problem, error, errors_in, warning
from gateway.config.reading.file_text import UnreadableFile, folder_of, read_file_text
from gateway.config.reading.positions import Positions
from gateway.config.reading.source import Source
from gateway.config.reading.syntax import syntax_problem
from gateway.config.reading.wording import keys_of, not_text, unknown_key, value_problems
from gateway.config.schema.fleet import Fleet
from gateway.config.schema.mqtt import Mqtt
from gateway.config.schema.profile import ProfileTable
from gateway.config.schema.root import Access, Config, Control, Image, Line, Listen, Log, Own, Trace, Upstream
from gateway.config.schema.table import Table
from gateway.config.schema.web import Web
from gateway.profiles import BUILTIN_PROFILES, builtin_text

#: Sections that are written [[name]], [name], and [name.name].
_LISTS: Final[Mapping[str, type[Table]]] = {
    "listen": Listen,
    "line": Line,
    "image": Image,
    "upstream": Upstream,
    "access": Access,
}
_SINGLES: Final[Mapping[str, type[Table]]] = {
    "self": Own,
    "web": Web,
    "mqtt": Mqtt,
    "fleet": Fleet,
    "trace": Trace,
    "control": Control,
    "log": Log,
}
_PROFILE: Final = "profile"

#: How many problems are listed: nobody reads more.
_MOST_PROBLEMS: Final = 1000

#: Keys that no other table refers to. A table with errors only in these is still checked against the others.
_NOT_REFERRED_TO: Final = frozenset(
    {
        *("baud", "format", "rs485", "echo", "latency", "timeout", "gap", "turnaround", "late_window", "queue"),
        *("max_wait", "retries", "retry_within", "rest", "wire", "coalesce", "broadcast", "priority"),
        *("clients", "idle", "in_flight", "on_failure"),
    }
)


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
        """Why there is no config, as text."""
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
        problem = syntax_problem(wrong, text, _LISTS)
        return _fail(problem, file, problem.line, problem.column)
    except RecursionError:
        return _fail(error((), "is nested too deeply"), file)
    reader = _Reader(document, positions, FilePath(file))
    config = reader.config()
    found = [*reader.problems, *check_paths(document, reader.folder, exists)]
    found += check(config, frozenset(reader.failed), port_trouble, real_path, address_trouble)
    problems = [_locate(one, positions, file, document) for one in dict.fromkeys(found)]
    has_error = any(one.severity == "error" for one in problems)
    return Loaded(None if has_error else config, tuple(_most_important(problems, file)))


def _most_important(problems: list[Problem], file: str) -> list[Problem]:
    """At most _MOST_PROBLEMS of these, errors before warnings, in the order of the file."""
    kept = sorted(problems, key=lambda one: one.severity != "error")[:_MOST_PROBLEMS]
    kept.sort(key=lambda one: (one.line, one.column))
    left_out = len(problems) - len(kept)
    return [*kept, warning((), f"{left_out} more problems are not listed").located(file, 0, 0)] if left_out else kept


@lru_cache(maxsize=1)
def builtin_profiles() -> Mapping[str, ProfileTable]:
    """The built-in profiles by name."""
    return {
        name: ProfileTable.model_validate(tomllib.loads(builtin_text(name))[_PROFILE][name]).placed(
            (_PROFILE, name), "built in"
        )
        for name in BUILTIN_PROFILES
    }


class _Reader:
    """Turns a TOML document into tables, each on its own, so that one broken table hides no other's problems.

    `failed` are the sections of which a table is missing from the config because something is wrong with it. `folder`
    is where the file stands.
    """

    def __init__(self, document: dict[str, Any], positions: Positions, file: FilePath) -> None:
        self.problems: list[Problem] = []
        self.failed: set[str] = set()
        self._document = document
        self._positions = positions
        self._file = file.name
        self.folder = folder_of(file)

    def config(self) -> Config:
        """The config made of every table that is good."""
        self._find_unknown_sections()
        lists = {section: tuple(self._rows(section, model)) for section, model in _LISTS.items()}
        singles = {section: self._single(section, model) for section, model in _SINGLES.items()}
        present = {section: table for section, table in singles.items() if table is not None}
        profiles = {**builtin_profiles(), **self._profiles()}
        return Config.model_validate({"site": self._site(), _PROFILE: profiles, **lists, **present})

    def _find_unknown_sections(self) -> None:
        known = keys_of(Config)
        unknown = [key for key in self._document if key not in known]
        self.failed.update(unknown)
        self.problems += [unknown_key((key,), known) for key in unknown]

    def _site(self) -> str:
        site = self._document.get("site", "")
        if isinstance(site, str):
            return site
        self.failed.add("site")
        self.problems.append(not_text(("site",), site, self._positions.written))
        return ""

    def _rows(self, section: str, model: type[Table]) -> Iterator[Table]:
        rows = self._document.get(section, [])
        if not isinstance(rows, list):
            self._complain((section,), "is a list of tables", f"write [[{section}]] with two brackets")
            return
        for index, raw in enumerate(rows):
            table = self._table((section, index), raw, model)
            if table is not None:
                yield table

    def _single(self, section: str, model: type[Table]) -> Table | None:
        raw = self._document.get(section)
        if raw is None:
            return None
        if isinstance(raw, list):
            self._complain((section,), "is one table, not a list", f"write [{section}] with one bracket")
            return None
        return self._table((section,), raw, model)

    def _profiles(self) -> dict[str, Table]:
        profiles = self._document.get(_PROFILE, {})
        if not isinstance(profiles, dict):
            self._complain((_PROFILE,), "is a table of tables", f"write [{_PROFILE}.NAME]")
            return {}
        tables = {name: self._table((_PROFILE, name), raw, ProfileTable) for name, raw in profiles.items()}
        return {name: table for name, table in tables.items() if table is not None}

    def _table(self, path: Path, raw: object, model: type[Table]) -> Table | None:
        try:
            table = model.model_validate(raw, context=self.folder)
        except ValidationError as wrong:
            self.failed.add(str(path[0]))
            self.problems += value_problems(wrong, model, path, self._positions.written)
            rest = _without(wrong, raw)
            if rest is None:
                return None
            table = model.model_validate(rest, context=self.folder)
        self._place(table, path)
        return table

    def _place(self, table: Table, path: Path) -> None:
        """Set the place of a table and of those inside it."""
        line, _ = self._positions.value(path)
        keys = [type(table).model_fields[name].alias or name for name in table.model_fields_set]
        lines = {key: self._positions.key((*path, key))[0] for key in keys}
        table.placed(path, Source.of(self._file, line, lines))
        for name, field in type(table).model_fields.items():
            value = getattr(table, name)
            key = field.alias or name
            if isinstance(value, Table):
                self._place(value, (*path, key))
            elif isinstance(value, tuple):
                for index, row in enumerate(value):
                    if isinstance(row, Table):
                        self._place(row, (*path, key, index))

    def _complain(self, path: Path, what: str, remedy: str) -> None:
        self.failed.add(str(path[0]))
        self.problems.append(error(path, what, remedy))


def _without(wrong: ValidationError, raw: object) -> dict[str, Any] | None:
    """The table without its wrong values, if no other table refers to these."""
    found = wrong.errors(include_url=False)
    if not isinstance(raw, dict) or any(one["loc"][-1:] and one["loc"][-1] not in _NOT_REFERRED_TO for one in found):
        return None
    rest = deepcopy(raw)
    for one in found:
        *parents, last = one["loc"]
        table = rest
        for part in parents:
            table = table[part]
        table.pop(last, None)
    return rest


def _locate(problem: Problem, positions: Positions, file: str, document: dict[str, Any]) -> Problem:
    place = positions.key(problem.path) if problem.on_key else positions.value(problem.path)
    return problem.located(file, *place, _name(problem.path, document))


def _name(path: Path, document: dict[str, Any]) -> str:
    """The name of the table at the beginning of `path`, if it is one of several."""
    if len(path) < 2 or not isinstance(path[1], int):
        return ""
    row = document[str(path[0])][path[1]]
    name = row.get("name") if isinstance(row, dict) else None
    return name if isinstance(name, str) else ""


def _fail(problem: Problem, file: str, line: int = 1, column: int = 1) -> Loaded:
    return Loaded(None, (problem.located(file, line, column),))
