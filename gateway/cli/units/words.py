"""Parses the words after `read UNIT` and `write UNIT`: names of points, or an area, addresses and a type."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, Literal, NamedTuple

from gateway.cli.kit.usage import WrongUsageError
from gateway.config.problem import did_you_mean
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.profiles.point import Point
from gateway.profiles.profile import Range, width_at
from gateway.profiles.writing import to_be_writable
from gateway.registers.datatypes import DATA_TYPES, fits_wide, registers_of
from gateway.registers.items import REGISTER, WRITERS, has_bits, place_of, usual_type

_ADDRESSES: Final = re.compile(r"(0x[0-9a-f]+|\d+)(?:-(0x[0-9a-f]+|\d+))?", re.IGNORECASE)
_LAST_ADDRESS: Final = 65535

Verb = Literal["read", "write"]


@dataclass(frozen=True, slots=True)
class Command:
    """The verb, the unit, its points and its registers of four bytes; used to suggest a correct command.

    `is_virtual` tells that the unit is a virtual one, whose rows say what can be written.
    """

    verb: Verb
    unit: str
    points: tuple[Point, ...] = ()
    swap: str = "none"
    wide: Mapping[str, tuple[Range, ...]] = field(default_factory=dict)
    is_virtual: bool = False

    def like(self, *words: object) -> str:
        """Write the command with other words."""
        return " ".join(["modbus-gateway", self.verb, self.unit, *map(str, words)])


class Assignment(NamedTuple):
    """A point and the text of its new value."""

    point: Point
    text: str


def find_points(command: Command, words: Sequence[str]) -> list[Point]:
    """Find the points to read: all points of the unit, some of them, or values at addresses."""
    if not words:
        found = [point for point in command.points if point.write != "only"]
        if not found:
            what = f"{command.unit} has no points; say what to read"
            raise WrongUsageError(what, command.like("holding", "0-9"))
        return found
    if words[0] not in set(Area):
        return [_require_readable(_find_point(command, word, words), command) for word in words]
    area, addresses, data_type = Area(words[0]), *_place(command, words)
    return _values(command, area, addresses, data_type)


def find_assignments(command: Command, words: Sequence[str]) -> list[Assignment]:
    """Find what to write: a value to a point, or values from an address on."""
    if words and words[0] in set(Area):
        return _assign_to_addresses(command, words)
    if not words:
        raise WrongUsageError("say what to write", _example(command))
    point = _find_point(command, words[0], words)
    if point.write == "no":
        what = f"{point.name} is read-only"
        if command.is_virtual:
            remedy = "its row has no write = true, or cannot be written: modbus-gateway map {} shows what can"
            raise WrongUsageError(what, remedy.format(command.unit))
        remedy = f"to allow writing, add {to_be_writable(point)} to the point in the config"
        if point.area in WRITERS and point.bits is None:
            type_ = () if point.type == "bit" else (point.type,)
            swap = () if point.swap == "none" else ("--swap", point.swap)
            itself = command.like(point.area, point.address, "VALUE", *type_, *swap)
            remedy += f"; for a point of a shipped profile, write its address, without scale: {itself}"
        raise WrongUsageError(what, remedy)
    if len(words) != 2:
        raise WrongUsageError(
            f"{point.name} takes one value" + (f", not {len(words) - 1}" if words[1:] else ""),
            command.like(point.name, next(iter(point.labels.values()), "1")),
        )
    return [Assignment(point, words[1])]


def _assign_to_addresses(command: Command, words: Sequence[str]) -> list[Assignment]:
    area = Area(words[0])
    if area not in WRITERS:
        raise WrongUsageError(f"{area} cannot be written; coils and holding can", command.like("holding", "0", "1"))
    if len(words) > 3 and words[2] in DATA_TYPES:
        raise WrongUsageError("the type is the last word", command.like(*words[:2], *words[3:], words[2]))
    values = [*words[2:]]
    if len(words) < 3:
        raise WrongUsageError("address and value are missing", command.like(area, *words[1:2] or "0", "1"))
    first, last = _addresses(command, words)
    width = _width(command, area, first, first if last is None else last)
    data_type = values.pop() if len(values) > 1 and values[-1] in DATA_TYPES else usual_type(area, width)
    size = _size(data_type, values, width)
    if last is not None and last - first + 1 != size * len(values):
        what = f"{first}-{last} are {last - first + 1} {_items(area)}, but the values need {size * len(values)}"
        raise WrongUsageError(what, command.like(area, first, *words[2:]))
    _check_type(command, area, data_type, [area, first, *values], width)
    end = first + size * len(values) - 1
    if end > _LAST_ADDRESS:
        raise WrongUsageError(f"the last address is {_LAST_ADDRESS}, but the values end at {end}")
    _width(command, area, first, end)
    points = (_value(command, area, first + index * size, data_type, size, width) for index in range(len(values)))
    return [Assignment(point, text) for point, text in zip(points, values, strict=True)]


def _place(command: Command, words: Sequence[str]) -> tuple[tuple[int, int | None], str]:
    """Parse the addresses and the type after an area."""
    area = Area(words[0])
    if len(words) < 2:
        raise WrongUsageError(f"{area} of which address? It is missing", command.like(area, "0"))
    if len(words) > 3:
        raise WrongUsageError(f'"{words[3]}" is one word too many', command.like(*words[:3]))
    first, last = _addresses(command, words)
    width = _width(command, area, first, first if last is None else last)
    data_type = words[2] if len(words) > 2 else usual_type(area, width)
    _check_type(command, area, data_type, words[:2], width)
    return (first, last), data_type


def _addresses(command: Command, words: Sequence[str]) -> tuple[int, int | None]:
    """Parse first and last address; None if there is only one."""
    area, text, rest = words[0], words[1], words[2:]
    match = _ADDRESSES.fullmatch(text)
    if match is None:
        raise WrongUsageError(f'"{text}" is not an address', command.like(area, "0", *rest))
    first, last = int(match[1], 0 if "x" in text else 10), match[2] and int(match[2], 0 if "x" in match[2] else 10)
    if max(first, last or 0) > _LAST_ADDRESS:
        place = place_of(text)
        remedy = command.like(*place, *rest) if place else f"addresses are 0 to {_LAST_ADDRESS}"
        raise WrongUsageError(f"{text} is {'a reference number, ' if place else ''}not an address", remedy)
    if isinstance(last, int) and last < first:
        raise WrongUsageError(f"{text} counts backwards", command.like(area, f"{last}-{first}", *rest))
    return first, last if isinstance(last, int) else None


def _values(command: Command, area: Area, addresses: tuple[int, int | None], data_type: str) -> list[Point]:
    first, last = addresses
    width = _width(command, area, first, first)
    size = registers_of(data_type, width)
    if last is None:
        last = first + size - 1
    count = last - first + 1
    if data_type == "string":
        size = count
    typed = () if data_type == usual_type(area, width) else (data_type,)
    if count % size:
        what = f"{first}-{last} are {count} registers, but each {data_type} takes {size}"
        raise WrongUsageError(what, command.like(area, f"{first}-{first + (count // size + 1) * size - 1}", *typed))
    if last > _LAST_ADDRESS:
        raise WrongUsageError(f"the last address is {_LAST_ADDRESS}, but the value ends at {last}")
    _width(command, area, first, last)
    return [_value(command, area, at, data_type, size, width) for at in range(first, last + 1, size)]


def _value(command: Command, area: Area, address: int, data_type: str, size: int, width: int) -> Point:
    return Point("", area, address, data_type, command.swap, size, write="yes", width=width)


def _width(command: Command, area: Area, first: int, last: int) -> int:
    """Tell how many bytes each of these registers has."""
    width = width_at(command.wide, Span(area, first, last - first + 1))
    if width is None:
        raise WrongUsageError(f"only some of {area} {first}-{last} have four bytes", f"{command.verb} them apart")
    return width


def _size(data_type: str, values: Sequence[str], width: int) -> int:
    """Count the registers that each value needs; each text needs as many as the longest one."""
    if data_type == "string":
        return max(-(-len(text.encode()) // width) for text in values)
    return registers_of(data_type, width)


def _check_type(command: Command, area: Area, data_type: str, words: Sequence[object], width: int) -> None:
    """Check that an area can have the type; `words` are the words without it."""
    if data_type not in DATA_TYPES:
        what = f'"{data_type}" is not a type'
        raise WrongUsageError(what, did_you_mean(data_type, DATA_TYPES) or f"types are {', '.join(DATA_TYPES)}")
    if has_bits(area) != (data_type == "bit"):
        what = f"{area} are bits, not {data_type}" if has_bits(area) else f"{area} registers are not bits"
        raise WrongUsageError(what, command.like(*words))
    if width > REGISTER and not fits_wide(data_type):
        raise WrongUsageError(f"these registers have four bytes, and a {data_type} has two", command.like(*words))
    if command.swap != "none" and has_bits(area):
        raise WrongUsageError("bits have no order to swap", command.like(*words))


def _require_readable(point: Point, command: Command) -> Point:
    if point.write == "only":
        raise WrongUsageError(
            f"{point.name} can be written, but not read", f"{command.like()} reads all readable points"
        )
    return point


def _find_point(command: Command, word: str, words: Sequence[str]) -> Point:
    """Find the point with this name."""
    point = next((point for point in command.points if point.name == word), None)
    if point is not None:
        return point
    place = place_of(word)
    if place is not None:
        raise WrongUsageError(f"{word} is a reference number: {place[0]} {place[1]}", command.like(*place, *words[1:]))
    if _ADDRESSES.fullmatch(word):
        what = f"{word} of what? Coils, discrete inputs, input and holding registers have their own addresses"
        raise WrongUsageError(what, command.like("holding", *words))
    known = [*(point.name for point in command.points), *Area]
    remedy = did_you_mean(word, known) or f"{command.like()} shows its points"
    raise WrongUsageError(f'{command.unit} has no point "{word}"', remedy)


def _example(command: Command) -> str:
    point = next((point for point in command.points if point.write != "no"), None)
    if point is None:
        return command.like("holding", "0", "1")
    return command.like(point.name, next(iter(point.labels.values()), "1"))


def _items(area: Area) -> str:
    return "coils" if has_bits(area) else "registers"
