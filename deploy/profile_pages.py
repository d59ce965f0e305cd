"""Writes a page for each shipped profile, and their list: `python -m deploy.profile_pages`."""

from collections.abc import Iterator
from itertools import takewhile
from pathlib import Path
from typing import Final

from gateway.config.documents.points import identity_text, point_rows
from gateway.config.plan.points import ranges_in
from gateway.config.reading.profile_file import shipped_profile
from gateway.config.schema.profile import ProfileTable
from gateway.config.values.duration import show_duration
from gateway.config.values.ranges import show_ranges
from gateway.modbus.codes import Area
from gateway.profiles import shipped_names

#: Where the pages of this checkout are.
FOLDER: Final = Path(__file__).parents[1] / "docs" / "profiles"
#: The list, which leads to the others.
INDEX: Final = "index.md"

_MADE: Final = "<!-- Made by `python -m deploy.profile_pages` from gateway/profiles/{file}. -->"
_INDEX: Final = """\
# Shipped profiles

{made}

A profile says what a kind of device accepts, and what its registers mean. Name it in the config, `profile = "NAME"`,
for a device or a whole line. For other devices, [describe them](../tutorials/describe-a-device.md); your own profiles
are [files](../configuration.md#where-profiles-come-from) too.

*Seen* is what a profile was tried with: frames that its document prints, a simulated device, or hardware.

| profile | kind of device | maker | seen |
|---|---|---|---|
{rows}

```{{toctree}}
:hidden:

{names}
```
"""
_USE: Final = """\
```toml
devices = [{{ unit = 1, name = "my-device", profile = "{name}" }}]
```
"""
_COLUMNS: Final = (
    "name",
    "area",
    "address",
    "reference",
    "type",
    "scale",
    "unit",
    "write",
    "limits",
    "no value",
    "labels",
)
_ALWAYS: Final = ("name", "area", "address", "reference", "type")


def pages() -> dict[str, str]:
    """Make all pages, by the names of their files."""
    files = [file for name in shipped_names() if (file := shipped_profile(name)) is not None]
    tables = {file.name: file.table for file in files if file.table is not None}
    made = {f"{file.name}.md": page(file.name, file.table, file.text) for file in files if file.table is not None}
    return {INDEX: _index(tables), **made}


def write_pages(folder: Path = FOLDER) -> None:
    """Write all pages, and remove those of profiles that are gone."""
    folder.mkdir(exist_ok=True)
    made = pages()
    for old in folder.glob("*.md"):
        if old.name not in made:
            old.unlink()
    for name, text in made.items():
        (folder / name).write_text(text, encoding="utf-8")


def _index(tables: dict[str, ProfileTable]) -> str:
    rows = [
        f"| [`{name}`]({name}.md) | {_cell(table.title)} | {_cell(table.maker)} | {table.seen} |"
        for name, table in tables.items()
    ]
    return _INDEX.format(made=_MADE.format(file="*.toml"), rows="\n".join(rows), names="\n".join(tables))


def page(name: str, table: ProfileTable, text: str) -> str:
    """Make the page of a profile, whose file is `text`: the comment at its top is for the reader too."""
    facts = [f"| {fact} | {_cell(said)} |" for fact, said in _facts(table)]
    parts = [f"# {name}", "", _MADE.format(file=f"{name}.toml"), "", _sentence(table.title), ""]
    parts += [*_comment_at_top(text), _USE.format(name=name), "| | |", "|---|---|", *facts, ""]
    if table.timing:
        parts += ["## Answer times", "", "| function | items | time |", "|---|---|---|"]
        parts += [f"| {row.fc} | {row.items} | {show_duration(row.time)} |" for row in table.timing]
        parts += [""]
    if table.points:
        parts += ["## Points", "", *_points(table), ""]
    return "\n".join(parts)


def _comment_at_top(text: str) -> list[str]:
    lines = takewhile(lambda line: line.startswith("#"), text.splitlines())
    return [*(_cell(line.removeprefix("#")) for line in lines), ""]


def _facts(table: ProfileTable) -> Iterator[tuple[str, str]]:
    """Give what the profile says, beside times and points."""
    yield from ((key, text) for key, text in (("maker", table.maker), ("source", table.source)) if text)
    if table.seen:
        yield "seen", table.seen
    if table.identity is not None:
        yield "recognised by", identity_text(table.identity)
    if table.mode is not None:
        yield "mode", table.mode.upper()
    yield "functions", "all" if table.functions is None else ", ".join(map(str, table.functions))
    if table.limits:
        yield "most items", "; ".join(f"{most} of function {function}" for function, most in table.limits.items())
    addresses = [f"{area} {show_ranges(ranges)}" for area in Area if (ranges := ranges_in(area, table))]
    if addresses:
        yield "addresses", "; ".join(addresses)
    if table.wide:
        yield (
            "registers of four bytes",
            "; ".join(f"{area} {show_ranges(ranges)}" for area, ranges in table.wide.items()),
        )
    if table.max_gap:
        yield "read together", f"over gaps of up to {table.max_gap} addresses"
    yield "time-out", f"{show_duration(table.timeout)} for functions without an answer time"


def _points(table: ProfileTable) -> Iterator[str]:
    """Write the table of points, without columns in which nothing stands."""
    rows = [{**row, "name": f"`{row['names'].replace(' to ', '` to `')}`"} for row in point_rows(table)]
    columns = [each for each in _COLUMNS if each in _ALWAYS or any(row[each] for row in rows)]
    yield f"| {' | '.join(columns)} |"
    yield "|---" * len(columns) + "|"
    for row in rows:
        cells = (row[each] if each == "name" else _cell(row[each]) for each in columns)
        yield f"| {' | '.join(cells)} |"


def _sentence(text: str) -> str:
    return text if not text or text.endswith(".") else f"{text}."


def _cell(text: str) -> str:
    """Write text into a table of Markdown."""
    return " ".join(text.replace("\\", "\\\\").replace("|", "\\|").replace("*", "\\*").replace("<", "&lt;").split())


if __name__ == "__main__":
    write_pages()
