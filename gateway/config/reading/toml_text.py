"""Writes config files as text: tables with their keys, and comments that say why."""

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

#: What stands in a file for a value: text, a number, a truth value, and lists and tables of them.
Value = str | int | float | bool | list["Value"] | dict[str, "Value"]


class Row(NamedTuple):
    """A table in a list, and a comment behind it; without a table, a comment in its place."""

    table: Mapping[str, Value] | None
    comment: str = ""


class Rows(NamedTuple):
    """A list of tables, each on a line of its own."""

    rows: tuple[Row, ...]


@dataclass(frozen=True, slots=True)
class TableText:
    """A table of a file. `heading` is written as it is; comments stand above it."""

    heading: str
    keys: Mapping[str, Value | Rows] = field(default_factory=dict)
    comments: tuple[str, ...] = ()

    def __str__(self) -> str:
        """Write the table as it stands in a file."""
        width = max(map(len, self.keys), default=0)
        keys = [f"{key.ljust(width)} = {_text(value)}" for key, value in self.keys.items()]
        return "\n".join([*map(comment, self.comments), *([self.heading] if self.heading else []), *keys])


def file_text(tables: Iterable[TableText]) -> str:
    """Write a file with these tables."""
    return "\n\n".join(map(str, tables)) + "\n"


def comment(text: str) -> str:
    """Write a comment of one line, whatever is in it."""
    return "# " + "".join(letter if letter.isprintable() else "?" for letter in text)


def value_text(value: Value) -> str:
    """Write a value as TOML has it."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {value_text(each)}" for key, each in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(value_text, value)) + "]"
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def _text(value: Value | Rows) -> str:
    if isinstance(value, Rows):
        return "\n".join(["[", *(f"  {_row_text(row)}" for row in value.rows), "]"])
    return value_text(value)


def _row_text(row: Row) -> str:
    if row.table is None:
        return comment(row.comment)
    return f"{value_text(dict(row.table))},{f'  {comment(row.comment)}' if row.comment else ''}"
