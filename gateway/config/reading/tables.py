"""Turns a TOML document into the tables of a config. Listeners for another site get the upstream to it."""

from collections.abc import Iterator, Mapping
from copy import deepcopy
from functools import cache
from pathlib import Path as FilePath
from typing import Any, Final, TypeVar, get_origin

from pydantic import ValidationError

from gateway.config.problem import Path, Problem, WrongValue, error
from gateway.config.reading.given_table import Unplaced
from gateway.config.reading.positions import Positions
from gateway.config.reading.wording import not_text, unknown_key, value_problems
from gateway.config.schema.config import INCLUDE, PROFILE, Config
from gateway.config.schema.listen import Listen
from gateway.config.schema.profile import ProfileTable
from gateway.config.schema.table import Table, keys_of, row_model
from gateway.config.schema.upstream import Upstream
from gateway.config.values.files import parse_include
from gateway.config.values.site import Site


def _sections(origin: type | None) -> Mapping[str, type[Table]]:
    """Find the sections of this kind in the schema, each with its table."""
    fields = ((field.alias or name, field.annotation) for name, field in Config.model_fields.items())
    of_kind = ((key, row_model(each)) for key, each in fields if (get_origin(each) is tuple) == (origin is tuple))
    return {key: model for key, model in of_kind if model is not None and key != PROFILE}


#: Sections that are written [[name]], and those that are written [name].
LISTS: Final = _sections(tuple)
_SINGLES: Final = _sections(None)

#: Keys that no other table refers to. A table with errors only in these is still checked against the others.
_NOT_REFERRED_TO: Final = frozenset(
    {
        *(
            "baud",
            "format",
            "rs485",
            "rs485_delay",
            "echo",
            "latency",
            "timeout",
            "gap",
            "turnaround",
            "late_window",
            "queue",
        ),
        *("max_wait", "retries", "retry_within", "rest", "wire", "coalesce", "broadcast", "priority"),
        *("clients", "idle", "in_flight", "on_failure"),
    }
)


_Table = TypeVar("_Table", bound=Table)


class TableReader:
    """Turns a TOML document into tables, each on its own, so that one broken table hides no other's problems.

    `failed` are the sections of which a table is missing from the config because something is wrong with it. Paths
    count from the `folder` in which `file` stands.
    """

    def __init__(self, document: dict[str, Any], positions: Positions | Unplaced, file: str, folder: FilePath) -> None:
        self.problems: list[Problem] = []
        self.failed: set[str] = set()
        self._document = document
        self._positions = positions
        self._file = file
        self._folder = folder

    def config(self) -> Config:
        """Make the config of every table that is good, with the profiles that are in it."""
        self._find_unknown_sections()
        lists = {section: tuple(self._rows(section, LISTS[section])) for section in LISTS if section in self._document}
        singles = {section: self._single(section, model) for section, model in _SINGLES.items()}
        present = {section: table for section, table in singles.items() if table is not None}
        own = {"site": self._site(), INCLUDE: self._include(), PROFILE: self.profiles()}
        return with_sites(Config.model_validate({**own, **lists, **present}))

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

    def _include(self) -> list[str]:
        include = self._document.get(INCLUDE, [])
        try:
            parse_include(include)
        except WrongValue as wrong:
            self._complain((INCLUDE,), str(wrong), wrong.remedy)
            return []
        return list(include)

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

    def profiles(self) -> dict[str, ProfileTable]:
        """Make the tables of the profiles that are good."""
        profiles = self._document.get(PROFILE, {})
        if not isinstance(profiles, dict):
            self._complain((PROFILE,), "is a table of tables", f"write [{PROFILE}.NAME]")
            return {}
        tables = {name: self._table((PROFILE, name), raw, ProfileTable) for name, raw in profiles.items()}
        return {name: table for name, table in tables.items() if table is not None}

    def _table(self, path: Path, raw: object, model: type[_Table]) -> _Table | None:
        part = self._positions.part(path)
        folder = self._folder if part is None else part.folder
        try:
            table = model.model_validate(raw, context=folder)
        except ValidationError as wrong:
            self.failed.add(str(path[0]))
            self.problems += value_problems(wrong, model, path, self._positions.written)
            rest = _without(wrong, raw)
            if rest is None:
                return None
            table = model.model_validate(rest, context=folder)
        self._place(table, path)
        return table

    def _place(self, table: Table, path: Path) -> None:
        """Set the place of a table and of those inside it."""
        keys, inner = _layout(type(table))
        table.placed(path, self._positions.place(path, self._file, map(keys.__getitem__, table.model_fields_set)))
        for name in inner:
            value, key = getattr(table, name), keys[name]
            if isinstance(value, Table):
                self._place(value, (*path, key))
            elif isinstance(value, tuple):
                for index, row in enumerate(value):
                    if isinstance(row, Table):
                        self._place(row, (*path, key, index))

    def _complain(self, path: Path, what: str, remedy: str) -> None:
        self.failed.add(str(path[0]))
        self.problems.append(error(path, what, remedy))


@cache
def _layout(model: type[Table]) -> tuple[Mapping[str, str], tuple[str, ...]]:
    """Find how the user writes each field of a table, and which of them have tables."""
    fields = model.model_fields
    inner = tuple(name for name, field in fields.items() if row_model(field.annotation) is not None)
    return {name: field.alias or name for name, field in fields.items()}, inner


def _without(wrong: ValidationError, raw: object) -> dict[str, Any] | None:
    """Remove wrong values from a table, if no other table refers to these; None otherwise."""
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


def with_sites(config: Config) -> Config:
    """Make listeners for a site listeners for the upstream to it, which is added if the file does not have it."""
    if not config.listen:
        return config
    upstreams = list(config.upstream)
    listeners = tuple(_for_upstream(listen, upstreams) for listen in config.listen)
    return config.model_copy(update={"listen": listeners, "upstream": tuple(upstreams)})


def _for_upstream(listen: Listen, upstreams: list[Upstream]) -> Listen:
    if listen.site is None or listen.line is not None or listen.upstream is not None:
        return listen
    site = Site(listen.site)
    there = next((upstream for upstream in upstreams if site in upstream.to), None)
    if there is None:
        there = Upstream.model_validate({"to": str(site)}).placed(listen.path, listen.place)
        upstreams.append(there)
    return listen.model_copy(update={"site": None, "upstream": there.label})
