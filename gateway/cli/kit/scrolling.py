"""A part of long and wide text, which keys move."""

import sys
from collections.abc import Sequence
from typing import Final

from gateway.cli.kit.cells import cut, width_of
from gateway.cli.kit.paint import dim

#: So many cells the arrows to the left and to the right move by.
_SIDEWAYS: Final = 8


class Scrolling:
    """Where in a text the screen is; `place` says it, and is empty if all of it is seen."""

    def __init__(self) -> None:
        self.place = ""
        self._top = self._side = 0
        self._page = 1

    def obey(self, key: str) -> None:
        """Move as a key says; keys of another meaning do nothing."""
        rows = {"up": -1, "k": -1, "down": 1, "j": 1, "page up": -self._page, "page down": self._page}
        rows |= {"home": -sys.maxsize, "g": -sys.maxsize, "end": sys.maxsize, "G": sys.maxsize}
        cells = {"left": -_SIDEWAYS, "h": -_SIDEWAYS, "right": _SIDEWAYS, "l": _SIDEWAYS}
        self._top += rows.get(key, 0)
        self._side += cells.get(key, -sys.maxsize if key in ("home", "g") else 0)

    def shown(self, text: Sequence[str], columns: int, rows: int, to_see: int | None = None) -> Sequence[str]:
        """Return what is seen of a text in so many columns and rows, among it the row that is `to_see`."""
        self._page = max(1, rows - 1)
        if to_see is not None:
            self._top = max(to_see - rows + 1, min(self._top, to_see))
        self._top = max(0, min(self._top, len(text) - rows))
        longest = max(map(width_of, text), default=0)
        self._side = max(0, min(self._side, longest - columns + 1)) if longest > columns else 0
        seen = text[self._top : self._top + rows]
        self.place = f"{self._top + 1}-{self._top + len(seen)} of {len(text)}" if len(text) > rows else ""
        return [_clipped(line, columns, self._side) for line in seen]


def _clipped(line: str, columns: int, side: int) -> str:
    """Cut out what fits, with a mark at each side where there is more."""
    width = width_of(line)
    left = dim("<") if side and width else ""
    right = dim(">") if width - side > columns else ""
    return left + cut(line, columns - bool(left) - bool(right), side + bool(left)) + right
