"""The width of text on a terminal, in cells: two for a character of East Asia, none for an accent or for paint."""

from typing import Final
from unicodedata import combining, east_asian_width

from gateway.cli.kit.paint import pieces, plain

_WIDE: Final = frozenset("WF")


def width_of(text: str) -> int:
    """Count the cells that a text takes."""
    text = plain(text)
    return len(text) if text.isascii() else sum(map(_cells, text))


def cut(text: str, width: int, start: int = 0) -> str:
    """Cut out `width` cells from cell `start` on; what is cut in half becomes a space."""
    shown, at = list[str](), 0
    for piece, is_mark in pieces(text):
        begin, at = at, at + (0 if is_mark else _cells(piece))
        if begin == at:
            shown += [piece] if is_mark or start < begin <= start + width else []
        elif start <= begin and at <= start + width:
            shown.append(piece)
        elif begin < start < at or begin < start + width < at:
            shown.append(" ")
    return "".join(shown)


def padded(text: str, width: int) -> str:
    """Add spaces up to this number of cells."""
    return text + " " * (width - width_of(text))


def wrapped(text: str, width: int, indent: str = "", further: str = "") -> list[str]:
    """Break a text between words into lines of at most so many cells; a word that is longer is broken, too.

    The first line begins with `indent`, the others with `further`.
    """
    lines, width = [indent], max(width, width_of(further) + 2)
    for word in text.split():
        line, is_empty = lines[-1], lines[-1] in (indent, further)
        if not is_empty and width_of(line) + 1 + width_of(word) > width:
            lines.append(further)
            line, is_empty = further, True
        lines[-1] += word if is_empty else f" {word}"
        while width_of(lines[-1]) > width:
            head, tail = _broken(lines[-1], width)
            lines[-1:] = [head, further + tail]
    return lines


def _broken(text: str, width: int) -> tuple[str, str]:
    """Break a text after so many cells, or one less, so that no character is cut in half."""
    parts = [(cut(text, end), cut(text, width_of(text), end)) for end in (width, width - 1)]
    return next(each for each in parts if plain("".join(each)) == plain(text))


def _cells(character: str) -> int:
    return 0 if combining(character) else 2 if east_asian_width(character) in _WIDE else 1
