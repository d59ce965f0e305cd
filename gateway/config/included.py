"""Files that a config includes: they are read as if their text stood behind its own."""

from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path as FilePath
from typing import Any, Final, NamedTuple

from gateway.config.machine.file_text import UnreadableFile, find_wrong_text, folder_of, read_file_text
from gateway.config.machine.included import find_included, is_config
from gateway.config.problem import Path, Problem, WrongValue, error, errors_in, warning
from gateway.config.reading.positions import Part, Positions
from gateway.config.reading.syntax import read_document
from gateway.config.reading.tables import LISTS
from gateway.config.reading.whole_text import ended, joined, unmarked
from gateway.config.schema.config import INCLUDE, PROFILE
from gateway.config.values.files import parse_include

#: How many files may be included.
MOST_FILES: Final = 200


class Document(NamedTuple):
    """The text of a file, and what it says: of a config with those that it includes, if they were read."""

    text: str
    tables: dict[str, Any]
    positions: Positions


def with_included(own: Document, file: str) -> tuple[Document, tuple[Problem, ...]]:
    """Add the files that a config includes, and list what is wrong with them. With an error, none is there."""
    reading = _Reading(own, file)
    files = reading.files()
    if errors_in(reading.problems):
        return own, tuple(reading.problems)
    text = joined(own.text, {name: each.text for name, each in files.items()})
    wrong = find_wrong_text(text)
    if wrong:
        found = error((INCLUDE,), f"with the files that it names, the config {wrong}")
        return own, (own.positions.locate(found, file),)
    parts = [*_parts(own, files, file)]
    read = read_document(text, file, LISTS)
    if isinstance(read, Problem):  # what `_contradictions` does not know
        *_, part = (each for each in parts if each.before < read.line)
        return own, (part.moved(read),)
    read[1].parts = parts
    return Document(text, *read), tuple(reading.problems)


def _parts(own: Document, files: Mapping[str, Document], file: str) -> Iterator[Part]:
    """Say where in the whole text each file is."""
    config, rows = FilePath(file), Counter[str]()
    yield Part(file, config.name, folder_of(config), 0, {})
    before, last = 0, own
    for name, document in files.items():
        before += ended(last.text).count("\n") + 1  # the line with its name
        rows.update({key: len(value) for key, value in last.tables.items() if isinstance(value, list)})
        path = config.parent / name
        yield Part(str(path), name, folder_of(path), before, dict(rows))
        last = document


class _Reading:
    """Reads the files that a config, `own` in `file`, includes. `problems` are located."""

    def __init__(self, own: Document, file: str) -> None:
        self.problems: list[Problem] = []
        self._own = own
        self._file = file
        self._config = FilePath(file)
        #: Where each single table and profile is first.
        self._first: dict[Path, str] = {}

    def files(self) -> dict[str, Document]:
        """Read all files, in their order; each once."""
        names = dict(self._names())
        if len(names) > MOST_FILES:
            self._complain((INCLUDE,), f"means {len(names)} files; {MOST_FILES} are possible")
            return {}
        self._note(self._config.name, self._own)
        found: dict[str, Document] = {}
        for name, path in names.items():
            document = self._read(name, path)
            if document is not None:
                found[name] = document
                file = str(self._config.parent / name)
                self.problems += [document.positions.locate(each, file) for each in self._contradictions(document)]
                self._note(name, document)
        return found

    def _names(self) -> Iterator[tuple[str, Path]]:
        """List the names of the files, each with the path of the pattern that means it."""
        try:
            patterns = parse_include(self._own.tables[INCLUDE])
        except WrongValue:  # TableReader tells it
            return
        for index, pattern in enumerate(patterns):
            path: Path = (INCLUDE, index)
            try:
                names = find_included(pattern, self._config)
            except WrongValue as wrong:
                self._complain(path, str(wrong), wrong.remedy)
                continue
            if not names:
                found = warning(path, "no file matches at the moment")
                self.problems.append(self._own.positions.locate(found, self._file))
            for name in names:
                if is_config(name, self._config):
                    self._complain(path, "is this file itself", "take it out")
                else:
                    yield name, path

    def _read(self, name: str, path: Path) -> Document | None:
        file = self._config.parent / name
        try:
            text = unmarked(read_file_text(file))
        except UnreadableFile as wrong:
            if wrong.line:
                self.problems.append(wrong.problem(file))
            else:
                self._complain(path, f"{file}: {wrong}", wrong.remedy)
            return None
        read = read_document(text, str(file), LISTS)
        if isinstance(read, Problem):
            self.problems.append(read)
            return None
        return Document(text, *read)

    def _contradictions(self, document: Document) -> Iterator[Problem]:
        """Find what an included file may not have, and single tables that are in an earlier file, too."""
        main = self._config.name
        for key, value in document.tables.items():
            first = self._first.get((key,))
            if key == INCLUDE:
                yield _on_key((key,), "an included file includes no others", f"name them in {main}")
            elif not document.positions.is_headed(key):
                what = "an included file has tables only, each below a heading"
                heading = f"[[{key}]]" if key in LISTS else f"[{key}]" if isinstance(value, dict) else ""
                yield _on_key((key,), what, f"write {heading}" if heading else f"write it at the top of {main}")
            elif key in LISTS and not isinstance(value, list):
                yield error((key,), "is a list of tables", f"write [[{key}]] with two brackets")
            elif key in LISTS and first is not None:
                yield error((key,), f"is written as {key} = [...] in {first}", f"write [[{key}]] there")
            elif key == PROFILE and isinstance(value, dict):
                for name in value:
                    if (PROFILE, name) in self._first:
                        yield _twice((PROFILE, name), self._first[PROFILE, name])
            elif first is not None:
                yield _twice((key,), first)

    def _note(self, name: str, document: Document) -> None:
        """Note what no later file may have."""
        for key, value in document.tables.items():
            paths: list[Path] = [(key,)]
            if key == PROFILE and isinstance(value, dict):
                paths = [(key, each) for each in value]
            elif isinstance(value, list) and document.positions.is_headed(key):
                paths = []
            for path in paths:
                self._first.setdefault(path, f"{name}:{document.positions.key(path)[0]}")

    def _complain(self, path: Path, what: str, remedy: str = "") -> None:
        self.problems.append(self._own.positions.locate(error(path, what, remedy), self._file))


def _on_key(path: Path, what: str, remedy: str) -> Problem:
    return Problem("error", path, what, remedy, on_key=True)


def _twice(path: Path, first: str) -> Problem:
    return error(path, f"is already in {first}", "there is one in all files together")
