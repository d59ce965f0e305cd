"""Lines of a config file, or of the file of a profile, as a message about one of them may quote them."""

import re
from functools import cached_property
from typing import Final

from gateway.config.reading.masking import hidden_spans, is_secret

_WORD: Final = re.compile(r"[\w.-]+")
_LOGIN: Final = re.compile(r"://[^\s\"']*@")
_HEADER: Final = re.compile(r"\s*\[[\w.\s\[-]+\]")
_BEGIN: Final = re.compile(rf"{_HEADER.pattern}|[\w.\"' \t-]+=")


class Excerpts:
    """The lines of a text, without those that may hold a secret or a part of one."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._lines = text.split("\n")

    def line(self, number: int) -> str | None:
        """Return the line of this number, from 1; None if there is none, or it may hold a secret."""
        if not 1 <= number <= len(self._lines):
            return None
        line = self._lines[number - 1]
        if _names_secret(line) or "PRIVATE KEY" in line or _LOGIN.search(line):
            return None
        hidden = self._hidden
        is_hidden = self._may_be_in_secret(number) if hidden is None else number in hidden
        return None if is_hidden else line

    @cached_property
    def _hidden(self) -> frozenset[int] | None:
        """The numbers of the lines with secrets; None of a text that is no TOML."""
        try:
            found = hidden_spans(self._text)
        except (ValueError, RecursionError):
            return None
        lines: set[int] = set()
        for start, end in found:
            first = self._text.count("\n", 0, start) + 1
            lines.update(range(first, first + self._text.count("\n", start, end) + 1))
        return frozenset(lines)

    def _may_be_in_secret(self, number: int) -> bool:
        """Tell whether a line of a text that is no TOML may continue a secret, or be in a table of secrets."""
        before = "\n".join(self._lines[: number - 1])
        if before.count('"""') % 2 or before.count("'''") % 2:
            return True
        begins = [line for line in self._lines[:number] if _BEGIN.match(line)]
        headers = [line for line in begins if _HEADER.match(line)]
        return any(map(_names_secret, (*begins[-1:], *headers[-1:])))


def _names_secret(line: str) -> bool:
    return any(map(is_secret, _WORD.findall(line)))
