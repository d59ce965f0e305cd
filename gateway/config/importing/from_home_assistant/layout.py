"""How the registers of an entity carry its values: its data type, or its structure, and its swap."""

import re
from collections.abc import Iterator, Mapping
from typing import Final, NamedTuple

from gateway.config.importing.from_home_assistant.fields import Fields
from gateway.config.importing.imported import ImportedFileError
from gateway.config.reading.toml_text import Value
from gateway.registers.datatypes import registers_of

#: Before 2021.9, `count` said how wide these are.
_OLD_TYPES: Final[Mapping[str, str]] = {"int": "int", "integer": "int", "uint": "uint", "float": "float"}
_TYPES: Final = frozenset(("int16", "int32", "int64", "uint16", "uint32", "uint64", "float32", "float64"))
_SWAPS: Final[Mapping[str, str]] = {"none": "none", "byte": "bytes", "word": "words", "word_byte": "both"}
#: The letters of Python's structures: our types for them, and their bytes.
_LETTERS: Final[Mapping[str, tuple[str, int]]] = {
    "h": ("int16", 2),
    "H": ("uint16", 2),
    "i": ("int32", 4),
    "I": ("uint32", 4),
    "l": ("int32", 4),
    "L": ("uint32", 4),
    "q": ("int64", 8),
    "Q": ("uint64", 8),
    "f": ("float32", 4),
    "d": ("float64", 8),
    "b": ("int8", 1),
    "B": ("uint8", 1),
    "s": ("string", 1),
    "x": ("", 1),
}
_MOST_REGISTERS: Final = 125
_REGISTER: Final = 2


class Part(NamedTuple):
    """One value: the register where it begins, counted from the first one, and the keys for its type."""

    register: int
    keys: dict[str, Value]


class Layout(NamedTuple):
    """The values in the registers of an entity, and how many registers these are."""

    parts: tuple[Part, ...]
    registers: int


def layout_of(fields: Fields) -> Layout:
    """Find the values of an entity."""
    name, count = fields.text("data_type", "int16").lower(), fields.whole("count", 0)
    swap, structure = _swap(fields), fields.text("structure", "")
    if name == "custom":
        layout = _structured(structure or ">f")
        if count and count != layout.registers:  # with padding, or the C types of a machine
            what = f'structure "{structure}" is {layout.registers} registers here, and count is {count}'
            raise ImportedFileError(f"{what}: begin it with > or <")
        return layout
    if name == "string":
        keys: dict[str, Value] = {"type": "string", "length": count or 1}
        return Layout((Part(0, keys | ({"swap": "bytes"} if swap in ("bytes", "both") else {})),), count)
    if name in _OLD_TYPES or (count > 1 and not fields.has("data_type")):
        of_old = _OLD_TYPES.get(name, "int")
        name = f"{of_old}{16 * (count or (2 if of_old == 'float' else 1))}"
    if name not in _TYPES:
        raise ImportedFileError(f"data_type {name} is not known here")
    return Layout((Part(0, _typed(name, swap)),), registers_of(name))


def _swap(fields: Fields) -> str:
    """Find the swap; `reverse_order` is its old name."""
    swap = fields.text("swap", "word" if fields.truth("reverse_order") else "none")
    if swap not in _SWAPS:
        raise ImportedFileError(f"swap {swap} is not known here")
    return _SWAPS[swap]


def _typed(name: str, swap: str) -> dict[str, Value]:
    """Make the keys for a type; of a single register only the bytes can change places."""
    if registers_of(name) == 1:
        swap = {"words": "none", "both": "bytes"}.get(swap, swap)
    keys: dict[str, Value] = {} if name == "uint16" else {"type": name}
    return keys | ({} if swap == "none" else {"swap": swap})


def _structured(structure: str) -> Layout:
    """Find the values in a structure of Python, for which `swap` does not count."""
    found = re.fullmatch(r"([<>!=@]?)((?:\s*\d{0,3}[a-zA-Z?])+)\s*", structure, re.ASCII)
    if found is None:
        raise ImportedFileError(f'structure "{structure}" is not understood')
    swap = "none" if found[1] in (">", "!") else "both"  # the machines of Home Assistant have the low byte first
    items = [(int(times or 1), letter) for times, letter in re.findall(r"(\d*)([a-zA-Z?])", found[2])]
    unknown = {letter for _, letter in items} - _LETTERS.keys()
    if unknown:
        raise ImportedFileError(f'structure "{structure}": {", ".join(sorted(unknown))} is not known here')
    end = sum(times * _LETTERS[letter][1] for times, letter in items)
    if not end or end % _REGISTER or end > _REGISTER * _MOST_REGISTERS:
        raise ImportedFileError(f'structure "{structure}" is no whole number of registers, or too long')
    return Layout(tuple(_values(structure, items, swap)), end // _REGISTER)


def _values(structure: str, items: list[tuple[int, str]], swap: str) -> Iterator[Part]:
    at = 0
    for number, letter in items:
        name, size = _LETTERS[letter]
        times, size = (1, number) if letter == "s" else (number, size)
        if name and size != 1 and (at % _REGISTER or size % _REGISTER):
            raise ImportedFileError(f'structure "{structure}" has a value that begins or ends within a register')
        for _ in range(times):
            register, is_low = divmod(at, _REGISTER)
            if letter == "s" and size > 1:
                yield Part(register, {"type": name, "length": size // _REGISTER})
            elif letter == "s":
                yield Part(register, {"type": name, "length": 1, "byte": "low" if is_low else "high"})
            elif size == 1 and name:
                yield Part(register, {"type": name, "byte": "low" if is_low else "high"})
            elif name:
                yield Part(register, _typed(name, swap))
            at += size
