"""Points on their way into a profile: a row for each, or in its place a comment that says why there is none."""

import re
import unicodedata
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from typing import Final

from gateway.config.importing.imported import Imported, ImportedFileError
from gateway.config.problem import Problem, WrongValue
from gateway.config.reading.toml_text import Row, Rows, TableText, Value, file_text
from gateway.config.values.point_keys import parse_point_name
from gateway.modbus.codes import Area

#: Finds the problems of a config's text.
Check = Callable[[str], Iterable[Problem]]

#: A name is shortened to so many characters, so that it can still get a number.
_LONGEST: Final = 56
_LONGEST_COMMENT: Final = 200
#: A row that is mended away may uncover another problem; after so many rounds the rest stays for `check`.
_ROUNDS: Final = 10
#: So many reasons are enough if nothing can be used.
_MOST_REASONS: Final = 20


@dataclass(slots=True)
class PointRow:
    """A point, what is said of it, and where it stood. Without keys it is a remark; with `why`, it was left out."""

    place: str
    keys: dict[str, Value] | None = None
    remark: str = ""
    why: str = ""

    @property
    def row(self) -> Row:
        """The row of a config."""
        if self.keys is not None:
            return Row(self.keys, on_one_line(self.remark))
        return Row(None, on_one_line(f"{self.place}: {self.why}" if self.why else self.remark))


@dataclass(slots=True)
class ProfilePart:
    """A profile in a config: its name, its keys but for the points, and these."""

    name: str
    keys: dict[str, Value]
    points: list[PointRow]
    comments: tuple[str, ...] = ()

    @property
    def table(self) -> TableText:
        """The table of a config."""
        keys: dict[str, Value | Rows] = {**self.keys, "points": Rows(tuple(point.row for point in self.points))}
        return TableText(f"[profile.{self.name}]", keys, self.comments)

    def leave_out(self, index: int, why: str) -> None:
        """Leave out the point with this index in the config."""
        point = [each for each in self.points if each.keys is not None][index]
        point.keys, point.why = None, why


@dataclass(slots=True)
class PointNames:
    """The names that points of a device have already."""

    _taken: set[str] = field(default_factory=lambda: set(Area))
    _numbers: dict[str, int] = field(default_factory=dict)

    def name(self, wanted: str, otherwise: str) -> str:
        """Take a name like the one that is wanted, or `otherwise` if there is nothing in it."""
        base = slug(wanted) or otherwise
        stem, star = base.removesuffix("*").rstrip("-"), "-*" if base.endswith("*") else ""  # a number stands there
        name = base
        while name in self._taken:
            self._numbers[base] = self._numbers.get(base, 1) + 1
            name = f"{stem}-{self._numbers[base]}{star}"
        self._taken.add(name)
        return name


def slug(text: str) -> str:
    """Make the name of a point of a text: lower case, letters and digits of every script, with hyphens; or nothing."""
    plain = unicodedata.normalize("NFKC", text).lower().replace("%", " percent ")
    words = re.sub(r"[^\w.*]+|_", "-", plain).strip("-.")
    words = re.sub(r"[-.]{2,}", "-", words)[:_LONGEST].rstrip("-.")
    if words and not words[0].isalpha():
        words = f"point-{words}"
    return words if words in set(Area) or is_point_name(words) else ""


def is_point_name(text: str) -> bool:
    """Tell whether a text can be the name of a point as it is."""
    try:
        return bool(parse_point_name(text))
    except WrongValue:
        return False


def plain(number: Decimal) -> Value:
    """Write a number as a config has it: whole if it is."""
    return int(number) if number == number.to_integral_value() else float(number)


def on_one_line(text: str) -> str:
    """Put a text on one line that is not too long."""
    line = " ".join(text.split())
    return line if len(line) <= _LONGEST_COMMENT else f"{line[:_LONGEST_COMMENT]}…"


def write(
    file: str,
    parts: Sequence[TableText | ProfilePart],
    check: Check,
    left_out: Sequence[str] = (),
    notes: Sequence[str] = (),
) -> Imported:
    """Write the config with these parts. Points that it may not have become comments in their places.

    `file` stands before the places of points, unless these name it themselves.
    """
    profiles = {part.name: part for part in parts if isinstance(part, ProfilePart)}
    for _ in range(_ROUNDS):
        text = file_text(part.table if isinstance(part, ProfilePart) else part for part in parts)
        wrong = _wrong_points(check(text))
        for (name, index), why in sorted(wrong.items(), reverse=True):
            profiles[name].leave_out(index, why)
        if not wrong:
            break
    points = [point for profile in profiles.values() for point in profile.points]
    where = f"{file}: " if file else ""
    lost = (*left_out, *(f"{where}{point.place}: {point.why}" for point in points if point.why))
    if not any(point.keys is not None for point in points):
        raise ImportedFileError("\n".join(lost[:_MOST_REASONS]) or f"{where}there is no point in it")
    return Imported(text, lost, tuple(notes))


def _wrong_points(problems: Iterable[Problem]) -> Mapping[tuple[str, int], str]:
    """Find the points that cannot be as they are written, and why: by profile and index."""
    wrong: dict[tuple[str, int], str] = {}
    for problem in problems:
        match problem.path:
            case ("profile", str(name), "points", int(index), *key) if problem.severity == "error":
                what = f"{'.'.join(map(str, key))}: {problem.what}" if key else problem.what
                wrong.setdefault((name, index), what)
    return wrong
