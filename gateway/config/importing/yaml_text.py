"""YAML, with the library that an extra brings: as plain values, or as values that know where they stand."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from gateway.config.importing.imported import ImportedFileError

if TYPE_CHECKING:
    from ruamel.yaml.nodes import Node

_NO_LIBRARY: Final = (
    "to read YAML, the library ruamel.yaml is needed. In a checkout: .venv/bin/pip install ruamel.yaml; with pipx: "
    "pipx inject mbgw ruamel.yaml; the Debian package and the image have it"
)
_INT: Final = re.compile(r"[-+]?(?:0x[0-9a-fA-F_]+|[0-9][0-9_]*)")
_OCTAL: Final = re.compile(r"[-+]?0[0-7]+")
_FLOAT: Final = re.compile(r"[-+]?(?:[0-9][0-9_]*\.?[0-9_]*|\.[0-9_]+)(?:[eE][-+]?[0-9]+)?")
_LONGEST_NUMBER: Final = 100
_WORDS: Final = {"": None, "~": None, "null": None, "true": True, "false": False}
_MERGE: Final = "<<"


class Table(dict[str, Any]):
    """A table, and where it stands: `configuration.yaml:31`."""

    def __init__(self, where: str) -> None:
        super().__init__()
        self.where = where


class Tagged(NamedTuple):
    """A value with a tag of the program, such as `!include`."""

    tag: str
    value: Any
    where: str


def parse_yaml(text: str) -> Any:
    """Parse a document.

    Raises:
        ValueError: it is no YAML.
        ImportedFileError: the library is missing.
    """
    return _read("load", text)


def parse_located_yaml(text: str, file: str) -> Any:
    """Parse a document into values of YAML 1.1, of which tables know where in the `file` they stand.

    A later key counts, as in most programs, and a tag of the program is a `Tagged` value.

    Raises:
        ValueError: it is no YAML.
        RecursionError: it is nested too deeply.
        ImportedFileError: the library is missing.
    """
    node = _read("compose", text)
    return None if node is None else _Builder(file).value(node)


def _read(how: str, text: str) -> Any:
    try:
        from ruamel.yaml import YAML  # noqa: PLC0415 - an extra
        from ruamel.yaml.error import YAMLError  # noqa: PLC0415
    except ImportError:
        raise ImportedFileError(_NO_LIBRARY) from None
    try:
        return getattr(YAML(typ="safe", pure=True), how)(text)
    except YAMLError as wrong:
        mark, problem = getattr(wrong, "problem_mark", None), getattr(wrong, "problem", None)
        said = f"line {mark.line + 1}, column {mark.column + 1}: {problem}" if mark and problem else str(wrong)
        raise ValueError(" ".join(said.split())) from None


@dataclass(slots=True)
class _Builder:
    """Builds the values of nodes. A node that several places name by an anchor is built once."""

    file: str
    _built: dict[int, Any] = field(default_factory=dict)

    def value(self, node: "Node") -> Any:
        key = id(node)
        if key not in self._built:
            self._built[key] = None  # what contains itself contains nothing there
            self._built[key] = self._build(node)
        return self._built[key]

    def _build(self, node: "Node") -> Any:
        tag, where = str(node.tag), f"{self.file}:{node.start_mark.line + 1}"
        value = self._content(node, where)
        return Tagged(tag, value, where) if tag.startswith("!") else value

    def _content(self, node: "Node", where: str) -> Any:
        if isinstance(node.value, str):
            is_plain = getattr(node, "style", None) is None
            return _scalar(node.value) if is_plain and not str(node.tag).startswith("!") else node.value
        if not node.value or not isinstance(node.value[0], tuple):
            is_table = str(node.tag).endswith(":map")
            return Table(where) if is_table else [self.value(each) for each in node.value]
        table = Table(where)
        table.update(self._pairs(node))
        return table

    def _pairs(self, node: "Node") -> Iterator[tuple[str, Any]]:
        """List the keys of a table: those that are merged into it, then its own."""
        pairs = [(key.value, value) for key, value in node.value if isinstance(key.value, str)]
        for key, value in pairs:
            merged = self.value(value) if key == _MERGE else None
            for table in merged if isinstance(merged, list) else [merged]:
                yield from table.items() if isinstance(table, dict) else ()
        yield from ((key, self.value(value)) for key, value in pairs if key != _MERGE)


def plain_text(value: Any) -> str:
    """Write a scalar as text; nothing for a list, a table or a tag, which may contain others without end by anchors."""
    return "" if isinstance(value, (list, dict, Tagged)) else str(value).strip()


def _scalar(text: str) -> Any:
    """Parse a scalar without quotes: 0x9A, 010 in octal, 1_000. Words such as yes and N are text."""
    if text.lower() in _WORDS:
        return _WORDS[text.lower()]
    digits = text.replace("_", "")
    if _INT.fullmatch(text) and len(digits) < _LONGEST_NUMBER:
        return int(digits, 16 if "x" in text.lower() else 8 if _OCTAL.fullmatch(digits) else 10)
    return float(digits) if _FLOAT.fullmatch(text) else text
