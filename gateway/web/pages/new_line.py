"""A line, or devices of one, that the config does not have yet: what a form says of them, and the text to add."""

import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from shlex import quote
from typing import Any, Final, NamedTuple

from gateway.config.machine.file_text import UnreadableFile, read_file_text
from gateway.config.machine.profile_folders import file_of, folders_of, names_in
from gateway.config.reading.positions import Positions
from gateway.config.reading.toml_text import Row, Rows, TableText, Value, value_text
from gateway.modbus.codes import LAST_UNIT, Area
from gateway.operator.operations.answers.scan import Found
from gateway.profiles import is_file_name, shipped_names, shipped_text
from gateway.timing.characters import LineTiming
from gateway.tools.signs import OTHERS

#: The most devices of a form, and points that are shown of a profile.
MOST_DEVICES: Final = 64
MOST_POINTS: Final = 400


@dataclass(frozen=True, slots=True)
class NewDevice:
    """A device: `unit` on the wire, `known_as` to clients."""

    unit: int
    known_as: int
    name: str
    profile: str

    @property
    def row(self) -> dict[str, Value]:
        """The row of `devices`."""
        row: dict[str, Value] = {"unit": self.unit}
        if self.known_as != self.unit:
            row["as"] = self.known_as
        if self.name:
            row["name"] = self.name
        return row if self.profile == OTHERS else {**row, "profile": self.profile}


@dataclass(frozen=True, slots=True)
class Proposal:
    """A unit that was found, or was named, and the device that it may be; `others` are profiles that fit as well."""

    found: Found
    device: NewDevice
    others: tuple[str, ...] = ()


def line_text(
    name: str, port: str, timing: LineTiming, devices: Sequence[NewDevice], *, only_listens: bool = False
) -> str:
    """Write the table of a new line."""
    mode, baud, format_ = timing.mode, timing.baud, str(timing.format)
    keys: dict[str, Value | Rows] = {"name": name} if name else {}
    keys |= {"port": port} | ({"mode": mode} if mode != "rtu" else {}) | {"baud": baud, "format": format_}
    keys |= {"role": "monitor"} if only_listens else {}
    return f"{TableText('[[line]]', {**keys, 'devices': Rows(tuple(Row(each.row) for each in devices))})}\n"


class Addition(NamedTuple):
    """A text to add to a config: with it the config is `whole`, in which so many lines stand `before` it.

    `is_first`: the line had no devices, and passed all units through.
    """

    added: str
    whole: str
    before: int
    is_first: bool = False


def with_line(text: str, added: str) -> Addition:
    """Append a table to a config."""
    before = f"{text.rstrip()}\n\n"
    return Addition(added, before + added, before.count("\n"))


def with_devices(text: str, line: str, devices: Sequence[NewDevice]) -> Addition | None:
    """Put devices before those of a line, in the way in which the text lists these; None if it has no such line."""
    try:
        tables = tomllib.loads(text).get("line", [])
        index = next(at for at, table in enumerate(tables) if _label(table) == line)
        is_first = "devices" not in tables[index]
        positions = Positions(text)
        row, column = positions.value(("line", index) if is_first else ("line", index, "devices"))
        first, _ = positions.value(("line", index, "devices", 0))
    except (ValueError, RecursionError, StopIteration, TypeError, AttributeError, KeyError):
        return None
    lines = text.splitlines(keepends=True)
    inside = "".join(f"  {value_text(each.row)},\n" for each in devices)
    if is_first:
        return _inserted(lines, row, 0, f"devices = [\n{inside}]\n", is_first=True)
    if lines[first - 1].lstrip().startswith("[["):
        added = "".join(f"{TableText('[[line.devices]]', each.row)}\n\n" for each in devices)
        return _inserted(lines, first - 1, 0, added)
    return _inserted(lines, row - 1, column, inside)


def _inserted(lines: Sequence[str], row: int, column: int, added: str, *, is_first: bool = False) -> Addition:
    """Insert a text behind so many lines, and characters of the next one; then on a line of its own."""
    split = lines[row] if column else ""
    before = "".join(lines[:row]) + (f"{split[:column]}\n" if column else "")
    after = split[column:] + "".join(lines[row + bool(column) :])
    return Addition(added, before + added + after, before.count("\n"), is_first)


def _label(table: Mapping[str, Any]) -> str:
    return str(table.get("name") or str(table.get("port")).rstrip("/").rsplit("/", 1)[-1])


def proposals(found: Iterable[Found], units: Iterable[int], names: Iterable[str]) -> Iterator[Proposal]:
    """Propose a device for each unit that was found; `units` and `names` are those of the config."""
    listed = list(found)
    taken, known = set(units), set(names)
    free = iter(number for number in range(1, LAST_UNIT + 1) if number not in taken | {each.unit for each in listed})
    for each in listed:
        kinds = tuple(kind for kind in each.profile.split(", ") if kind)
        profile = kinds[0] if kinds else OTHERS
        known_as = each.unit if each.unit not in taken and each.unit else next(free, each.unit)
        taken.add(known_as)
        base = "unit" if profile == OTHERS else profile
        name = next(name for name in _names(base, known_as) if name not in known)
        known.add(name)
        yield Proposal(each, NewDevice(each.unit, known_as, name, profile), kinds[1:])


def _names(base: str, number: int) -> Iterator[str]:
    yield f"{base}-{number}"
    yield from (f"{base}-{number}-{more}" for more in range(2, 1000))


def propose_line_name(names: Iterable[str]) -> str:
    """Propose a name for a line that none has."""
    taken = set(names)
    return next(name for number in range(1, 1000) if (name := f"line-{number}") not in taken)


def profile_names(config: Path, text: str) -> list[str]:
    """List the names of all profiles for this config, which has this text. Blocks."""
    names = set(shipped_names())
    for folder in folders_of(config):
        try:
            names |= set(names_in(folder))
        except OSError:
            continue
    return sorted(names | set(_profiles_in(text)))


def points_of(profile: str, config: Path, text: str) -> list[dict[str, str]]:
    """List the points of a profile as they are written, each with `name`, `place`, `type` and `unit`. Blocks."""
    table = _profiles_in(text).get(profile) or _profiles_in(_profile_text(profile, config)).get(profile) or {}
    points = table.get("points", ()) if isinstance(table, dict) else ()
    return [_shown(each) for each in points[:MOST_POINTS] if isinstance(each, dict)]


def _shown(point: Mapping[str, Any]) -> dict[str, str]:
    area = next((str(area) for area in Area if str(area) in point), "")
    place = f"{area} {point[area]}" if area else ""
    return {"name": str(point.get("name", "")), "place": place} | {
        key: str(point.get(key, "")) for key in ("type", "unit")
    }


def _profile_text(profile: str, config: Path) -> str:
    for folder in folders_of(config) if is_file_name(profile) else ():
        try:
            file = file_of(profile, folder)
            if file is not None:
                return read_file_text(file)
        except (OSError, UnreadableFile):
            continue
    return shipped_text(profile) or ""


def _profiles_in(text: str) -> dict[str, Any]:
    try:
        found = tomllib.loads(text).get("profile", {})
    except (ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


def commands_to_append(file: Path, added: str, *, is_service: bool) -> str:
    """Write the commands that append a table to the file, check it and use it."""
    order, name = "sudo " if is_service else "", quote(str(file))
    append = f"{order}tee -a {name} >/dev/null <<'END-OF-LINE'\n\n{added}END-OF-LINE"
    return f"{append}\n{_use(name, order)}"


def commands_to_edit(file: Path, *, is_service: bool) -> str:
    """Write the commands that open the file in an editor, check it and use it."""
    editor, order = ("sudoedit", "sudo ") if is_service else ('"${EDITOR:-nano}"', "")
    name = quote(str(file))
    return f"{editor} {name}\n{_use(name, order)}"


def _use(file: str, order: str) -> str:
    return f"modbus-gateway check {file} && {order}modbus-gateway reload"
