"""Text from devices, clients and other sites for a terminal: without characters that would steer it."""

from typing import Final

#: Invisible characters that stay: ends of lines, tabs, and spaces that do not break.
_KEPT: Final = "\n\t\u00a0\u2009\u202f"
_WITHOUT_KEPT: Final = str.maketrans("", "", _KEPT)


def printable(text: str) -> str:
    r"""Replace control and format characters by escapes, such as `\x1b`."""
    if text.translate(_WITHOUT_KEPT).isprintable():
        return text
    return "".join(each if each.isprintable() or each in _KEPT else _escaped(each) for each in text)


def _escaped(character: str) -> str:
    return character.encode("unicode_escape").decode("ascii")
