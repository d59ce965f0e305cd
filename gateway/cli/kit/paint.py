"""Colour: red for what is broken, yellow for warnings, dim for what is secondary.

Any text may be painted: whether there is colour is decided where it is written. Paint is a mark with a key that no
device, client or file can know, so that nobody else's text has colour, or moves the cursor.
"""

import os
import re
from collections.abc import Iterator
from typing import Final

from gateway.observe.printable import printable

_KEY: Final = os.urandom(6).hex()
_BEGIN: Final = f"\x1b{_KEY}"
_MARK: Final = re.compile(f"({_BEGIN}[0-9]+m)")
_END: Final = f"{_BEGIN}0m"
_RED: Final = 31
_YELLOW: Final = 33


def red(text: str) -> str:
    """Paint what is broken."""
    return _painted(text, _RED)


def yellow(text: str) -> str:
    """Paint a warning."""
    return _painted(text, _YELLOW)


def dim(text: str) -> str:
    """Paint what is secondary."""
    return _painted(text, 2)


def reverse(text: str) -> str:
    """Paint what is chosen."""
    return _painted(text, 7)


def _painted(text: str, code: int) -> str:
    return f"{_BEGIN}{code}m{text}{_END}" if text else text


def badness(text: str) -> int:
    """Rank a text by its paint: 2 if something in it is broken, 1 if there is a warning, else 0."""
    return 2 * (f"{_BEGIN}{_RED}m" in text) or int(f"{_BEGIN}{_YELLOW}m" in text)


def plain(text: str) -> str:
    """Take the paint away."""
    return _MARK.sub("", text) if _KEY in text else text


def escaped(text: str) -> str:
    """Escape control characters, and keep the paint."""
    if _KEY not in text:
        return printable(text)
    return "".join(piece if piece.startswith(_BEGIN) else printable(piece) for piece in _MARK.split(text))


def pieces(text: str) -> Iterator[tuple[str, bool]]:
    """Give each character, and each mark as a whole; and whether it is one."""
    for piece in _MARK.split(text):
        yield from ((piece, True),) if piece.startswith(_BEGIN) else ((each, False) for each in piece)


def for_terminal(text: str, *, has_colour: bool) -> str:
    """Escape control characters, and turn paint into colour, or take it away."""
    if _KEY not in text:
        return printable(text)
    return escaped(text).replace(_BEGIN, "\x1b[") if has_colour else printable(plain(text))
