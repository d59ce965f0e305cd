"""Plain tables for people."""

from collections.abc import Sequence


def align(rows: Sequence[Sequence[str]], indent: str = "") -> str:
    """The rows with their columns under one another; the first row is the headings."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join(indent + "  ".join(map(str.ljust, row, widths)).rstrip() for row in rows)
