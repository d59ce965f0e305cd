"""Which column of a sheet is which: by the words of its heading, and where these may mean several things by its cells.

Case, punctuation and what stands in brackets do not matter. The names of columns are those of
`gateway.profiles.columns`, which `profile NAME --csv` writes.
"""

import re
from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from gateway.config.importing.from_csv.place import looks_like_a_place
from gateway.config.importing.from_csv.sheet import Sheet
from gateway.config.importing.from_csv.words import access_of, area_of, functions_of, simple, type_of

#: Columns that only others have: what is divided by, a power of ten, the functions of a row, what is said of it.
DIVISOR, EXPONENT, FUNCTION, DESCRIPTION = "divisor", "exponent", "function", "description"

#: The headings of each column, in the order in which a heading is tried; a slash stands between them.
_SPELLINGS: Final[Mapping[str, str]] = {
    "address": (
        "address / addr / adr / register address / register addr / reg address / reg addr / modbus address / "
        "register / registers / reg / register no / register number / protocol address / pdu address / "
        "offset address / start address / starting address / start register / address from 1 / address 1 based / "
        "address from 0 / address 0 based / adresse / registeradresse / register adresse / modbus adresse / "
        "startadresse / dirección / indirizzo / adresse registre / 地址 / "
        "寄存器地址 / 寄存器 / 起始地址 / 通讯地址 / modbus地址"
    ),
    "reference": (
        "reference / reference number / modbus reference / modicon / modicon address / modicon reference / "
        "modicon register / plc address / plc register / 4x reference / referenz / referenznummer / sps adresse / "
        "plc地址"
    ),
    "name": (
        "name / variable name / point / point name / tag / tag name / signal / signal name / parameter / "
        "parameter name / register name / variable / item / measurement / measured value / quantity name / "
        "label / channel / data point / datapoint / documented name / title / bezeichnung / benennung / "
        "messwert / datenpunkt / nombre / nom / 名称 / 参数 / "
        "参数名称 / 信号名称 / 寄存器名称 / 变量 / 变量名 / 数据名称 / 参量"
    ),
    "area": (
        "area / register type / reg type / table / register table / object type / modbus type / memory area / "
        "input type / data table / bereich / registertyp / registerart / speicherbereich / 寄存器类型 / 区 / 存储区"
    ),
    FUNCTION: (
        "function / function code / function codes / fc / fcs / func / func code / functions / modbus function / "
        "modbus function code / read function / read function code / supported functions / funktion / "
        "funktionscode / funktionscodes / lesefunktion / 功能码 / 读功能码"
    ),
    "type": (
        "type / data type / datatype / format / data format / value type / variable type / encoding / "
        "representation / data / typ / datentyp / datenformat / 数据类型 / 类型 / 格式 / 数据格式"
    ),
    "word order": (
        "word order / swap / word swap / endianness / endian / byte order / register order / order / "
        "byte and word order / wortreihenfolge / wortfolge / bytereihenfolge / byte reihenfolge / 字序 / 字节序 / "
        "字节顺序 / 大小端"
    ),
    "bits": "bits / bit / bit no / bit number / bit position / bit offset / bitnummer / bit mask position / 位",
    "scale": (
        "scale / scaling / scale factor / scaling factor / factor / multiplier / multiply / multiply by / "
        "resolution / coefficient / ratio / lsb / skalierung / skalierungsfaktor / faktor / auflösung / "
        "multiplikator / 系数 / 倍率 / 比例 / 比例系数 / 分辨率 / 精度 / 单位系数"
    ),
    DIVISOR: (
        "divisor / gain / divide / divide by / division / divider / precision factor / teiler / divisor factor / "
        "verstärkung / 增益 / 除数"
    ),
    EXPONENT: "exponent / power of ten / 10 exponent / scale exponent / power / 指数",
    "scale from": "scale from / scale register / scale factor register / scale factor point / sf / sf register",
    "offset": "offset / value offset / bias / zero offset / nullpunkt / versatz / 偏移 / 偏移量 / 零点",
    "decimals": (
        "decimals / decimal places / decimal digits / digits / nachkommastellen / dezimalstellen / kommastellen / "
        "小数位 / 小数位数"
    ),
    "unit": (
        "unit / units / uom / unit of measurement / unit of measure / engineering unit / eng unit / eng units / "
        "einheit / einheiten / unidad / unité / 单位"
    ),
    "access": (
        "access / client access / r w / rw / r w access / read write / access type / access right / access rights / "
        "access mode / permission / permissions / attribute / r o r w / ro rw / writable / writeable / write / "
        "customer write / access r w / zugriff / zugriffsrecht / lesen schreiben / l s / schreibbar / "
        "读写 / 读写属性 / 读写权限 / 属性 / 权限 / "
        "访问"
    ),
    "min": (
        "min / minimum / min value / minimum value / lower limit / low limit / kleinster wert / minimalwert / "
        "untergrenze / 最小值 / 下限"
    ),
    "max": (
        "max / maximum / max value / maximum value / upper limit / high limit / größter wert / maximalwert / "
        "obergrenze / 最大值 / 上限"
    ),
    "invalid": (
        "invalid / invalid value / invalid values / nan / nan value / not available / not implemented / na / "
        "na value / error value / unsupported value / ungültig / ungültiger wert / 无效值"
    ),
    "labels": (
        "labels / enum / enumeration / enum values / states / values / value list / meaning / wertebedeutung / "
        "bedeutung / zustände / 枚举 / 取值说明"
    ),
    "length": (
        "length / len / size / registers / number of registers / no of registers / num registers / register count / "
        "registers count / quantity / quantity of registers / count / reg count / words / no of words / "
        "number of words / bytes / register length / data length / länge / anzahl / anzahl register / "
        "registeranzahl / 长度 / 数量 / 个数 / 寄存器数量 / 寄存器个数 / 寄存器数 / 字数"
    ),
    "write at": "write at / write address / write register / schreibadresse / 写地址",
    "write function": "write function / write function code / write fc / schreibfunktion / 写功能码",
    DESCRIPTION: (
        "description / descriptions / remark / remarks / note / notes / comment / comments / details / "
        "explanation / meaning of the register / definition / beschreibung / bemerkung / bemerkungen / "
        "kommentar / hinweis / erläuterung / descripción / descrizione / 描述 / 说明 / 备注 / 注释 / 含义"
    ),
}
#: What may stand in a heading beside its own words.
_BESIDE: Final = frozenset(
    ("modbus", "the", "of", "in", "no", "nr", "dec", "decimal", "hex", "hexadecimal", "dezimal", "hexadezimal", "first")
)
_MOST_CELLS: Final = 200
#: The part of the cells that must be as the heading says, where it may mean several things.
_ENOUGH: Final = 0.6
_COLUMNS_OF: Final[Mapping[str, tuple[str, ...]]] = {
    spelling: tuple(column for column, others in _SPELLINGS.items() if spelling in map(simple, others.split(" / ")))
    for spellings in _SPELLINGS.values()
    for spelling in map(simple, spellings.split(" / "))
}
#: What the cells of a column are, where its heading may mislead.
_IS_ONE: Final[Mapping[str, Callable[[str], object]]] = {
    "address": looks_like_a_place,
    "reference": looks_like_a_place,
    "area": area_of,
    "function": functions_of,
    "type": type_of,
    "access": access_of,
    "name": lambda cell: not looks_like_a_place(cell),
}
#: Where a column belongs whose cells are something else than its heading says.
_OTHERWISE: Final[Mapping[str, tuple[str, ...]]] = {
    "address": ("name",),
    "type": ("area", "access"),
    "area": ("type", "function"),
    "function": ("area", "name"),
}


@dataclass(frozen=True, slots=True)
class Columns:
    """The columns of a sheet: where each is, the best one first, and their headings."""

    places: Mapping[str, tuple[int, ...]]
    headings: Sequence[str]

    def has(self, column: str) -> bool:
        """Tell whether the sheet has this column."""
        return column in self.places

    def cell(self, cells: Sequence[str], column: str) -> str:
        """Return what a row has in a column: the first cell of these with something in it."""
        found = (cells[place] for place in self.places.get(column, ()) if place < len(cells))
        return next((cell for cell in found if cell), "")

    def heading(self, column: str) -> str:
        """Return the heading of a column, or nothing."""
        return self.headings[self.places[column][0]] if self.has(column) else ""

    @property
    def unused(self) -> list[str]:
        """The headings of columns that are not read."""
        used = {place for places in self.places.values() for place in places}
        return [heading for place, heading in enumerate(self.headings) if heading and place not in used]


def known_columns(cells: Sequence[str]) -> int:
    """Count the columns that a row names if it is the heading; 0 if it has no address."""
    found = [columns[0] for columns in map(_meanings, cells) if columns]
    return len(found) if {"address", "reference"} & set(found) else 0


def columns_of(sheet: Sheet) -> Columns:
    """Find the columns of a sheet."""
    headings, places = sheet.heading.cells, dict[str, list[int]]()
    for place in sorted(range(len(headings)), key=lambda place: len(_meanings(headings[place]))):
        cells = [row.cells[place] for row in sheet.rows if place < len(row.cells) and row.cells[place]][:_MOST_CELLS]
        column = _column(_candidates(headings[place]), cells, places)
        if column is not None:
            places.setdefault(column, []).append(place)
    for column, found in places.items():
        found.sort(key=lambda place: _rank(column, headings[place]))
    if "name" not in places and DESCRIPTION in places:
        places["name"] = places.pop(DESCRIPTION)
    return Columns({column: tuple(found) for column, found in places.items()}, headings)


def _candidates(heading: str) -> Sequence[str]:
    """List what a column may be by its heading, the most likely first."""
    meanings = _meanings(heading)
    return tuple(dict.fromkeys((*meanings, *(other for each in meanings for other in _OTHERWISE.get(each, ())))))


def _column(candidates: Sequence[str], cells: Sequence[str], taken: Container[str]) -> str | None:
    """Choose what a column is: the first that its cells fit and that there is not yet, else the first."""
    fitting = [each for each in candidates if _fits(each, cells)] or [*candidates]
    return next((each for each in fitting if each not in taken), fitting[0] if fitting else None)


def _meanings(heading: str) -> tuple[str, ...]:
    """Find the columns with this heading, or without what stands in brackets, or without words beside it."""
    whole, without = simple(heading), simple(re.sub(r"[(\[（【].*", "", heading, flags=re.DOTALL))
    rest = " ".join(word for word in whole.split() if word not in _BESIDE)
    return next((_COLUMNS_OF[each] for each in (whole, without, rest) if each in _COLUMNS_OF), ())


def _fits(column: str, cells: Sequence[str]) -> bool:
    is_one = _IS_ONE.get(column)
    return is_one is None or not cells or sum(bool(is_one(cell)) for cell in cells) >= _ENOUGH * len(cells)


def _rank(column: str, heading: str) -> tuple[int, int]:
    """Order columns of the same kind: of names, the variable's own; of addresses, decimal ones."""
    words = simple(heading).split()
    spellings = [simple(each) for each in _SPELLINGS[column].split(" / ")]
    place = spellings.index(simple(heading)) if simple(heading) in spellings else len(spellings)
    return int("hex" in words), place if column == "name" else 0
