"""Problems of a config file, with their places in it."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from difflib import SequenceMatcher, get_close_matches
from typing import Final, Literal, Self

#: The way from the top of the file to a key or a value: keys, and indices in lists.
Path = tuple[str | int, ...]

Severity = Literal["error", "warning"]

#: More names than this are no help. The longest table has 24 keys.
_MOST_NAMES: Final = 30
#: More names that are equally near are a list, too.
_MOST_NEAREST: Final = 3


class WrongValue(ValueError):  # noqa: N818 - it is a value that is wrong, not the program
    """A value that cannot be used: what is wrong, and what to write instead, if known."""

    def __init__(self, what: str, remedy: str = "") -> None:
        super().__init__(what)
        self.remedy = remedy


class NotText(WrongValue):
    """A value that must be text and is not, usually because its quotes are missing."""

    def __init__(self) -> None:
        super().__init__("must be text")


@dataclass(frozen=True, slots=True)
class Problem:
    """One thing that is wrong, or deserves a second look, at `path`.

    It is in `file` at `line` and `column`, both 0 if there is no text, in the table `name` at the beginning of `path`.
    """

    severity: Severity
    path: Path
    what: str
    remedy: str = ""
    #: Whether the key itself is wrong, not its value.
    on_key: bool = False
    file: str = ""
    line: int = 1
    column: int = 1
    name: str = ""

    def located(self, file: str, line: int, column: int, name: str = "") -> Self:
        """Make the same problem at its place in a file."""
        return replace(self, file=file, line=line, column=column, name=name)

    @property
    def subject(self) -> str:
        """Say what it is about: `line[0].baud: `; empty for the whole file."""
        return f"{dotted(self.path)}: " if self.path else ""

    def __str__(self) -> str:
        place = f"{self.file}:{self.line}:{self.column}" if self.line else self.file
        where = f"{place}: {self.severity}: "
        remedy = f"\n  help: {_on_one_line(self.remedy)}" if self.remedy else ""
        table = f' ({self.path[0]} "{self.name}")' if self.name else ""
        return where + _on_one_line(self.subject + self.what + table) + remedy


def _on_one_line(text: str) -> str:
    """Escape line breaks, which names from the file may have. Other characters are kept from the terminal elsewhere."""
    return text.replace("\n", r"\n").replace("\r", r"\r")


def error(path: Path, what: str, remedy: str = "") -> Problem:
    """Make a problem with which the file cannot be used."""
    return Problem("error", path, what, remedy)


def warning(path: Path, what: str, remedy: str = "") -> Problem:
    """Make a problem with which the file can be used."""
    return Problem("warning", path, what, remedy)


def errors_in(problems: Iterable[Problem]) -> tuple[str, ...]:
    """List those of them that are errors, as text."""
    return tuple(str(each) for each in problems if each.severity == "error")


def dotted(path: Path) -> str:
    """Write a path as text: `line[0].devices[2].unit`."""
    text = ""
    for part in path:
        text += f"[{part}]" if isinstance(part, int) else f".{part}"
    return text.removeprefix(".")


def did_you_mean(written: str, known: Iterable[str]) -> str:
    """Suggest the nearest of the `known` names for an unknown one, or all of them unless they are too many."""
    names = list(dict.fromkeys(known))
    close = get_close_matches(written, names, n=_MOST_NEAREST + 1)
    nearest = [name for name in close if _likeness(name, written) == _likeness(close[0], written)]
    if 0 < len(nearest) <= _MOST_NEAREST:
        return f"did you mean {either(nearest)}?"
    return f"known here: {', '.join(names)}" if 0 < len(names) <= _MOST_NAMES else ""


def _likeness(one: str, other: str) -> float:
    return SequenceMatcher(None, one, other).ratio()


def listed(names: Sequence[str], most: int = 3) -> str:
    """Name the first ones, and count the others: `a, b, c and 2 more`."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def either(names: Iterable[str]) -> str:
    """Write names as a choice: `"mint" or "v80"`."""
    return " or ".join(f'"{name}"' for name in sorted(names))
