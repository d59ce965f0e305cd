"""A config that a program has made as a table. It has no text: problems name a key, and neither line nor column."""

from collections.abc import Iterable, Mapping
from datetime import date, datetime, time
from pathlib import PurePath
from typing import Any, Final

from gateway.config.problem import Path, Problem, dotted, error
from gateway.config.reading.toml_text import value_text

#: What TOML calls an integer.
_INTEGERS: Final = range(-(2**63), 2**63)


class Unplaced:
    """The places of keys and values that stand in no text; `table` has them. See Positions."""

    def __init__(self, table: Mapping[str, Any]) -> None:
        self._table = table

    def place(self, path: Path, _file: str, _keys: Iterable[str]) -> str:
        """Name the table at `path`, such as `line[0]`."""
        return dotted(path)

    def written(self, path: Path) -> str:
        """Write the number, date or word at `path` as TOML has it."""
        value: Any = self._table
        for part in path:
            value = value[part]
        if isinstance(value, list | dict):
            return ""
        return value.isoformat() if isinstance(value, date | time) else value_text(value)

    def part(self, _path: Path) -> None:
        """Find no file."""

    def locate(self, problem: Problem, file: str, name: str = "") -> Problem:
        """Give a problem the name of its table, and of `file`, which stands for the program's table."""
        return problem.located(file, 0, 0, name)


class TableCopy:
    """A copy of a table in the types that `tomllib` makes; tuples and paths may be there too. `problems` has others.

    Raises:
        RecursionError: it is nested too deeply, or contains itself.
    """

    def __init__(self, table: Mapping[str, Any]) -> None:
        self.problems: list[Problem] = []
        self.table: dict[str, Any] = self._copied(table, ())

    def _copied(self, value: Any, path: Path) -> Any:
        match value:
            case Mapping():
                pairs = ((self._key(key, path), each) for key, each in value.items())
                copy: Any = {key: self._copied(each, (*path, key)) for key, each in pairs}
            case list() | tuple():
                copy = [self._copied(each, (*path, index)) for index, each in enumerate(value)]
            case str():
                copy = self._text(str.__str__(value), path)  # an enumeration's own says something else
            case PurePath():
                copy = self._text(str(value), path)
            case bool() | float() | datetime() | date() | time():
                copy = value
            case int():
                copy = self._integer(int(value), path)
            case _:
                copy = self._note_wrong(value, path)
        return copy

    def _note_wrong(self, value: object, path: Path) -> object:
        remedy = "leave the key out" if value is None else "write a dict, a list, text, a number, True or False"
        self.problems.append(error(path, f"cannot be {_in_words(value)}", remedy))
        return None

    def _key(self, key: object, path: Path) -> str:
        if isinstance(key, str):
            return self._text(str.__str__(key), path)
        self.problems.append(error(path, f"has a key that is no text: {str(key)[:40]!r}"))
        return str(key)

    def _text(self, text: str, path: Path) -> str:
        try:
            text.encode()
        except UnicodeEncodeError:
            self.problems.append(error(path, "is not UTF-8 text"))
        return text

    def _integer(self, number: int, path: Path) -> int:
        if number not in _INTEGERS:
            self.problems.append(error(path, "is a number of more than 64 bits"))
        return number


def _in_words(value: object) -> str:
    return "None" if value is None else f"of the type {type(value).__name__}"
