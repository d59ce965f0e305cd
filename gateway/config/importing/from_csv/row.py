"""A row of a sheet as a point of a profile."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from typing import Final, get_args

from gateway.config.importing.from_csv.headings import DESCRIPTION, DIVISOR, EXPONENT, FUNCTION, Columns
from gateway.config.importing.from_csv.layout import bits_of, labels_in, type_keys_of
from gateway.config.importing.from_csv.place import Addressing, Place
from gateway.config.importing.from_csv.words import (
    WRITING_FUNCTIONS,
    TypeWords,
    access_of,
    area_of,
    area_of_functions,
    factor_of,
    functions_of,
    number_of,
    scaled_unit,
    swap_of,
    type_of,
)
from gateway.config.importing.imported import ImportedFileError
from gateway.config.importing.points import plain
from gateway.config.reading.toml_text import Value
from gateway.modbus.codes import Area
from gateway.profiles.columns import numbers_of
from gateway.registers.items import WRITERS, WriteFunction, has_bits

_LONGEST_CELL: Final = 1000
_LONG_COLUMNS: Final = (DESCRIPTION, "labels")
_NOTHING: Final = frozenset({"", "-", "--", "—", "–", "/", "n/a", "na", "none", "null", "无"})


@dataclass(frozen=True, slots=True)
class RowReader:
    """Reads rows of a sheet. `point_names` are the names that its points get, by those in the sheet."""

    columns: Columns
    addressing: Addressing
    #: That of the column of references, if there is one beside that of addresses.
    references: Addressing | None
    has_decimal_comma: bool
    point_names: Mapping[str, str]

    def keys(self, cells: Sequence[str], name: str) -> dict[str, Value]:
        """Make the keys of the point in a row."""
        if any(len(cell) > _LONGEST_CELL for place, cell in enumerate(cells) if self._is_short(place)):
            raise ImportedFileError(f"a cell has more than {_LONGEST_CELL} characters")

        def cell(column: str) -> str:
            found = self.columns.cell(cells, column)
            return "" if found.lower() in _NOTHING and column != "address" else found

        place = self._place(cells)
        words = self._type_words(cell("type"))
        functions = self._functions(cell(FUNCTION))
        area = _area(place, words, cell("area"), functions)
        count, type_keys = type_keys_of(area, words, place, cell("length"), self.columns.heading("length"))
        bits = bits_of(place, cell("bits"), type_keys)
        several = place.last - place.first + 1 not in (1, count)
        addresses: Value = f"{place.first}-{place.last}" if several else place.first
        keys: dict[str, Value] = {"name": f"{name}-*" if several and "*" not in name else name, str(area): addresses}
        keys |= type_keys | self._swap(cell("word order"), words, count, area, type_keys) | bits
        keys |= self._numbers(cell)
        keys |= self._writing(cell, area, count, functions)
        labels = labels_in(cell("labels"))
        return keys | ({"labels": labels} if labels else {})

    def remark(self, cells: Sequence[str]) -> str:
        """Say what the sheet says of a row, for a comment behind its point."""
        labels = self.columns.cell(cells, "labels")
        remarks = [self.columns.cell(cells, DESCRIPTION), labels if labels and not labels_in(labels) else ""]
        return "; ".join(filter(None, remarks))

    def _is_short(self, place: int) -> bool:
        """Tell whether a column has short cells."""
        return any(place in places for column, places in self.columns.places.items() if column not in _LONG_COLUMNS)

    def _place(self, cells: Sequence[str]) -> Place:
        address, number = self.columns.cell(cells, "address"), self.columns.cell(cells, "reference")
        if not address:
            return (self.references or self.addressing).place(number)
        place = self.addressing.place(address)
        if self.references is not None and re.fullmatch(r"[0134]\d{4,5}", number):
            there = self.references.place(number)
            if there.first != place.first:
                raise ImportedFileError(f"address {address} and reference {number} are not the same place")
            return place._replace(area=there.area)
        return place

    def _type_words(self, cell: str) -> TypeWords | None:
        words = type_of(cell) if cell else None
        if cell and words is None:
            raise ImportedFileError(f'"{cell}" is no known type')
        return words

    def _functions(self, cell: str) -> frozenset[int]:
        functions = functions_of(cell) if cell else frozenset()
        if cell and not functions:
            raise ImportedFileError(f'"{cell}" is no known function')
        return functions

    def _swap(
        self, cell: str, words: TypeWords | None, count: int, area: Area, type_keys: Mapping[str, Value]
    ) -> dict[str, Value]:
        swap = swap_of(cell, self.columns.heading("word order")) if cell else words.swap if words else None
        if cell and swap is None:
            raise ImportedFileError(f'"{cell}" is no word order: write ABCD, CDAB, BADC or DCBA')
        if count == 1:  # there are no words to swap
            swap = {"words": "none", "both": "bytes"}.get(swap or "none", swap)
        if swap in (None, "none") or has_bits(area) or type_keys.get("type") in ("uint8", "int8"):
            return {}
        return {"swap": str(swap)}

    def _numbers(self, cell: Callable[[str], str]) -> dict[str, Value]:
        """Make the keys for scale, offset, decimals, unit, bounds and numbers that are no values."""
        scale, unit = self._scale(cell)
        keys: dict[str, Value] = {"scale_from": scale} if isinstance(scale, str) else {}
        if isinstance(scale, Decimal) and scale != 1:
            keys["scale"] = plain(scale)
        named = self.point_names.get(cell("scale from"), cell("scale from"))
        keys |= {"scale_from": named} if named else {}
        offset = self._number(cell("offset"))
        keys |= {"offset": plain(offset)} if offset else {}
        decimals = self._number(cell("decimals"))
        keys |= {} if decimals is None else {"decimals": plain(decimals)}
        keys |= {"unit": unit} if unit else {}
        for column in ("min", "max"):
            bound = self._number(cell(column))
            keys |= {} if bound is None else {column: plain(bound)}
        invalid = [plain(number_of(each)) for each in numbers_of(cell("invalid")) if each.lower() != "nan"]
        return keys | ({"invalid": invalid if len(invalid) > 1 else invalid[0]} if invalid else {})

    def _scale(self, cell: Callable[[str], str]) -> tuple[Decimal | str, str]:
        """Find the scale of a row, or the name of the point with its power of ten, and the unit."""
        scale, unit = Decimal(1), cell("unit").strip("[]()")
        unit = "°C" if unit in ("℃", "ºC", "˚C") else unit
        if cell("scale") in self.point_names:
            return self.point_names[cell("scale")], unit
        if cell("scale"):
            scale = factor_of(cell("scale"), has_decimal_comma=self.has_decimal_comma)
        elif cell(DIVISOR):
            scale = 1 / factor_of(cell(DIVISOR), has_decimal_comma=self.has_decimal_comma)
        elif cell(EXPONENT):
            scale = Decimal(10) ** int(factor_of(cell(EXPONENT)) if cell(EXPONENT).strip("0+-. ") else 0)
        elif not any(map(self.columns.has, ("scale", DIVISOR, EXPONENT))):
            return scaled_unit(unit)
        return scale, unit

    def _number(self, cell: str) -> Decimal | None:
        return number_of(cell, has_decimal_comma=self.has_decimal_comma) if cell else None

    def _writing(
        self, cell: Callable[[str], str], area: Area, count: int, functions: frozenset[int]
    ) -> dict[str, Value]:
        access = cell("access")
        writing = access_of(access) if access else ("yes" if functions & WRITING_FUNCTIONS else "no")
        if writing is None:
            raise ImportedFileError(f'"{access}" is no access: write R, RW or W')
        if writing == "no":
            return {}
        keys: dict[str, Value] = {"write": "only" if writing == "only" else True}
        write_at = cell("write at")
        if write_at:
            keys["write_at"] = self.addressing.place(write_at).first
        said = cell("write function").lower()
        function = said
        if said not in get_args(WriteFunction):
            function = _write_function(area, count, functions_of(said) or functions)
        return keys | ({"write_function": function} if function else {})


def _area(place: Place, words: TypeWords | None, cell: str, functions: frozenset[int]) -> Area:
    """Find the area of a row; what the row says of it must agree."""
    named = area_of(cell) if cell else None
    if cell and named is None:
        raise ImportedFileError(f'"{cell}" is no area: write holding, input, coils or discrete')
    found = {each for each in (named, place.area, area_of_functions(functions)) if each is not None}
    if len(found) > 1:
        raise ImportedFileError(f"it names two areas, {' and '.join(sorted(found))}")
    if functions and not found:
        raise ImportedFileError("its functions are of several areas")
    if not found and words is not None and words.kind == "bool" and place.bit is None:
        raise ImportedFileError("is it a coil, a discrete input, or a bit of a register? The row does not say so")
    return found.pop() if found else Area.HOLDING


def _write_function(area: Area, count: int, functions: frozenset[int]) -> str:
    """Tell how a point is written if the functions of its row leave one way only, and it is not the usual one."""
    if area not in WRITERS:
        return ""
    single, several, _ = WRITERS[area]
    return "multiple" if count == 1 and several in functions and single not in functions else ""
