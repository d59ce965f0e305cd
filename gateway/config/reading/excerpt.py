"""Lines of a config file, or of the file of a profile, as a message about one of them may quote them."""

import re
import tomllib
from bisect import bisect_left
from collections.abc import Sequence
from functools import cached_property
from itertools import islice, takewhile
from operator import itemgetter
from typing import Final

from gateway.config.reading.masking import is_hidden, is_secret
from gateway.config.reading.positions import Positions, Scalar

_WORD: Final = re.compile(r"[\w.-]+")
_LOGIN: Final = re.compile(r"://[^\s\"']*@")
_HEADER: Final = re.compile(r"\s*\[[\w.\s\[-]+\]")
_BEGIN: Final = re.compile(rf"{_HEADER.pattern}|[\w.\"' \t-]+=")


class Excerpts:
    """The lines of a text, without those that may hold a secret or a part of one.

    `positions` are those in the text, if it is known to be TOML.
    """

    def __init__(self, text: str, positions: Positions | None = None) -> None:
        self._text = text
        self._positions = positions
        self._lines = text.split("\n")

    def line(self, number: int) -> str | None:
        """Return the line of this number, from 1; None if there is none, or it may hold a secret."""
        if not 1 <= number <= len(self._lines):
            return None
        line = self._lines[number - 1]
        if _names_secret(line) or "PRIVATE KEY" in line or _LOGIN.search(line):
            return None
        values = self._values
        is_unsafe = self._may_be_in_secret(number) if values is None else self._is_in_secret(number, values)
        return None if is_unsafe else line

    @cached_property
    def _values(self) -> Sequence[Scalar] | None:
        """The values in the text; None of one that is no TOML."""
        if self._positions is None:
            try:
                tomllib.loads(self._text)
                self._positions = Positions(self._text)
            except (ValueError, RecursionError):
                return None
        return self._positions.scalars

    def _is_in_secret(self, number: int, values: Sequence[Scalar]) -> bool:
        """Tell whether a value with a secret has a part in a line."""
        begin = sum(len(line) + 1 for line in self._lines[: number - 1])
        end = begin + len(self._lines[number - 1])
        behind = islice(values, bisect_left(values, begin, key=itemgetter(2)), None)
        return any(is_hidden(self._text, each) for each in takewhile(lambda each: each[1] <= end, behind))

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
