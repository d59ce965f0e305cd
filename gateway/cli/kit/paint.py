"""Colour: red for what is broken, yellow for warnings, dim for what is secondary.

Any text may be painted: whether there is colour is decided where it is written. Paint is a mark with a key that no
device, client or file can know, so that nobody else's text has colour, or moves the cursor.
"""

import os
import re
from collections.abc import Iterator
from typing import Final
from unicodedata import combining, east_asian_width

from gateway.observe.printable import printable

_KEY: Final = os.urandom(6).hex()
_BEGIN: Final = f"\x1b{_KEY}"
_MARK: Final = re.compile(f"({_BEGIN}[0-9]+m)")
_END: Final = f"{_BEGIN}0m"
_WIDE: Final = frozenset("WF")


def red(text: str) -> str:
    """Paint what is broken."""
    return _painted(text, 31)


def yellow(text: str) -> str:
    """Paint a warning."""
    return _painted(text, 33)


def dim(text: str) -> str:
    """Paint what is secondary."""
    return _painted(text, 2)


def reverse(text: str) -> str:
    """Paint what is chosen."""
    return _painted(text, 7)


def _painted(text: str, code: int) -> str:
    return f"{_BEGIN}{code}m{text}{_END}" if text else text


def plain(text: str) -> str:
    """Take the paint away."""
    return _MARK.sub("", text) if _KEY in text else text


def escaped(text: str) -> str:
    """Escape control characters, and keep the paint."""
    if _KEY not in text:
        return printable(text)
    return "".join(piece if _is_mark(piece) else printable(piece) for piece in _MARK.split(text))


def for_terminal(text: str, *, has_colour: bool) -> str:
    """Escape control characters, and turn paint into colour, or take it away."""
    if _KEY not in text:
        return printable(text)
    return escaped(text).replace(_BEGIN, "\x1b[") if has_colour else printable(plain(text))


def width_of(text: str) -> int:
    """Count the cells of a terminal that a text takes: two for a character of East Asia, none for an accent."""
    text = plain(text)
    return len(text) if text.isascii() else sum(map(_cells, text))


def cut(text: str, width: int, start: int = 0) -> str:
    """Cut out `width` cells from cell `start` on; what is cut in half becomes a space."""
    shown, at = list[str](), 0
    for character in _characters(text):
        cells = 0 if _is_mark(character) else _cells(character)
        begin, at = at, at + cells
        if not cells:
            shown += character if _is_mark(character) or start < begin <= start + width else ""
        elif begin < start < at or begin < start + width < at:
            shown += " "
        elif start <= begin and at <= start + width:
            shown += character
    return "".join(shown)


def padded(text: str, width: int) -> str:
    """Add spaces up to this number of cells."""
    return text + " " * (width - width_of(text))


def _characters(text: str) -> Iterator[str]:
    """Give each character, and each mark as a whole."""
    for piece in _MARK.split(text):
        yield from (piece,) if _is_mark(piece) else piece


def _is_mark(text: str) -> bool:
    return text.startswith(_BEGIN)


def _cells(character: str) -> int:
    return 0 if combining(character) else 2 if east_asian_width(character) in _WIDE else 1
