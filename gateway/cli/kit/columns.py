"""Plain text tables."""

from collections.abc import Collection, Sequence

from gateway.observe.printable import printable

_BETWEEN = "  "
#: No column gets narrower than this, in characters.
_NARROWEST = 8


def align(rows: Sequence[Sequence[str]], indent: str = "") -> str:
    """Align the columns of `rows`; the first row has the headings. A cell is one line, whatever is in it."""
    rows = [[printable(cell).replace("\n", r"\n") for cell in row] for row in rows]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join(indent + _BETWEEN.join(map(str.ljust, row, widths)).rstrip() for row in rows)


def narrow(rows: Sequence[Sequence[str]], flexible: Collection[int], width: int) -> list[list[str]]:
    """Shorten the `flexible` columns until each row fits into `width` characters.

    Where that is not enough nothing is shortened: the rows are too long in any case.
    """
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    least = [min(each, _NARROWEST) if place in flexible else each for place, each in enumerate(widths)]
    if sum(least) + len(_BETWEEN) * (len(widths) - 1) > width:
        return [list(row) for row in rows]
    while sum(widths) + len(_BETWEEN) * (len(widths) - 1) > width:
        widest = max(flexible, key=widths.__getitem__, default=None)
        if widest is None or widths[widest] <= _NARROWEST:
            break
        widths[widest] -= 1
    return [list(map(shorten, row, widths)) for row in rows]


def shorten(text: str, width: int) -> str:
    """Shorten `text` to at most `width` characters by cutting out its middle."""
    if len(text) <= width:
        return text
    end = (width - 1) * 2 // 3
    return f"{text[: width - 1 - end]}…{text[len(text) - end :]}"
