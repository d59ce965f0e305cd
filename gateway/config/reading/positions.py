"""Finds the positions of keys and values in TOML text that `tomllib` has accepted."""

import re
import tomllib
from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from pathlib import Path as FilePath

from gateway.config.problem import Path, Problem
from gateway.config.reading.source import Source

_BLANK = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
STRING = re.compile(
    r'"""(?:[^\\]|\\.)*?"""(?:"{0,2})'
    r"|'''.*?'''(?:'{0,2})"
    r'|"(?:[^"\\]|\\.)*"'
    r"|'[^']*'",
    re.DOTALL,
)
_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")
_SCALAR = re.compile(r"[^,\]}#\n]+")
#: What most pairs are: a bare key, and text in a line or a word.
_PAIR = re.compile(
    r"([A-Za-z0-9_-]+)[ \t]*=[ \t]*"
    r"""("(?:[^"\\\n]|\\.)*+"(?!")|'[^'\n]*+'(?!')|[A-Za-z0-9_.:+-]++)"""
    r"[ \t]*(?=[,\]}#\r\n]|\Z)"
)
_BLANKS = frozenset(" \t\r\n#")

#: A value that is neither a list nor a table: its path, its begin and its end.
Scalar = tuple[Path, int, int]


@dataclass(frozen=True, slots=True)
class Part:
    """A file that is a part of a text, behind so many lines, and rows of each list of tables.

    It is `file` in problems and `name` in the places of tables, and paths in it count from `folder`.
    """

    file: str
    name: str
    folder: FilePath
    before: int
    rows: Mapping[str, int]

    def moved(self, problem: Problem) -> Problem:
        """Make a problem in the whole text one of this file."""
        section, index, *others = (*problem.path, "", "")[: max(2, len(problem.path))]
        path = (section, index - self.rows.get(str(section), 0), *others) if isinstance(index, int) else problem.path
        return replace(problem, file=self.file, line=problem.line - self.before, path=path)


class Positions:
    """Line and column, from 1, of every key and value of `text`."""

    def __init__(self, text: str) -> None:
        self._text = text
        scanner = _Scanner(text)
        scanner.document()
        self._keys, self._values = scanner.keys, scanner.values
        #: All values that are neither lists nor tables, in their order.
        self.scalars: Sequence[Scalar] = scanner.scalars
        #: The files of which the text is made, if they are several: the first is the config.
        self.parts: Sequence[Part] = ()
        self._line_starts = [0, *(match.end() for match in re.finditer("\n", text))]

    def key(self, path: Path) -> tuple[int, int]:
        """Find where the key at `path` stands, or the nearest table around it that does."""
        return self._place(self._keys, path)

    def value(self, path: Path) -> tuple[int, int]:
        """Find where the value at `path` begins, or the nearest table around it. A table begins at its header."""
        return self._place(self._values, path)

    def is_headed(self, key: str) -> bool:
        """Tell whether a table at the top is written below a heading, its own or that of a table in it."""
        at = self._keys.get((key,))
        return at is None or self._text[at] == "["

    def part(self, path: Path) -> Part | None:
        """Find the included file in which the value at `path` is; None if it is in the config itself."""
        return self._part(self.value(path)[0]) if self.parts else None

    def _part(self, line: int) -> Part | None:
        index = bisect_left(self.parts, line, key=attrgetter("before")) - 1
        return self.parts[index] if index > 0 else None

    def written(self, path: Path) -> str:
        """Give the number, date or word at `path` as it is written, for values that should have been text."""
        match = _SCALAR.match(self._text, self._values[path])
        return match[0].strip() if match else ""

    def place(self, path: Path, file: str, keys: Iterable[str]) -> str:
        """Give the place of the table at `path` in `file`, which has this text, with those of these keys in it."""
        line, _ = self.value(path)
        part = self._part(line)
        before, name = (0, file) if part is None else (part.before, part.name)
        return Source.of(name, line - before, {key: self.key((*path, key))[0] - before for key in keys})

    def locate(self, problem: Problem, file: str, name: str = "") -> Problem:
        """Give a problem its place in `file`, which has this text; `name` is that of the table it is in."""
        place = self.key(problem.path) if problem.on_key else self.value(problem.path)
        part, located = self._part(place[0]), problem.located(file, *place, name)
        return located if part is None else part.moved(located)

    def _place(self, offsets: dict[Path, int], path: Path) -> tuple[int, int]:
        while path not in offsets:
            path = path[:-1]
        line = bisect_right(self._line_starts, offsets[path])
        return line, offsets[path] - self._line_starts[line - 1] + 1


class _Scanner:
    """Walks once over the text. It checks nothing: it relies on the text being valid."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.at = 0
        self.keys: dict[Path, int] = {(): 0}
        self.values: dict[Path, int] = {(): 0}
        self.lengths: dict[Path, int] = {}
        self.scalars: list[Scalar] = []

    def document(self) -> None:
        table: Path = ()
        while self.skip_blank() < len(self.text):
            table = self.header() if self.text[self.at] == "[" else self.pair(table)

    def header(self) -> Path:
        start = self.at
        is_list = self.text.startswith("[[", start)
        self.at += 2 if is_list else 1
        *parents, last = self.key_parts()
        path = self.current((), [part for part, _ in parents])
        if is_list:
            path += (last[0],)
            self.lengths[path] = self.lengths.get(path, 0) + 1
            self.note(path, start)
            path += (self.lengths[path] - 1,)
        else:
            path = self.current(path, [last[0]])
        self.note(path, start)
        self.at += 2 if is_list else 1
        return path

    def current(self, path: Path, keys: list[str]) -> Path:
        """Continue `path` by `keys`; of a list of tables its last one is meant."""
        for key in keys:
            path += (key,)
            if path in self.lengths:
                path += (self.lengths[path] - 1,)
        return path

    def pair(self, table: Path) -> Path:
        match = _PAIR.match(self.text, self.at)
        if match is not None:
            path, begin, self.at = (*table, match[1]), match.start(2), match.end(2)
            self.keys.setdefault(path, match.start())
            self.values[path] = begin
            self.scalars.append((path, begin, self.at))
            return table
        path = table
        for part, start in self.key_parts():
            path += (part,)
            self.note(path, start)
        self.at += 1  # the equals sign
        self.skip_blank()
        self.value(path)
        return table

    def key_parts(self) -> list[tuple[str, int]]:
        parts = []
        while True:
            start = self.skip_blank()
            match = _BARE_KEY.match(self.text, start) or STRING.match(self.text, start)
            assert match is not None  # noqa: S101 - tomllib has accepted the text
            self.at = match.end()
            parts.append((_unquoted(match[0]), start))
            if self.text[self.skip_blank()] != ".":
                return parts
            self.at += 1

    def value(self, path: Path) -> None:
        self.values[path] = self.at
        self.keys.setdefault(path, self.at)
        opening = self.text[self.at]
        if opening == "[":
            self.items(path)
        elif opening == "{":
            self.inline_table(path)
        else:
            match = STRING.match(self.text, self.at) or _SCALAR.match(self.text, self.at)
            assert match is not None  # noqa: S101 - tomllib has accepted the text
            self.at = match.start() + len(match[0].rstrip())
            self.scalars.append((path, match.start(), self.at))

    def items(self, path: Path) -> None:
        self.at += 1
        index = 0
        while self.text[self.skip_blank()] != "]":
            self.value((*path, index))
            index += 1
            self.skip_comma()
        self.at += 1

    def inline_table(self, path: Path) -> None:
        self.at += 1
        while self.text[self.skip_blank()] != "}":
            self.pair(path)
            self.skip_comma()
        self.at += 1

    def skip_comma(self) -> None:
        if self.text[self.skip_blank()] == ",":
            self.at += 1

    def skip_blank(self) -> int:
        if self.text[self.at : self.at + 1] in _BLANKS:
            match = _BLANK.match(self.text, self.at)
            assert match is not None  # noqa: S101 - it may be empty
            self.at = match.end()
        return self.at

    def note(self, path: Path, start: int) -> None:
        """Note where a key or a table is named first."""
        self.keys.setdefault(path, start)
        self.values.setdefault(path, start)


def _unquoted(key: str) -> str:
    return str(tomllib.loads(f"key = {key}")["key"]) if key[0] in "\"'" else key
